"""The learner as a run sees it: in the robot's loop here, or in a process of its own in `async_learner`."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

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


class Acting:
    """A policy that acts on the device of the environment, with or without exploring.

    Attributes:
        policy: on that device; a copy where the learner is on another one.
        weights: the newest ones that came from elsewhere, which the next action takes up; another thread may put them there.
        reset_policy: called when what is seen next does not follow from the last action.
        frames_per_batch: steps that are collected between two times of learning.
    """

    def __init__(self, learner: Learner, device: torch.device | str | None = None) -> None:
        self.is_copy = device is not None and torch.device(device).type != learner.device.type
        self.policy = copy.deepcopy(learner.policy).to(device) if self.is_copy else learner.policy
        self.weights: deque[dict[str, Tensor]] = deque(maxlen=1)
        self.reset_policy, self.frames_per_batch = learner.reset_policy, learner.frames_per_batch

    def explore(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write an exploring "action" to what the environment shows."""
        return self._act(tensordict, ExplorationType.RANDOM)

    def exploit(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the best "action" to what the environment shows."""
        return self._act(tensordict, ExplorationType.DETERMINISTIC)

    def _act(self, tensordict: TensorDictBase, kind: ExplorationType) -> TensorDictBase:
        if self.weights:
            self.policy.load_state_dict(self.weights.pop())
        with torch.no_grad(), set_exploration_type(kind):
            out: TensorDictBase = self.policy(tensordict)
        return out


class InLoopLearner(Acting):
    """Learns where it is asked to, while the robot waits: repeatable, bit for bit.

    Args:
        learner: on any device; where that is not the environment's, a copy of its policy acts there.
        state: of a checkpoint, whose pace and whose frames that were not yet learned from are taken over.
        device: of the environment.
    """

    def __init__(self, learner: Learner, state: dict[str, Any], device: torch.device | str | None = None) -> None:
        super().__init__(learner, device)
        self._learner, self._steps = learner, state["pace"]["asked"]
        self._collected: list[TensorDictBase] = [TensorDict(one).auto_batch_size_(1) for one in state["collected"]]
        self._told_updates = -1

    @property
    def pace(self) -> Pace:
        """Never behind."""
        return Pace(self._steps, self._steps)

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Keep frames ``[time]`` or ``[copies, time]``; where the learner wants several steps at once, when there are so many."""
        if self._learner.frames_per_batch > frames.shape[-1]:
            self._collected.append(frames)
            if sum(part.shape[-1] for part in self._collected) < self._learner.frames_per_batch:
                return
            frames = torch.cat(self._collected, -1)
            self._collected = []
        self._learner.remember(frames, robot)

    def end_episodes(self, robot: int | None = None) -> None:
        """What is remembered next, of this robot or of any, does not follow from what was remembered last."""
        self._learner.end_episodes(robot)

    def new_weights(self) -> dict[str, Tensor] | None:
        """All that acting depends on, where that was learned since the last call."""
        if self._told_updates == self._learner.updates:
            return None
        self._told_updates = self._learner.updates
        return self._learner.policy_state()

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Make the updates of so many steps, once what they learn from is whole; returns the means of what they tell."""
        self._steps += steps
        return self._acted_upon({} if self._collected else self._learner.learn(steps))

    def study_updates(self, count: int) -> dict[str, Tensor]:
        """Make so many updates, from data alone; returns the means of what they tell."""
        return self._acted_upon(self._learner.make_updates(count))

    def _acted_upon(self, told: dict[str, Tensor]) -> dict[str, Tensor]:
        if told and self.is_copy:
            self.policy.load_state_dict(self._learner.policy.state_dict())
        return told

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write a checkpoint, ``state`` and all of the learner, and what was collected and not yet learned from."""
        from bricksrl.training.checkpoint import save_checkpoint

        collected = [frames.to_dict() for frames in self._collected]
        own = {"agent": self._learner.state_dict(), "pace": asdict(self.pace), "collected": collected}
        save_checkpoint(path, {**own, **state})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """The robot is done, and nothing is due."""
