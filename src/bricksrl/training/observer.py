"""What a training run tells while it goes on; a command line or a dashboard listens."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.errors import BricksError
    from bricksrl.training.config import TrainConfig


class Phase(StrEnum):
    """What the agent does in an episode: act at random to fill the replay buffer, or act itself and learn, or neither."""

    PREFILL = "prefill"
    TRAIN = "train"
    OFFLINE = "offline"
    """It has learned from a dataset, does its best, and keeps nothing of what it sees."""


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
        link_lost: whether it ended because the link to the robot broke.
        updates_per_step: updates that the run had made by its end, for each of the steps that asked for some; ``None`` before
            there was one. Below what the settings say where learning goes on beside the robot and is late.
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
    link_lost: bool = False
    updates_per_step: float | None = None

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
    """How a run ended.

    Attributes:
        run_dir, episodes: its folder, and all its episodes.
        interrupted: whether it was, so that it can be resumed.
        updates_per_step: updates that were made while the robot was at work, for each of the steps that asked for some, by this
            and all earlier parts of the run; ``None`` where nothing learned.
        caught_up: updates that were made after the robot was done.
    """

    run_dir: Path
    episodes: tuple[Episode, ...]
    interrupted: bool
    updates_per_step: float | None = None
    caught_up: int = 0


class Observer:
    """Listens to a run. Override what you need; each call returns quickly, the robot waits for it."""

    def on_env(self, env: EnvBase) -> None:
        """The environment of the run, before anything moves in it: whoever may stop or pause the robot keeps it."""

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
        """An episode ended and everything about it is on the disk, or about to be where learning goes on beside the robot."""

    def on_catching_up(self, updates: int) -> None:
        """The robot is done, and so many updates are still to be made."""

    def on_end(self, result: RunResult) -> None:
        """The run ended or was interrupted; its files are in order."""


class Together(Observer):
    """Several observers as one; each is told everything, in their order."""

    def __init__(self, *observers: Observer) -> None:
        self._observers = observers

    def on_env(self, env: EnvBase) -> None:
        for observer in self._observers:
            observer.on_env(env)

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        for observer in self._observers:
            observer.on_start(config, run_dir, episodes_done)

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        for observer in self._observers:
            observer.on_step(episode, step, phase)

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        for observer in self._observers:
            observer.on_transition(episode, step, phase, transition)

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        for observer in self._observers:
            observer.on_link_lost(episode, length, error)

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        for observer in self._observers:
            observer.on_episode(episode, progress)

    def on_catching_up(self, updates: int) -> None:
        for observer in self._observers:
            observer.on_catching_up(updates)

    def on_end(self, result: RunResult) -> None:
        for observer in self._observers:
            observer.on_end(result)
