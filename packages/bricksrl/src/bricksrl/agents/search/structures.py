"""Structured policies: a few bounded numbers decide how a robot acts on what it observes.

A structure is an ``nn.Module`` with ``numbers``, an `Entry` each, and ``forward(observation,
numbers)``, which gives actions; what is beyond -1..1 is clamped. A user's own is a function from an
environment to such a module.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, exploration_type

from brickhub.entry import Entry
from brickhub.robot.line_edge import LINE_EDGES, edge_of
from brickhub.search import approach, edge, oscillators, upright
from brickhub.search.oscillators import TURN_DEG
from brickhub.search.structure import HubStructure
from brickhub.user_files import is_reference, load_object
from bricksrl.agents.features.encoder import encoder_keys, make_encoder
from bricksrl.agents.networks import action_size
from bricksrl.agents.settings import Settings
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.transforms import keeps_actions, layout_of, steps_of
from bricksrl.errors import DescriptionError, UnknownNameError, hint


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
    """Legs that turn endlessly, each held at its phase: `brickhub.search.oscillators` for batches.

    Args:
        single: the same for one robot, of which this is a copy in tensors.
    """

    def __init__(self, single: oscillators.Oscillators) -> None:
        super().__init__()
        self.single = single
        self.numbers = single.numbers
        legs = single.legs
        # not persistent: they follow from the environment, a checkpoint keeps the numbers only
        self.angles = _constant([leg.angle for leg in legs])
        self.actions = _constant([leg.action for leg in legs])
        self.signs = _constant([leg.sign for leg in legs])
        self.gains = _constant([leg.gain for leg in legs])
        self.half_turns = _constant([leg.half_turn_deg for leg in legs])
        self.places = _constant([leg.place for leg in legs])

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        # what is called an error holds the common rotation too: [*batch, legs]
        angles_deg = observation[..., self.angles] * self.signs
        # those of the first pair have no phase of their own; the speed is in its place
        phases = torch.where(self.places > 0, numbers[..., self.places], 0.0)
        error_rad = (angles_deg - self.half_turns - phases).deg2rad()
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
        nothing = turns.new_zeros(*turns.shape[:-1], self.single.size)
        return nothing.index_copy(-1, self.actions, turns)


class Approach(nn.Module):
    """Approach to a place at some distance, at a speed in proportion to the way that is left:
    `brickhub.search.approach` for batches.

    Args:
        single: the same for one robot, of which this is a copy in tensors.
    """

    def __init__(self, single: approach.Approach) -> None:
        super().__init__()
        self.single = single
        self.numbers = single.numbers

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        goal_mm = numbers[..., :1]
        gain = numbers[..., 1:]
        way_mm = observation[..., :1] - goal_mm
        return gain * way_mm / self.single.top_mm_s


class Upright(nn.Module):
    """Keeping upright on two wheels: `brickhub.search.upright` for batches.

    Args:
        single: the same for one robot.

    Attributes:
        needs_hub: that a robot falls sooner than an exchange with its hub takes.
    """

    needs_hub = True

    def __init__(self, single: upright.Upright) -> None:
        super().__init__()
        self.single = single
        self.numbers = single.numbers

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        pitch_deg, rate_deg_s, angle_deg, speed_deg_s = observation[..., :4].split(1, -1)
        lean_deg, gain, ahead_s, by_angle, by_speed = numbers.split(1, -1)
        off_deg = pitch_deg - lean_deg + ahead_s * rate_deg_s
        off_deg = off_deg + by_angle * angle_deg + by_speed * speed_deg_s
        share: Tensor = gain * off_deg / 100
        # Both wheels turn alike.
        return share.expand(*share.shape[:-1], 2)


class Edge(nn.Module):
    """Following the edge of a line: `brickhub.search.edge` for batches.

    Args:
        single: the same for one robot.

    Attributes:
        needs_hub: that a turn of a robot that sees far ahead takes its sensor off the edge sooner
            than an exchange with its hub takes.
    """

    needs_hub = True

    def __init__(self, single: edge.EdgeFollowing) -> None:
        super().__init__()
        self.single = single
        self.numbers = single.numbers

    def forward(
        self,
        observation: Tensor,
        numbers: Tensor,
    ) -> Tensor:
        speed_mm_s = numbers[..., :1]
        gain = numbers[..., 1:2]
        off_pct = observation[..., :1] - self.single.edge_pct
        speed = (speed_mm_s - self.single.middle_mm_s) / self.single.half_mm_s
        turn_deg_s = gain * off_pct
        if self.single.yaw_rate is not None:
            yaw_deg_s = observation[..., self.single.yaw_rate : self.single.yaw_rate + 1]
            turn_deg_s = turn_deg_s + numbers[..., 2:] * yaw_deg_s
        turn = turn_deg_s / self.single.top_deg_s
        # What all robots of a batch share has one row.
        return torch.cat((speed.expand_as(turn), turn), -1)


def _constant(values: Sequence[float]) -> nn.Buffer:
    """A tensor that moves with its module and is not in its state."""
    return nn.Buffer(torch.tensor(values), persistent=False)


def make_oscillators(env: EnvBase) -> Oscillators:
    """Oscillators for the legs of an environment's robot. Raises DescriptionError if it has no
    motors that turn endlessly and whose angles are observed, or one beside others."""
    task = interface_of(env).task
    layout = layout_of(env)
    # the hub's program reads the task's own numbers and commands, and no transform of them
    if task is None or layout.keys != ["observation"] or not keeps_actions(env):
        raise DescriptionError(oscillators.NO_LEGS)
    # an angle that wraps has no stop
    angles = {name: index for name, index in layout.places.items() if layout.wraps[index]}
    single = oscillators.oscillators(
        task.robot,
        task.interface,
        angles=angles,
        # an environment that repeats actions makes several steps of the task in one
        steps=steps_of(env),
    )
    return Oscillators(single)


def make_approach(env: EnvBase) -> Approach:
    """An approach for an environment with one speed to command and one distance to observe. Raises
    DescriptionError for any other."""
    task = interface_of(env).task
    is_plain = layout_of(env).keys == ["observation"] and keeps_actions(env)
    if task is None or not is_plain or len(task.entries) != 1:
        raise DescriptionError("an approach observes one distance, and nothing else")
    return Approach(approach.approach(task.interface))


def make_upright(env: EnvBase) -> Upright:
    """Keeping upright for an environment with the voltages of two wheels. Raises DescriptionError
    for any other."""
    task = interface_of(env).task
    is_plain = layout_of(env).keys == ["observation"] and keeps_actions(env)
    if task is None or not is_plain:
        raise DescriptionError("keeping upright is learned on a robot itself, without transforms")
    return Upright(upright.upright(task.interface))


def make_edge(env: EnvBase) -> Edge:
    """Following the left edge of a line, for an environment with a speed and a turn rate to command
    and a reflection to observe. Raises DescriptionError for any other."""
    task = interface_of(env).task
    is_plain = layout_of(env).keys == ["observation"] and keeps_actions(env)
    if task is None or not is_plain:
        raise DescriptionError("an edge is followed on a robot itself, without transforms")
    light = getattr(task.interface.channels[0], "sensor", "")
    kinds = {sensor.name: sensor.kind for sensor in task.robot.sensors}
    if kinds.get(light) not in LINE_EDGES:
        raise DescriptionError("who follows an edge observes the reflection of a line first")
    edge_pct = edge_of(task.robot, light).edge_pct
    return Edge(edge.edge_following(task.interface, edge_pct, side="left"))


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
    "oscillators": make_oscillators,
    "approach": make_approach,
    "upright": make_upright,
    "edge": make_edge,
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
            f"there is no structure '{name}'{hint(name, STRUCTURES)}; choose "
            f"{', '.join(STRUCTURES)} or a file"
        )
    if name:
        made: Structure = load_object(name, "make_structure")(env)
        return made
    # whether a robot has legs is known only to what would use them
    try:
        return make_oscillators(env)
    except DescriptionError:
        return linear(env)


class StructuredActor(nn.Module):
    """A structure that acts by the numbers under trial when it explores, else by the best ones
    known.

    Attributes:
        trial, best: these numbers ``[p]``.
        is_trial, acted_by: whether it explored when it acted last, and the numbers ``[p]`` then.
    """

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
        self.is_trial = False
        self.acted_by = start

    def forward(self, observation: Tensor) -> Tensor:
        """Action ``[*batch, m]``."""
        self.is_trial = exploration_type() is ExplorationType.RANDOM
        numbers = self.trial if self.is_trial else self.best
        self.acted_by = numbers
        # copies of a robot try the same numbers
        numbers_of_batch = numbers.expand(*observation.shape[:-1], -1)
        action = self.structure(observation, numbers_of_batch)
        return action.clamp(-1.0, 1.0)


def hub_structure(actor: nn.Module) -> HubStructure | None:
    """What a hub acts by as an actor does; ``None`` for one that no hub knows."""
    structure = actor.structure if isinstance(actor, StructuredActor) else None
    single = getattr(structure, "single", None)
    return single if hasattr(single, "hub_source") else None
