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
from bricksrl.envs.transforms import keeps_actions, layout_of, steps_of
from bricksrl.errors import DescriptionError, UnknownNameError, hint

TURN_DEG = 360.0
"""A turn."""


class Structure(Protocol):
    """A structured policy."""

    numbers: tuple[Entry, ...]

    def __call__(self, observation: Tensor, numbers: Tensor) -> Tensor:
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
        self.angles, self.actions, self.signs = (
            nn.Buffer(column, persistent=False) for column in torch.tensor(legs).T
        )
        self.lags = nn.Buffer(lags, persistent=False)
        self.gains = nn.Buffer(actions_per_deg, persistent=False)

    def forward(self, observation: Tensor, numbers: Tensor) -> Tensor:
        error_rad = (observation[..., self.angles] * self.signs - self._phases(numbers)).deg2rad()
        mean_rad = torch.atan2(
            error_rad.sin().mean(-1, keepdim=True), error_rad.cos().mean(-1, keepdim=True)
        )
        ahead_deg = (
            torch.remainder((error_rad - mean_rad).rad2deg() + TURN_DEG / 2, TURN_DEG)
            - TURN_DEG / 2
        )
        turns = self.signs * (numbers[..., :1] - ahead_deg * self.gains).clamp(-1.0, 1.0)
        return turns.new_zeros(*turns.shape[:-1], self.size).index_copy(-1, self.actions, turns)

    def _phases(self, numbers: Tensor) -> Tensor:
        """Phases of the legs ``[*batch, legs]``, in degrees."""
        return self.lags[:, 0] + numbers[..., 1:] @ self.lags[:, 1:].T

    def hub_source(self, numbers: Tensor) -> str:
        """MicroPython that acts by these numbers ``[p]``: ``act(observed)``, as `forward`."""
        phases = self._phases(numbers).tolist()
        rows = zip(
            self.angles.tolist(),
            self.actions.tolist(),
            self.signs.tolist(),
            phases,
            self.gains.tolist(),
            strict=True,
        )
        legs = "".join(
            f"    ({a}, {b}, {sign}, {phase:.5g}, {gain:.5g}),\n"
            for a, b, sign, phase, gain in rows
        )
        return (
            f"SPEED = {float(numbers[0]):.5g}\nSIZE = {self.size}\nLEGS = (  # {_LEG}\n"
            f"{legs})\n{_HUB_SOURCE}"
        )


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
    layout = layout_of(env)
    legs: dict[str, tuple[int, int, float]] = {}  # angle, action and degrees of an action, by motor
    if task is None or layout.keys != ["observation"] or not keeps_actions(env):
        raise DescriptionError(_NO_LEGS)
    angles = {name: index for name, index in layout.places.items() if layout.wraps[index]}
    for action, command in enumerate(task.interface.commands):
        unit_s = {"deg": float(command.is_turn_by), "deg/s": 1.0 / task.rate_hz}.get(
            command.unit, 0.0
        ) * steps_of(env)
        if f"{command.name}_angle" in angles and unit_s:
            legs[command.name] = (
                angles[f"{command.name}_angle"],
                action,
                unit_s * (command.high - command.low) / 2,
            )
    if len(legs) < 2:
        raise DescriptionError(_NO_LEGS)
    pairs = [pair for pair in task.robot.mirrored if set(pair) <= set(legs) and pair[0] != pair[1]]
    paired = set(itertools.chain(*pairs))
    groups = [*pairs, *((name,) for name in legs if name not in paired)]
    lags = torch.zeros(len(legs), len(groups))
    order = [name for group in groups for name in group]
    rows = []
    for index, (place, name) in enumerate(
        (place, name) for group in groups for place, name in enumerate(group)
    ):
        sign = task.robot.in_mirror(name)[1] if place else 1
        rows.append((*legs[name][:2], sign))
        lags[index, next(number for number, group in enumerate(groups) if name in group)] = 1.0
        lags[index, 0] = place * TURN_DEG / 2  # the first group has no phase of its own
    phases = [Entry(f"{group[0]}_phase", 0.0, TURN_DEG, "deg", wraps=True) for group in groups[1:]]
    numbers = Entry("speed", -1.0, 1.0), *phases
    gains = torch.tensor([1.0 / legs[name][2] for name in order])
    return Oscillators(rows, numbers, lags, gains, action_size(env))


class Linear(nn.Module):
    """Linear feedback: actions are a matrix, row by row, and an offset times the scaled
    observation."""

    def __init__(self, encoder: Any, size: int) -> None:
        super().__init__()
        self.encoder = encoder
        self.size = size
        self.numbers = tuple(
            Entry(f"weight_{row}_{column}", -1.0, 1.0)
            for row in range(size)
            for column in range(encoder.size + 1)
        )

    def forward(self, observation: Tensor, numbers: Tensor) -> Tensor:
        features = torch.nn.functional.pad(self.encoder(observation), (0, 1), value=1.0)
        action: Tensor = (numbers.unflatten(-1, (self.size, -1)) @ features.unsqueeze(-1)).squeeze(
            -1
        )
        return action


def linear(env: EnvBase) -> Linear:
    """Linear feedback. Raises DescriptionError for an environment with images."""
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
    try:
        return oscillators(env)
    except DescriptionError:
        return linear(env)


class StructuredActor(nn.Module):
    """A structure that acts by the numbers under trial when it explores, else by the best ones
    known."""

    trial: Tensor
    best: Tensor

    def __init__(self, structure: Structure, start: Tensor) -> None:
        super().__init__()
        self.structure = structure
        self.register_buffer("trial", start.clone())
        self.register_buffer("best", start.clone())

    def forward(self, observation: Tensor) -> Tensor:
        """Action ``[*batch, m]``."""
        numbers = self.trial if exploration_type() is ExplorationType.RANDOM else self.best
        return self.structure(observation, numbers.expand(*observation.shape[:-1], -1)).clamp(
            -1.0, 1.0
        )
