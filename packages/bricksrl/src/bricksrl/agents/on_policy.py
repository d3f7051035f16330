"""Learning on-policy: from what the present policy does, which is discarded after some passes."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import ReplayBuffer

from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.envs.rollout import cut_at_lost_links, lost_links, with_outcome


@dataclass
class OnPolicyLearner(GradientLearner):
    """A learner that makes passes over the frames that its policy has just collected.

    Attributes:
        memory: any replay buffer for the frames of one update; its sampler defines a batch.
        prepare: applied to frames ``[*copies, time]`` before they are stored, such as `GAE`.
        passes: passes over the frames.
        frames_per_batch: steps collected between updates.
    """

    on_policy: ClassVar[bool] = True

    memory: ReplayBuffer
    prepare: Callable[[TensorDictBase], TensorDictBase] = lambda frames: frames
    passes: int = 1
    frames_per_batch: int = 1

    @property
    def updates_per_step(self) -> float:
        """Passes over each step."""
        return self.passes

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        frames = frames.to(self.device)
        self.see(frames)
        # An estimate over time, such as GAE, must not reach across a lost link.
        prepared = self.prepare(cut_at_lost_links(frames))
        rows = with_outcome(prepared, lost_links(frames))
        if len(rows):
            self.memory.extend(rows)

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        size = self.memory.batch_size or len(self.memory)
        batches_a_pass = math.ceil(len(self.memory) / size)
        metrics = self.make_updates(self.passes * batches_a_pass)
        # What was collected by the policy before these updates is not learned from again. A
        # checkpoint has no memory for that: between two steps of a run it is empty.
        self.memory.empty()
        return metrics

    def batches(self, count: int) -> Iterator[TensorDictBase]:
        if not len(self.memory):
            return
        for _ in range(count):
            yield self.memory.sample()
