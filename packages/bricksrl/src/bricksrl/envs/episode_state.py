"""State of an episode of a robot, which changes every step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bricksrl.envs.odometry import Odometer, TargetTracker
    from bricksrl.envs.vision.camera import Watch

Floats = NDArray[np.float32]


@dataclass(slots=True)
class EpisodeState:
    """State that changes every step; not in the environment, where each attribute assignment costs
    ten microseconds.

    Attributes:
        drawn: sampled entries, constant for the episode.
        commands: the last ones, where they are observed.
        odometer: measures the distance travelled.
        zeros: of the observed channels, what is subtracted from each: what one that accumulates was
            at the start.
        tracker: position of the target; ``None`` for a task without a target.
        watch: the camera's view; ``None`` for a task without a camera.
        observation: the last one, as the task's functions get it; ``images``: those that belong to
            it, by name.
        rewards: of each step, for whoever shows them.
        task_observations: what success and metrics get after each step; only with a camera or a
            target.
        is_cut: whether a pause truncated the episode.
        measured_s: the link's clock when the last observation was measured; ``hub_time_s`` is the
            hub's.
        age_s: age of the observation that the last action was chosen for, when the action was sent.
    """

    drawn: list[float]
    commands: list[float]
    measured_s: float
    odometer: Odometer
    zeros: list[float]
    tracker: TargetTracker | None
    watch: Watch | None = None
    observation: Any = ()
    images: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    step_count: int = 0
    rewards: list[float] = field(default_factory=list)
    task_observations: list[Any] = field(default_factory=list)
    is_cut: bool = False
    hub_time_s: float = 0.0
    age_s: float = 0.0

    def observe(
        self,
        channels: Sequence[float],
        forward_mm: Sequence[float],
    ) -> Floats:
        """The observation ``[n]`` as the task's functions get it: channels, sampled entries,
        distance forward, last commands, the target's entries and the camera's distances."""
        # The order is that of the task's entries, by which its functions index them.
        values = [*channels, *self.drawn, *forward_mm, *self.commands]
        if self.tracker is not None:
            values += self.tracker.entries()
        if self.watch is not None:
            values += self.watch.numbers()
        return np.array(values, dtype=np.float32)
