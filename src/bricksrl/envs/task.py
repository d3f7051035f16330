"""Task: a robot, the commands and channels it uses, and pure functions of tensors.

Nothing here knows of TorchRL or of a hub, and importing a task imports neither torch nor MuJoCo. All functions are batched:
observations have the shape ``[*batch, n]``, actions ``[*batch, m]`` (in -1..1), rewards and ends ``[*batch, 1]``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bricksrl.entry import Entry
from bricksrl.envs.dead_reckoning import Target, wheels
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import DescriptionError
from bricksrl.hub.interface import Interface
from bricksrl.robots import Robot
from bricksrl.twin.scene import OPEN_FLOOR, Scene

if TYPE_CHECKING:
    import numpy as np
    from torch import Tensor


@dataclass(frozen=True)
class SampledEntry(Entry):
    """An entry of the observation that is drawn at every reset and stays for the episode.

    Attributes:
        whole: draw one of the whole numbers ``low, low + 1, ..., high`` rather than any number between.
    """

    whole: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """A uniformly random value."""
        if self.whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(rng.uniform(self.low, self.high))


def never(observation: Tensor) -> Tensor:
    """The end of a task that only its time limit ends: ``False`` of shape ``[*batch, 1]``."""
    return observation.new_zeros((*observation.shape[:-1], 1)).bool()


@dataclass(frozen=True)
class Task:
    """A reinforcement learning task on a robot.

    The observation is the interface's channels in their order, then the sampled entries, then the measured ones, then those of
    the target. Where there is one, the angles of the wheels are left out. Where a camera has a goal, the task's functions get two
    more entries, which the agent does not: see ``task_entries``.

    Attributes:
        id: name and version, such as ``"RunAway-v0"``.
        doc: the description; its first line is the summary.
        max_steps: steps after which an episode is truncated.
        reward: ``(previous observation, action, observation)`` to the reward ``[*batch, 1]``. The action is the agent's own,
            in -1..1, before it is mapped to commands.
        success: the observations ``[*batch, steps, n]`` that followed the steps of a whole episode to ``[*batch]`` bool.
        metrics: the same observations to named numbers ``[*batch]`` beside the return; units in the names.
        terminated: an observation to ``[*batch, 1]`` bool.
        blocked: an observation to ``[*batch, 1]`` bool: something is in the way of a robot, which waits with its motors held
            until it is gone. A simulation without a robot never waits.
        scene: what stands around the robot when it is virtual.
        sampled_entries, measured_entries: what follows the channels in the observation. The latter are what the host measures
            after every step: the way forward in it. They are 0 after a reset.
        target: a place that a driving robot is to reach. Success and metrics get where it truly is, if the robot is virtual.
        walks: a virtual robot reports how far, fast and straight it went.
        camera: what looks at the robot and adds an image to the observation.

    Raises:
        DescriptionError: at construction, when the parts do not fit.
    """

    id: str
    doc: str
    robot: Robot
    interface: Interface
    max_steps: int
    reward: Callable[[Tensor, Tensor, Tensor], Tensor]
    success: Callable[[Tensor], Tensor]
    metrics: Callable[[Tensor], dict[str, Tensor]]
    terminated: Callable[[Tensor], Tensor] = never
    blocked: Callable[[Tensor], Tensor] = never
    scene: Scene = OPEN_FLOOR
    sampled_entries: tuple[SampledEntry, ...] = ()
    measured_entries: tuple[Entry, ...] = ()
    target: Target | None = None
    walks: bool = False
    camera: CameraView | None = None

    def __post_init__(self) -> None:
        if re.fullmatch(r"\w+-v\d+", self.id) is None:
            raise DescriptionError(f"'{self.id}' is no id for a task; take a name and a version, such as 'MyTask-v0'")
        if self.max_steps < 1:
            raise DescriptionError(f"task {self.id}: an episode of {self.max_steps} steps is empty; give max_steps of 1 or more")
        if self.target is not None:
            wheels(self.robot, self.interface)  # or it could not tell where that is
        if not self.interface.commands or not self.entries:
            raise DescriptionError(f"task {self.id}: nothing to command or nothing to observe; name commands and channels")
        names = [entry.name for entry in self.entries]
        if len(set(names)) < len(names):
            raise DescriptionError(f"task {self.id}: the observation {', '.join(names)} names an entry twice; rename one")

    @property
    def summary(self) -> str:
        """The first line of the description."""
        return self.doc.strip().partition("\n")[0]

    @property
    def observed_channels(self) -> tuple[int, ...]:
        """Places of the channels that are in the observation."""
        reckoned = () if self.target is None else wheels(self.robot, self.interface)
        return tuple(place for place in range(len(self.interface.channels)) if place not in reckoned)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The observation vector, entry by entry."""
        channels = (self.interface.channels[place].entry for place in self.observed_channels)
        target = () if self.target is None else self.target.entries
        return (*channels, *self.sampled_entries, *self.measured_entries, *target)

    @property
    def is_judged_by_more(self) -> bool:
        """Whether success and metrics may get more than the agent sees."""
        return self.camera is not None or self.target is not None

    @property
    def task_entries(self) -> tuple[Entry, ...]:
        """What reward, ends, success and metrics get: the observation; where a camera has a goal, also how far red things are.

        That is their mean distance (of the last that were seen in the episode; 0 before) and the distance of the nearest.
        """
        if self.camera is None or self.camera.goal is None:
            return self.entries
        farthest_px = self.camera.farthest_px
        names = ("mean_distance", "nearest_distance")
        return (*self.entries, *(Entry(name, 0.0, farthest_px, "px") for name in names))
