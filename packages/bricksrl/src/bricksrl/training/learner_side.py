"""Learner in the robot's loop; `async_learner` has one in another process with the same interface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from bricksrl.agents.learner import Learner
from bricksrl.envs.rollout import lost_links, with_outcome
from bricksrl.training.checkpoint import save_checkpoint


@dataclass(frozen=True)
class LearningPace:
    """Progress of learning: robot steps with requested updates (``asked``), and with completed ones (``done``)."""

    asked: int = 0
    done: int = 0


class InLoopLearner:
    """Learns while the robot waits: repeatable, bit for bit. ``state``: pace, and frames not learned from yet."""

    def __init__(self, actor: Learner, state: dict[str, Any]) -> None:
        self.actor, self.pace = actor, LearningPace(state["pace"]["asked"], state["pace"]["asked"])
        self._collected: list[TensorDictBase] = [TensorDict(frames).auto_batch_size_(1) for frames in state["collected"]]
        self._updates_sent = -1

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Store frames ``[time]`` or ``[copies, time]``, in batches of the learner's size."""
        size = self.actor.frames_per_batch
        if frames.shape[-1] < size:
            self._collected.append(frames)
            if sum(part.shape[-1] for part in self._collected) < size:
                return
            frames = torch.cat(self._collected, -1)
            if len(with_outcome(frames, lost_links(frames))) < size:
                return
            self._collected = []
        self.actor.remember(frames, robot)

    def end_episodes(self, robot: int | None = None) -> None:
        """End the current episode of a robot, or of all."""
        self.actor.end_episodes(robot)

    def new_weights(self) -> dict[str, Tensor] | None:
        """The policy's tensors, if there are new ones since the last call."""
        if self._updates_sent == self.actor.updates:
            return None
        self._updates_sent = self.actor.updates
        return self.actor.policy_state()

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Make the updates for ``steps`` steps, if a batch is complete. Returns mean metrics."""
        self.pace = LearningPace(self.pace.asked + steps, self.pace.done + steps)
        return {} if self._collected else self.actor.learn(steps)

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write a checkpoint of ``state``, the learner and pending frames."""
        collected = [frames.to_dict() for frames in self._collected]
        own = {"agent": self.actor.state_dict(), "pace": asdict(self.pace), "collected": collected}
        save_checkpoint(path, {**own, **state})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Nothing is pending."""
