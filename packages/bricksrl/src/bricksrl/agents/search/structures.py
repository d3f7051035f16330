"""Structured policies: a few bounded numbers decide how a robot acts on what it observes.

A structure is an ``nn.Module`` with ``numbers``, an `Entry` each, and ``forward(observation,
numbers)``, which gives actions; what is beyond -1..1 is clamped. A user's own is a function from an
environment to such a module.
"""

import itertools
from collections.abc import Callable
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, exploration_type

from brickhub.entry import Entry
from brickhub.user_files import is_reference, load_object
from bricksrl.agents.encoder import encoder_keys, make_encoder
from bricksrl.agents.networks import action_size
from bricksrl.agents.settings import Settings
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.task import Task
from bricksrl.envs.transforms import keeps_actions, layout_of, steps_of
from bricksrl.errors import DescriptionError, UnknownNameError, hint

TURN_DEG = 360.0
"""A turn."""


class Structure(Protocol):
    """A structured policy."""

    numbers: tuple[Entry, ...]

    def __call__(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        """Actions ``[*batch, m]`` on observations ``[*batch, n]`` by numbers ``[*batch, p]`` in
        their units."""


class Oscillators(nn.Module):
    """Legs that turn endlessly, each held at its phase: a central pattern generator (Ijspeert,
    2008) without states of its own.

    All legs turn at one speed, a share of the largest; one that is ahead of its phase is commanded
    to fall back to it within the step. The legs of one side lag behind their mirror images by half
    a turn (a symmetrical gait, Hildebrand, 1965), so that a robot of ``k`` mirrored pairs has ``k``
    numbers, and walks straight: how far it turns shows in no trial of a few steps.

    Args:
        legs: of each leg the index of its angle, that of its action, and the factor of both.
        numbers: the speed, then the phases.
        lags: of each leg half a turn or none, in degrees, then the phases that add to it, 1 or 0
            ``[legs, 1 + phases]``.
        actions_per_deg: change of an action that turns its leg one degree further in a step
            ``[legs]``.
    """

    def __init__(
        self,
        legs: list[tuple[int, int, int]],
        numbers: tuple[Entry, ...],
        lags: Tensor,
        actions_per_deg: Tensor,
        size: int,
    ) -> None:
        super().__init__()
        self.numbers = numbers
        self.size = size
        # not persistent: they follow from the environment, a checkpoint keeps the numbers only
        angles, actions, signs = torch.tensor(legs).T
        self.angles = nn.Buffer(angles, persistent=False)
        self.actions = nn.Buffer(actions, persistent=False)
        self.signs = nn.Buffer(signs, persistent=False)
        self.lags = nn.Buffer(lags, persistent=False)
        self.gains = nn.Buffer(actions_per_deg, persistent=False)

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        # what is called an error holds the common rotation too: [*batch, legs]
        angles_deg = observation[..., self.angles] * self.signs
        error_rad = (angles_deg - self._phases(numbers)).deg2rad()
        # the circular mean: the plain one of 350 and 10 degrees would be 180
        mean_sine = error_rad.sin().mean(-1, keepdim=True)
        mean_cosine = error_rad.cos().mean(-1, keepdim=True)
        mean_rad = torch.atan2(mean_sine, mean_cosine)
        # the shorter way round, -180..180
        ahead_deg = (error_rad - mean_rad).rad2deg()
        ahead_deg = torch.remainder(ahead_deg + TURN_DEG / 2, TURN_DEG) - TURN_DEG / 2
        # a leg that is behind gets more, as far as an action goes
        speed = numbers[..., :1]
        turns = self.signs * (speed - ahead_deg * self.gains).clamp(-1.0, 1.0)
        # motors that are no legs do nothing
        nothing = turns.new_zeros(*turns.shape[:-1], self.size)
        return nothing.index_copy(-1, self.actions, turns)

    def _phases(self, numbers: Tensor) -> Tensor:
        """Phases of the legs ``[*batch, legs]``, in degrees."""
        phases = numbers[..., 1:] @ self.lags[:, 1:].T
        return self.lags[:, 0] + phases

    def hub_source(self, numbers: Tensor) -> str:
        """MicroPython that acts by these numbers ``[p]``: ``act(observed)``, as `forward`."""
        columns = (
            self.angles.tolist(),
            self.actions.tolist(),
            self.signs.tolist(),
            self._phases(numbers).tolist(),
            self.gains.tolist(),
        )
        lines = [f"SPEED = {float(numbers[0]):.5g}", f"SIZE = {self.size}", f"LEGS = (  # {_LEG}"]
        # five digits are a hundredth of a degree, which is finer than motors turn
        for angle, action, sign, phase, gain in zip(*columns, strict=True):
            lines.append(f"    ({angle}, {action}, {sign}, {phase:.5g}, {gain:.5g}),")
        lines += [")", _HUB_SOURCE]
        return "\n".join(lines)


_NO_LEGS = (
    "oscillators need motors that turn endlessly and whose angles are observed; choose linear"
)
_LEG = "index of the angle, index of the action, sign of both, phase (deg), action for a degree"
_HUB_SOURCE = '''
import umath


def act(observed):
    """Turn all legs at one speed; one that is ahead of its phase waits for the others."""
    errors = [umath.radians(observed[angle] * sign - phase) for angle, _, sign, phase, _ in LEGS]
    mean = umath.atan2(sum([umath.sin(error) for error in errors]), sum([umath.cos(error) for error in errors]))
    actions = [0.0] * SIZE
    for (_, action, sign, _, gain), error in zip(LEGS, errors):
        ahead = (umath.degrees(error - mean) + 180) % 360 - 180
        actions[action] = sign * max(-1.0, min(1.0, SPEED - ahead * gain))
    return actions
'''  # noqa: E501


def oscillators(env: EnvBase) -> Oscillators:
    """Oscillators for the legs of an environment's robot. Raises DescriptionError if it has fewer
    than two motors that turn endlessly and whose angles are observed."""
    task = interface_of(env).task
    # the hub's program reads the task's own numbers and commands, and no transform of them
    if task is None or layout_of(env).keys != ["observation"] or not keeps_actions(env):
        raise DescriptionError(_NO_LEGS)
    legs = _turning_legs(env, task)
    if len(legs) < 2:
        raise DescriptionError(_NO_LEGS)
    # mirror images go together; a leg without one is a group of its own
    groups: list[tuple[str, ...]] = []
    for left, right in task.robot.mirrored:
        # a motor in the middle is its own image
        if left in legs and right in legs and left != right:
            groups.append((left, right))
    paired = set(itertools.chain(*groups))
    groups += [(name,) for name in legs if name not in paired]
    lags = torch.zeros(len(legs), len(groups))
    rows: list[tuple[int, int, int]] = []
    gains: list[float] = []
    for number, group in enumerate(groups):
        for place, name in enumerate(group):
            angle, action, action_deg = legs[name]
            # a motor that is mounted the other way round walks forwards by turning backwards
            sign = task.robot.in_mirror(name)[1] if place else 1
            index = len(rows)
            rows.append((angle, action, sign))
            gains.append(1.0 / action_deg)
            # The first group has no phase of its own, as all others lag behind it. Its column is
            # that of half turns, which are written last for that reason.
            lags[index, number] = 1.0
            lags[index, 0] = place * TURN_DEG / 2
    phases = [
        Entry(
            f"{group[0]}_phase",
            0.0,
            TURN_DEG,
            "deg",
            wraps=True,
        )
        for group in groups[1:]
    ]
    numbers = (Entry("speed", -1.0, 1.0), *phases)
    return Oscillators(
        rows,
        numbers,
        lags,
        torch.tensor(gains),
        action_size(env),
    )


def _turning_legs(env: EnvBase, task: Task) -> dict[str, tuple[int, int, float]]:
    """Index of the angle, index of the action, and degrees that an action of 1 turns in a step, by
    the name of each motor that turns endlessly and whose angle is observed."""
    layout = layout_of(env)
    # an angle that wraps has no stop
    angles = {name: index for name, index in layout.places.items() if layout.wraps[index]}
    legs: dict[str, tuple[int, int, float]] = {}
    for action, command in enumerate(task.interface.commands):
        if command.unit == "deg":
            # a command of an absolute angle turns by nothing that is known here
            deg_per_unit = float(command.is_turn_by)
        elif command.unit == "deg/s":
            deg_per_unit = 1.0 / task.rate_hz
        else:
            deg_per_unit = 0.0
        # an environment that repeats actions makes several steps of the task in one
        deg_per_unit *= steps_of(env)
        angle = angles.get(f"{command.name}_angle")
        if angle is None or not deg_per_unit:
            continue
        legs[command.name] = (angle, action, deg_per_unit * (command.high - command.low) / 2)
    return legs


class Linear(nn.Module):
    """Linear feedback: actions are a matrix, row by row, and an offset times the scaled
    observation."""

    def __init__(
        self,
        encoder: Any,
        size: int,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.size = size
        # the last column is the offset's
        places = itertools.product(range(size), range(encoder.size + 1))
        self.numbers = tuple(Entry(f"weight_{row}_{column}", -1.0, 1.0) for row, column in places)

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        features = self.encoder(observation)
        # a feature that is always 1, so that one product gives the offset too: [*batch, f + 1, 1]
        column = nn.functional.pad(features, (0, 1), value=1.0).unsqueeze(-1)
        matrix = numbers.unflatten(-1, (self.size, -1))  # [*batch, m, f + 1]
        action: Tensor = (matrix @ column).squeeze(-1)
        return action


def linear(env: EnvBase) -> Linear:
    """Linear feedback. Raises DescriptionError for an environment with images."""
    # without phases: each feature is a number to find for every motor
    encoder = make_encoder(env, Settings(angles="sincos"))
    if encoder_keys(encoder) != ["observation"]:
        raise DescriptionError(
            "linear feedback reads one vector and no images; choose another agent, such as sac"
        )
    return Linear(encoder, action_size(env))


STRUCTURES: dict[str, Callable[[EnvBase], Structure]] = {
    "oscillators": oscillators,
    "linear": linear,
}
"""Structures by name."""


def make_structure(env: EnvBase, name: str) -> Structure:
    """A structure by name, or a user's ``FILE.py:NAME``; of no name oscillators for a robot with
    legs, else linear feedback. Raises DescriptionError if it does not suit the environment."""
    if name in STRUCTURES:
        return STRUCTURES[name](env)
    if name and not is_reference(name):
        raise UnknownNameError(
            f"there is no structure '{name}'{hint(name, STRUCTURES)}; choose oscillators, linear "
            "or a file"
        )
    if name:
        made: Structure = load_object(name, "make_structure")(env)
        return made
    # whether a robot has legs is known only to what would use them
    try:
        return oscillators(env)
    except DescriptionError:
        return linear(env)


class StructuredActor(nn.Module):
    """A structure that acts by the numbers under trial when it explores, else by the best ones
    known."""

    trial: Tensor
    best: Tensor

    def __init__(
        self,
        structure: Structure,
        start: Tensor,
    ) -> None:
        super().__init__()
        self.structure = structure
        self.register_buffer("trial", start.clone())
        self.register_buffer("best", start.clone())

    def forward(self, observation: Tensor) -> Tensor:
        """Action ``[*batch, m]``."""
        is_trial = exploration_type() is ExplorationType.RANDOM
        numbers = self.trial if is_trial else self.best
        # copies of a robot try the same numbers
        numbers_of_batch = numbers.expand(*observation.shape[:-1], -1)
        action = self.structure(observation, numbers_of_batch)
        return action.clamp(-1.0, 1.0)
