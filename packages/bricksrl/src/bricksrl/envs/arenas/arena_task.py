"""Task of several robots: an arena, interfaces, and pure functions of tensors.

All functions are batched: a state has poses ``[*batch, things, 3]`` of the robots and then of the
loads; values of the robots have the shape ``[*batch, robots, n]``.
"""

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import torch
from torch import Tensor

from brickhub.entry import Entry
from brickhub.fields import Range, check_arguments, check_fields
from brickhub.hub.interface import Interface, RunAngle
from brickhub.hub.messages import Exchange, HeardNumber, TellNumber
from brickhub.hub.protocol import MAX_ACTIONS
from bricksrl.errors import DescriptionError, hint
from bricktwin.twin.arena import Arena

WHEELS = 2


@dataclass(frozen=True)
class ArenaState:
    """State of an arena.

    Attributes:
        poses: ``[*batch, things, 3]``: x and y in metres, and the heading in radians,
            counter-clockwise, 0 along x.
        moved: ``[*batch, robots, 2]``: turn of the left and the right wheel in the last step, as a
            share of the largest command.
        heard: ``[*batch, robots, n]``: what each robot's hub has heard: all numbers of the first
            other robot, then those of the next; 0 where nothing was heard for a second.
        drawn: ``[*batch, n]``: numbers that were drawn at the start of the episode.
    """

    poses: Tensor
    moved: Tensor
    heard: Tensor = field(default_factory=lambda: torch.zeros(0))
    drawn: Tensor = field(default_factory=lambda: torch.zeros(0))


@dataclass(frozen=True)
class ArenaTask:
    """A task of several robots. Raises DescriptionError if the parts do not fit.

    Attributes:
        id: name and version, such as ``"Tag-v0"``.
        doc: the description; its first line is the summary.
        interfaces: interface of each of the arena's robots, with `RunAngle` of the left and of the
            right wheel, equally far back and forth, and the `MotorAngle` of both. What the robots
            tell one another is added to them.
        groups: names of the robots that learn together, by group; each robot is in one. By default
            the first group learns.
        max_steps: steps after which an episode is truncated.
        entries: entries of each robot's observation.
        observe: maps a state to the observations, ``[*batch, robots, n]``.
        reward: maps the states before and after a step to the rewards, ``[*batch, robots, 1]``.
        terminated: maps a state to ``[*batch, 1]`` bool.
        success: maps the state after the last step to ``[*batch, 1]`` bool.
        scripts: hand-written policies by name, from an observation ``[*batch, n]`` of one robot to
            its action ``[*batch, 2 + told]``.
        opponents: script of each group while it does not learn, or several separated by commas for
            the copies in turn.
        told: numbers in -1..1 that each robot tells the others in a step, from hub to hub over the
            air; they come last in its action.
        drawn: range of each number that is drawn uniformly at the start of an episode, such as
            where a goal is.
        mark: maps these numbers to the places of the arena's marks, ``[marks, 2]``, x and y in
            metres.
    """

    id: str
    doc: str
    arena: Arena
    interfaces: tuple[Interface, ...]
    groups: Mapping[str, tuple[str, ...]]
    max_steps: int
    entries: tuple[Entry, ...]
    observe: Callable[[ArenaState], Tensor]
    reward: Callable[[ArenaState, ArenaState], Tensor]
    terminated: Callable[[ArenaState], Tensor]
    success: Callable[[ArenaState], Tensor]
    scripts: Mapping[str, Callable[[Tensor], Tensor]] = field(default_factory=dict)
    opponents: Mapping[str, str] = field(default_factory=dict)
    told: Annotated[int, Range(0, MAX_ACTIONS - WHEELS)] = 0
    drawn: tuple[tuple[float, float], ...] = ()
    mark: Callable[[Tensor], Tensor] | None = None

    def __post_init__(self) -> None:
        check_fields(ArenaTask, vars(self))
        for name, arguments in _ARGUMENTS.items():
            check_arguments(f"{name} of {self.id}", getattr(self, name), arguments)
        for name, script in self.scripts.items():
            check_arguments(f"script '{name}' of {self.id}", script, ("observation",))
        if self.mark is not None:
            check_arguments(f"mark of {self.id}", self.mark, ("drawn",))
        if bool(self.arena.marks) != (self.mark is not None):
            raise DescriptionError(
                f"task {self.id}: the marks of an arena and the function that says where they are "
                "belong together; give both or none"
            )
        if re.fullmatch(r"\w+-v\d+", self.id) is None:
            raise DescriptionError(
                f"'{self.id}' is not an id for a task; take a name and a version, such as 'Tag-v0'"
            )
        names = [robot.name for robot in self.arena.robots]
        if len(self.interfaces) != len(names):
            raise DescriptionError(
                f"task {self.id} has {len(names)} robots and {len(self.interfaces)} interfaces; "
                "give one each"
            )
        grouped = [name for group in self.groups.values() for name in group]
        if sorted(grouped) != sorted(names):
            raise DescriptionError(
                f"task {self.id}: each of {', '.join(names)} belongs to one group; name it "
                "there once"
            )
        for group, opponents in self.opponents.items():
            if group not in self.groups:
                raise DescriptionError(
                    f"task {self.id}: opponents names '{group}', which is no "
                    f"group{hint(group, self.groups)}; name one that is"
                )
            for name in opponents.split(","):
                self.script(name)
        interfaces = [
            _telling(interface, number, len(names), self.told)
            for number, interface in enumerate(self.interfaces)
        ]
        object.__setattr__(self, "interfaces", tuple(interfaces))
        for interface in self.interfaces:
            if not _drives_two_wheels(interface):
                wanted = (
                    "RunAngle of the left and of the right wheel, as far back as forth, and "
                    "the MotorAngle of both"
                )
                raise DescriptionError(f"task {self.id}: each robot needs {wanted}")

    def script(self, name: str) -> Callable[[Tensor], Tensor]:
        """The hand-written policy of a name, or ``random``. Raises DescriptionError if there is
        none."""
        known: dict[str, Callable[[Tensor], Tensor]] = {
            "random": functools.partial(_random, size=self.action_size),
            **self.scripts,
        }
        if name not in known:
            raise DescriptionError(
                f"task {self.id}: there is no script '{name}'; choose {', '.join(known)}"
            )
        return known[name]

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots, in the arena's order."""
        return tuple(robot.name for robot in self.arena.robots)

    @property
    def action_size(self) -> int:
        """Numbers of each robot's action: those of its wheels, then what it tells."""
        return WHEELS + self.told

    @property
    def heard_size(self) -> int:
        """Numbers that each robot hears."""
        return self.told * (len(self.robots) - 1)

    def places(self, group: str) -> list[int]:
        """Indices of a group's robots among all robots."""
        return [self.robots.index(name) for name in self.groups[group]]


def _drives_two_wheels(interface: Interface) -> bool:
    """Whether an interface turns and observes a left and a right wheel, and does nothing else than
    to tell and to hear."""
    turns = [command for command in interface.commands if isinstance(command, RunAngle)]
    wheels = [turn.motor for turn in turns if turn.low == -turn.high]
    moves = [command for command in interface.commands if not isinstance(command, TellNumber)]
    is_all = len(moves) == len(wheels)
    is_observed = set(interface.angle_indices) == set(wheels)
    return wheels == ["left", "right"] and is_all and is_observed


def _telling(
    interface: Interface,
    number: int,
    robots: int,
    told: int,
) -> Interface:
    """The interface of a robot, by its number, with what it tells and hears."""
    # It may have been added already, to a task of which this one is a copy.
    commands = [one for one in interface.commands if not isinstance(one, TellNumber)]
    channels = [one for one in interface.channels if not isinstance(one, HeardNumber)]
    if told:
        others = tuple(other for other in range(robots) if other != number)
        exchange = Exchange(number, others, told)
        commands += exchange.commands
        channels += exchange.channels
    return replace(interface, commands=tuple(commands), channels=tuple(channels))


def _random(observation: Tensor, size: int) -> Tensor:
    batch = observation.shape[:-1]
    return 2.0 * torch.rand(*batch, size, device=observation.device) - 1.0


_ARGUMENTS = {
    "observe": ("state",),
    "reward": ("before", "after"),
    "terminated": ("state",),
    "success": ("state",),
}
"""Arguments of the functions of a task."""


def seen_from(
    poses: Tensor,
    viewer: int,
    seen: int,
) -> Tensor:
    """Pose of a thing in a robot's frame, ``[*batch, 4]``: metres ahead and to the left, cosine and
    sine of the difference of their headings."""
    x, y, heading = poses[..., viewer, :].unbind(-1)
    other_x, other_y, other_heading = poses[..., seen, :].unbind(-1)
    dx = other_x - x
    dy = other_y - y
    turn = other_heading - heading
    cos = heading.cos()
    sin = heading.sin()
    ahead = dx * cos + dy * sin
    left = dy * cos - dx * sin
    return torch.stack((ahead, left, turn.cos(), turn.sin()), -1)


def own_pose(poses: Tensor, robot: int) -> Tensor:
    """Pose of a robot in the arena, ``[*batch, 4]``: x, y, and cosine and sine of its heading."""
    x, y, heading = poses[..., robot, :].unbind(-1)
    return torch.stack((x, y, heading.cos(), heading.sin()), -1)


def steer_towards(
    ahead: Tensor,
    left: Tensor,
    speed: float = 1.0,
) -> Tensor:
    """Action ``[*batch, 2]`` that turns a robot on two wheels towards a direction in its frame, and
    drives on as far as it faces it."""
    angle = torch.atan2(left, ahead)
    forward = speed * angle.cos().clamp_min(0.0)
    turn = (1.5 * angle).clamp(-1.0, 1.0) * 0.6
    action = torch.stack((forward - turn, forward + turn), -1)
    # Where one wheel would exceed its range, both are slowed down alike, so that the curve stays.
    largest = action.abs().amax(-1, keepdim=True)
    return action / largest.clamp_min(1.0)
