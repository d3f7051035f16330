"""State of an episode on one robot, and the observation that it makes of what was read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import torch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bricksrl.envs.dead_reckoning import TargetTracker
    from bricksrl.envs.vision.camera import Watch


@dataclass(frozen=True)
class Timing:
    """Times of one step.

    Attributes:
        age_s: how old the observation was that the action answered, when the action left.
        hub_time_s: the hub's clock when it measured the observation that followed.
    """

    age_s: float
    hub_time_s: float


@dataclass(slots=True)
class EpisodeState:
    """What changes from step to step; apart from the environment, where every assignment costs ten microseconds.

    Attributes:
        observation: the last one, as the task's functions get it.
        watch: what the camera shows; ``None`` for a task without one.
        tracker: where the target is; ``None`` for a task without one.
        judged: every observation that followed a step, as success and metrics get it; only where that is more than the agent
            sees.
        is_cut: whether a pause ended the episode.
        measured_s: the link's clock when the last observation was measured; ``hub_time_s`` the hub's.
        age_s: of the observation that the last action answered.
    """

    drawn: NDArray[np.float32]
    observation: torch.Tensor
    measured_s: float
    step_count: int = 0
    watch: Watch | None = None
    tracker: TargetTracker | None = None
    judged: list[torch.Tensor] = field(default_factory=list)
    is_cut: bool = False
    hub_time_s: float = 0.0
    age_s: float = 0.0


def observe(
    channels: NDArray[np.float32], drawn: NDArray[np.float32], measured: NDArray[np.float32], tracker: TargetTracker | None
) -> torch.Tensor:
    """Channels, what was drawn for the episode, what the host measured, and where the target is, ``[n]``."""
    target = () if tracker is None else (np.array(tracker.entries(), dtype=np.float32),)
    return torch.from_numpy(np.concatenate((channels, drawn, measured, *target)))


def with_truth(observation: torch.Tensor, tracker: TargetTracker | None, end: int) -> torch.Tensor:
    """An observation that tells where the target truly is, in the entries before ``end``."""
    if tracker is None:
        return observation
    truth = torch.tensor(tracker.truth(), dtype=observation.dtype)
    return torch.cat((observation[: end - len(truth)], truth, observation[end:]))


def with_numbers(observation: torch.Tensor, watch: Watch) -> torch.Tensor:
    """An observation with the numbers behind it that a task's functions get of what the camera shows."""
    return torch.cat((observation, torch.from_numpy(watch.numbers())))
