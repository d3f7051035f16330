"""Mirror of a robot from left to right: which number of an observation or action takes whose place, and with which sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torch import Tensor

    from bricksrl.envs.task import Task


@dataclass(frozen=True)
class Mirror:
    """Mirror image of vectors: of each entry the one whose place it takes, its factor, and whether it wraps from 360 to 0."""

    places: tuple[int, ...]
    signs: tuple[int, ...]
    wraps: tuple[bool, ...]

    def __call__(self, vector: Tensor) -> Tensor:
        """Mirror image of vectors ``[*batch, n]``."""
        moved = vector[..., list(self.places)] * vector.new_tensor(self.signs)
        turned = [index for index, (sign, wraps) in enumerate(zip(self.signs, self.wraps, strict=True)) if wraps and sign < 0]
        if turned:
            moved[..., turned] = moved[..., turned].remainder(360.0)
        return moved


def mirrors(task: Task) -> tuple[Mirror, Mirror]:
    """Mirrors of the task's observation and action. Raises DescriptionError if its robot is not declared symmetric, or a number
    has no mirror image."""
    robot, interface = task.robot, task.interface
    if not robot.mirrored:
        raise DescriptionError(f"{task.id} is symmetric and its robot {robot.name} is not; give the robot mirrored=")
    if task.sampled_entries or task.target is not None or task.camera is not None:
        raise DescriptionError(f"{task.id} is symmetric and has a goal, whose mirror image is unknown; omit symmetric")
    channels = [interface.channels[index] for index in task.observed_channels]
    actions = [command.in_mirror(robot) for command in interface.commands]
    observed = [channel.in_mirror(robot) for channel in channels]
    observed += [(entry.name, 1) for entry in task.measured_entries]
    observed += [(f"last_{name}", sign) for name, sign in actions] if task.observes_commands else []
    for command, (_, sign) in zip(interface.commands, actions, strict=True):
        if sign == 0 or (sign < 0 and command.low != -command.high):
            raise command.error(f" has no mirror image in {task.id}: give it a range about 0, or omit symmetric")
    names, commands = [entry.name for entry in task.entries], [command.name for command in interface.commands]
    wraps = [entry.wraps for entry in task.entries]
    return _mirror(task, names, observed, wraps), _mirror(task, commands, actions, [False] * len(commands))


def _mirror(task: Task, names: Sequence[str], images: Sequence[tuple[str, int]], wraps: Sequence[bool]) -> Mirror:
    missing = {name for name, _ in images} - set(names)
    if missing:
        raise DescriptionError(f"{task.id} is symmetric and lacks {', '.join(sorted(missing))}; add them, or omit symmetric")
    return Mirror(tuple(names.index(name) for name, _ in images), tuple(sign for _, sign in images), tuple(wraps))
