"""Policy that a robot's hub acts by: the computer sends its numbers, and takes what comes of each
step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from brickhub.hub.program.generate import LONGEST_TRIAL_MS
from brickhub.hub.trial_protocol import MOST_STEPS

if TYPE_CHECKING:
    from brickhub.entry import Entry
    from brickhub.hub.interface import Interface
    from bricksrl.envs.options import EnvOptions
    from bricksrl.envs.task import Task


@dataclass(frozen=True)
class HubPolicy:
    """A structured policy on a hub.

    Attributes:
        numbers: its numbers ``[p]``, with their ranges.
        source: MicroPython that defines ``act_by(observed, numbers)``.
        tilt_deg: pitch or roll that ends a trial.
        next_trial: numbers ``[p]`` and steps of a trial that begins; ``None`` steps for as many as
            a hub makes.
    """

    numbers: tuple[Entry, ...]
    source: str
    tilt_deg: float
    next_trial: Callable[[], tuple[Sequence[float], int | None]]


def most_steps(interface: Interface) -> int:
    """Steps of the longest trial that a hub makes by itself."""
    return min(MOST_STEPS, LONGEST_TRIAL_MS // interface.settle.longest_ms)


def by_steps_because(task: Task, options: EnvOptions) -> str:
    """Why a robot cannot act by a policy on its hub, in a clause; "" if it can."""
    channels = task.interface.channels
    if not task.robot.hub.model.runs_programs:
        return "its devices run no programs"
    if task.client is not None:
        return "it runs a client of your own"
    if task.camera is not None or task.sensors:
        return "a camera or a sensor is on this computer"
    # A task that streams does so for who acts from a computer.
    if options.streaming:
        return "it streams"
    if options.is_transformed or task.base_env is not None:
        return "transforms are between the robot and its agent"
    if list(task.observed_channels) != list(range(len(channels))):
        return "it does not observe all that its hub measures"
    return ""
