"""What a training run tells while it goes on; a command line or a dashboard listens."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensordict import TensorDictBase

    from bricksrl.errors import BricksError
    from bricksrl.training.config import TrainConfig


class Phase(StrEnum):
    """What the agent does in an episode: act at random to fill the replay buffer, or act itself and learn."""

    PREFILL = "prefill"
    TRAIN = "train"


@dataclass(frozen=True)
class Episode:
    """One episode of training.

    Attributes:
        episode: its number, from 1.
        steps: robot steps of the run up to its end.
        length: its own steps.
        return_: sum of its rewards.
        success: whether the task calls it one; ``None`` where the environment has no notion of it.
        losses: mean over its updates, by name; empty where nothing was learned.
        seconds: time of the run up to its end, interruptions left out.
    """

    episode: int
    phase: Phase
    steps: int
    length: int
    return_: float
    success: bool | None
    losses: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for a checkpoint."""
        return {**dataclasses.asdict(self), "phase": self.phase.value}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Episode:
        """Inverse of `to_dict`."""
        return cls(**{**data, "phase": Phase(data["phase"])})


@dataclass(frozen=True)
class Progress:
    """How far a run is: rate over the last episodes, and the time that the remaining ones will take at that rate."""

    episodes_total: int
    steps_per_s: float
    remaining_s: float


@dataclass(frozen=True)
class RunResult:
    """How a run ended: its folder, all its episodes, and whether it was interrupted (it can then be resumed)."""

    run_dir: Path
    episodes: tuple[Episode, ...]
    interrupted: bool


class Observer:
    """Listens to a run. Override what you need; each call returns quickly, the robot waits for it."""

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        """The robot answers and the run begins, or goes on after ``episodes_done`` episodes."""

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        """Step ``step`` (from 1) of episode ``episode`` (from 1) has been made and learned from."""

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        """Step ``step`` (from 1) of episode ``episode`` (from 1), as the environment gave it, before anything is learned from it.

        ``transition`` is what TorchRL's ``EnvBase.step`` returns: what the agent saw and did, and under "next" what followed:
        the observation, "reward", "terminated", "truncated", "done", and all else that the environment tells. Copy what you keep.
        """

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        """The link to the robot broke in this episode, after ``length`` whole steps: there the episode ends, and the run tries
        to reach the robot again. `on_episode` follows where there was at least one step."""

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        """An episode ended and everything about it is on the disk."""

    def on_end(self, result: RunResult) -> None:
        """The run ended or was interrupted; its files are in order."""
