"""Callbacks of a training run, for the command line, recorders or the page."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
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


WINDOW = 5
"""Episodes of a moving mean."""


class Phase(StrEnum):
    """Activity of the agent in an episode: random prefill, exploration with learning, or evaluation
    of offline learning."""

    PREFILL = "prefill"
    TRAIN = "train"
    OFFLINE = "offline"
    """Best actions of an agent that learned from a dataset; nothing is stored."""


class RobotState(StrEnum):
    """State of one robot of a fleet."""

    STARTING = "starting"
    PLACED = "placed"
    """Waits to be placed by hand at the start position."""
    ACTING = "acting"
    LEFT = "left"
    """The robot's link broke or its process ended, which is retried."""
    GIVEN_UP = "given up"
    """The robot's process ended again and again, and is not retried."""
    DONE = "done"
    """No episodes are left."""


@dataclass(frozen=True)
class Episode:
    """A training episode; with many copies, a round of all with means over the ended episodes."""

    episode: int
    """Number of the episode, from 1."""
    phase: Phase
    steps: int
    """Total robot steps of the run at its end."""
    length: int
    return_: float
    """Sum of rewards."""
    success: bool | None
    """Success by the task's definition; ``None`` without one."""
    measures: dict[str, float] = field(default_factory=dict)
    """Metrics of the task, such as the final error, and losses, means over the updates, by name."""
    seconds: float = 0.0
    """Total time of the run at its end, without interruptions."""
    link_lost: bool = False
    """Whether the episode ended by a lost link."""
    updates_per_step: float | None = None
    """Updates so far per step that requires updates; ``None`` without such steps."""
    evaluation: float | None = None
    """Mean return of the evaluation after it, or ``None``."""
    robot: str = ""
    """Name of the robot in a fleet."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        return {**dataclasses.asdict(self), "phase": self.phase.value}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Episode:
        """Inverse of `to_dict`."""
        return cls(**{**data, "phase": Phase(data["phase"])})


@dataclass(frozen=True)
class Progress:
    """Rate over the last episodes, and estimated time of the remaining ones."""

    episodes_total: int
    steps_per_s: float
    remaining_s: float

    @classmethod
    def of(
        cls,
        episodes: Sequence[Episode],
        total: int,
    ) -> Progress:
        """The progress after these episodes of ``total``."""
        last = episodes[-1]
        # Totals are compared with those before the last few episodes, or with the run's start.
        seconds_before = 0.0
        steps_before = 0
        if len(episodes) > WINDOW:
            before = episodes[-WINDOW - 1]
            seconds_before = before.seconds
            steps_before = before.steps
        # A clock may not have moved on between two very short episodes.
        seconds = max(last.seconds - seconds_before, 1e-9)
        steps_per_s = (last.steps - steps_before) / seconds
        episodes_left = total - len(episodes)
        remaining_s = episodes_left * seconds / min(len(episodes), WINDOW)
        return cls(total, steps_per_s, remaining_s)


@dataclass(frozen=True)
class RunResult:
    """Result of a run."""

    run_dir: Path
    episodes: tuple[Episode, ...]
    interrupted: bool
    """Whether the run can be resumed."""
    updates_per_step: float | None = None
    """Updates during the robot's work per step that requires updates; ``None`` without such
    steps."""
    caught_up: int = 0
    """Updates after the robot's work."""


class Callback:
    """Base class of callbacks. Methods must return quickly, as the robot waits for them."""

    def on_env(self, env: EnvBase) -> None:
        """The environment of the run, before any motion."""

    def on_learner(self, learner: Learner) -> None:
        """The learner of the run; for asynchronous runs its robot-side actor."""

    def on_note(self, note: str) -> None:
        """A line for the user, about how the robot acts."""

    def on_start(
        self,
        config: TrainConfig,
        run_dir: Path,
        episodes_done: int,
    ) -> None:
        """The robot is connected, and the run starts, or resumes after ``episodes_done``
        episodes."""

    def on_step(
        self,
        episode: int,
        step: int,
        phase: Phase,
    ) -> None:
        """Step ``step`` (from 1) of episode ``episode`` (from 1) was made and learned from."""

    def on_transition(
        self,
        episode: int,
        step: int,
        phase: Phase,
        transition: TensorDictBase,
    ) -> None:
        """The step as returned by TorchRL's ``EnvBase.step``, before it is learned from; copy what
        you keep."""

    def on_link_lost(
        self,
        episode: int,
        length: int,
        error: BricksError,
    ) -> None:
        """The link broke after ``length`` complete steps, and the run reconnects. `on_episode`
        follows unless ``length`` is 0."""

    def on_robot(
        self,
        robot: str,
        state: RobotState,
        reason: str,
    ) -> None:
        """A robot of a fleet changed its state; ``reason`` says why it left."""

    def on_episode(
        self,
        episode: Episode,
        progress: Progress,
    ) -> None:
        """An episode ended and is on disk; in asynchronous runs it is about to be."""

    def on_catching_up(self, updates: int) -> None:
        """The robot is done, and ``updates`` updates remain."""

    def on_end(self, result: RunResult) -> None:
        """The run ended or was interrupted; its files are complete."""


class CallbackList(Callback):
    """Several callbacks as one, called in order."""

    def __init__(self, *callbacks: Callback) -> None:
        # Callbacks are passed on by name, so that a new method of the base class is passed on too.
        for name in vars(Callback):
            if name.startswith("on_"):
                setattr(self, name, self._caller(name, callbacks))

    @staticmethod
    def _caller(name: str, callbacks: Sequence[Callback]) -> Callable[..., None]:
        """A function that calls one method of all callbacks."""

        def call_all(*content: Any) -> None:
            for callback in callbacks:
                getattr(callback, name)(*content)

        return call_all
