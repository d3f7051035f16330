"""Callbacks of a training run: a command line, a recorder or a page listens to it."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.agents.learner import Learner
    from bricksrl.errors import BricksError
    from bricksrl.training.config import TrainConfig


class Phase(StrEnum):
    """The part of an agent in an episode: random actions to fill the replay buffer, exploring and learning, or neither."""

    PREFILL = "prefill"
    TRAIN = "train"
    OFFLINE = "offline"
    """It has learned from a dataset, does its best, and keeps nothing of what it sees."""


class RobotState(StrEnum):
    """State of one robot of a fleet."""

    STARTING = "starting"
    PLACED = "placed"
    """It waits for a hand that puts it where an episode starts."""
    ACTING = "acting"
    LEFT = "left"
    """Its link broke or its process ended; it is tried to reach it again."""
    DONE = "done"
    """No episode is left for it."""


@dataclass(frozen=True)
class Episode:
    """One episode of training; with many copies, a round of all of them, and means over the episodes that ended in it."""

    episode: int
    """From 1."""
    phase: Phase
    steps: int
    """Robot steps of the run up to its end."""
    length: int
    return_: float
    """Sum of its rewards."""
    success: bool | None
    """Whether the task calls it one; ``None`` where the environment has no notion of it."""
    losses: dict[str, float] = field(default_factory=dict)
    """Mean over its updates, by name; empty where nothing was learned."""
    seconds: float = 0.0
    """Time of the run up to its end, interruptions left out."""
    link_lost: bool = False
    """It ended because the link to the robot broke."""
    updates_per_step: float | None = None
    """Updates of the run by its end, for each of the steps that asked for some; ``None`` before one did."""
    evaluation: float | None = None
    """Mean return of the evaluation after it; ``None`` where there was none."""
    robot: str = ""
    """Its name, where there are several."""

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
    """How a run ended."""

    run_dir: Path
    episodes: tuple[Episode, ...]
    interrupted: bool
    """So that it can be resumed."""
    updates_per_step: float | None = None
    """Updates made while the robot was at work, for each of the steps that asked for some; ``None`` where nothing learned."""
    caught_up: int = 0
    """Updates that were made after the robot was done."""


class Callback:
    """Listens to a run. Override what you need; each call returns quickly, the robot waits for it."""

    def on_env(self, env: EnvBase) -> None:
        """The environment of the run, before anything moves in it: whoever may stop or pause the robot keeps it."""

    def on_learner(self, learner: Learner) -> None:
        """The learner of the run, which learns in the loop; beside a robot another process has the one that learns."""

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        """The robot answers and the run begins, or goes on after ``episodes_done`` episodes."""

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        """Step ``step`` (from 1) of episode ``episode`` (from 1) has been made and learned from."""

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        """That step as TorchRL's ``EnvBase.step`` returns it, before anything is learned from it: what the agent saw and did, and
        under "next" what followed. Copy what you keep."""

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        """The link to the robot broke after ``length`` whole steps: the episode ends, and the run tries to reach the robot again.
        `on_episode` follows where there was at least one step."""

    def on_robot(self, robot: str, state: RobotState, reason: str) -> None:
        """A robot of a fleet is in another state now; ``reason`` says why, where it has left."""

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        """An episode ended and everything about it is on the disk, or about to be where learning goes on beside the robot."""

    def on_catching_up(self, updates: int) -> None:
        """The robot is done, and so many updates are still to be made."""

    def on_end(self, result: RunResult) -> None:
        """The run ended or was interrupted; its files are in order."""


class CallbackList(Callback):
    """Several callbacks as one; each is told everything, in their order."""

    def __init__(self, *callbacks: Callback) -> None:
        for name in (name for name in vars(Callback) if name.startswith("on_")):
            setattr(self, name, functools.partial(self._tell, name, callbacks))

    @staticmethod
    def _tell(name: str, callbacks: tuple[Callback, ...], *content: Any) -> None:
        for callback in callbacks:
            getattr(callback, name)(*content)
