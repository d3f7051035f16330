"""State of an episode on one robot, and the assembly of its observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import torch

if TYPE_CHECKING:
    from bricksrl.envs.dead_reckoning import TargetTracker
    from bricksrl.envs.vision.watch import Watch


@dataclass(slots=True)
class EpisodeState:
    """State that changes every step; not in the environment, where each attribute assignment costs ten microseconds.

    Attributes:
        observation: the last one, as the task's functions get it.
        commands: the last ones, where they are observed.
        watch: the camera's view; ``None`` for a task without a camera.
        tracker: position of the target; ``None`` for a task without a target.
        task_observations: observations after each step, as the task's functions get them; only with a camera or a target.
        is_cut: whether a pause truncated the episode.
        measured_s: the link's clock when the last observation was measured; ``hub_time_s`` is the hub's.
        age_s: age of the observation that the last action was chosen for.
    """

    drawn: list[float]
    observation: torch.Tensor
    measured_s: float
    commands: list[float]
    step_count: int = 0
    watch: Watch | None = None
    tracker: TargetTracker | None = None
    task_observations: list[torch.Tensor] = field(default_factory=list)
    is_cut: bool = False
    hub_time_s: float = 0.0
    age_s: float = 0.0


def observe(
    channels: Sequence[float], drawn: Sequence[float], measured: Sequence[float], tracker: TargetTracker | None
) -> torch.Tensor:
    """The observation ``[n]``: channels, sampled entries, measured entries (last commands among them), then the target's."""
    target = () if tracker is None else tracker.entries()
    return torch.from_numpy(np.array((*channels, *drawn, *measured, *target), dtype=np.float32))


def with_truth(observation: torch.Tensor, tracker: TargetTracker | None, end: int) -> torch.Tensor:
    """The observation with the target's entries, which end at index ``end``, replaced by their true values."""
    if tracker is None:
        return observation
    truth = torch.tensor(tracker.truth(), dtype=observation.dtype)
    return torch.cat((observation[: end - len(truth)], truth, observation[end:]))


def with_numbers(observation: torch.Tensor, watch: Watch) -> torch.Tensor:
    """An observation with the camera's distances appended, as the task's functions get it."""
    return torch.cat((observation, torch.from_numpy(watch.numbers())))
