"""The learner as a run sees it: in the robot's loop here, or in a process of its own in `async_learner`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from bricksrl.agents.learner import Learner


@dataclass(frozen=True)
class Pace:
    """Progress of learning, in robot steps, each of which asks for the updates that the settings name.

    Attributes:
        asked: steps that updates are due for.
        done: steps whose updates were made; never more.
    """

    asked: int = 0
    done: int = 0


class InLoopLearner:
    """Learns where it is asked to, while the robot waits: repeatable, bit for bit.

    Args:
        actor: acts too.
        state: of a checkpoint, whose pace and whose frames that were not yet learned from are taken over.
    """

    def __init__(self, actor: Learner, state: dict[str, Any]) -> None:
        self.actor, self._steps = actor, state["pace"]["asked"]
        self._collected: list[TensorDictBase] = [TensorDict(one).auto_batch_size_(1) for one in state["collected"]]
        self._told_updates = -1

    @property
    def pace(self) -> Pace:
        """Never behind."""
        return Pace(self._steps, self._steps)

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Keep frames ``[time]`` or ``[copies, time]``; where the learner wants several steps at once, when there are so many."""
        if self.actor.frames_per_batch > frames.shape[-1]:
            self._collected.append(frames)
            if sum(part.shape[-1] for part in self._collected) < self.actor.frames_per_batch:
                return
            frames = torch.cat(self._collected, -1)
            self._collected = []
        self.actor.remember(frames, robot)

    def end_episodes(self, robot: int | None = None) -> None:
        """What is remembered next, of this robot or of any, does not follow from what was remembered last."""
        self.actor.end_episodes(robot)

    def new_weights(self) -> dict[str, Tensor] | None:
        """All that acting depends on, where that was learned since the last call."""
        if self._told_updates == self.actor.updates:
            return None
        self._told_updates = self.actor.updates
        return self.actor.policy_state()

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Make the updates of so many steps, once what they learn from is whole; returns the means of what they tell."""
        self._steps += steps
        return {} if self._collected else self.actor.learn(steps)

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write a checkpoint, ``state`` and all of the learner, and what was collected and not yet learned from."""
        from bricksrl.training.checkpoint import save_checkpoint

        collected = [frames.to_dict() for frames in self._collected]
        own = {"agent": self.actor.state_dict(), "pace": asdict(self.pace), "collected": collected}
        save_checkpoint(path, {**own, **state})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """The robot is done, and nothing is due."""
