"""Learning by imitation: from a dataset alone, whatever the robot itself does."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs.transforms import ActionChunkTransform

from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.replay.batches import batches_of
from bricksrl.agents.replay.buffer import TransitionReplayBuffer


@dataclass
class ImitationLearner(GradientLearner):
    """A learner that imitates a dataset.

    Attributes:
        batch_size: transitions in one update.
        updates_per_step: updates per environment step.
        chunk: length of predicted action chunks; 0 for single actions.
        dataset: what is imitated.
        due: fraction of an update that is left from the last steps.
    """

    uses_dataset: ClassVar[bool] = True
    needs_dataset: ClassVar[bool] = True

    batch_size: int = 256
    updates_per_step: float = 1.0
    chunk: int = 0
    dataset: TransitionReplayBuffer | None = field(default=None, init=False)
    due: float = field(default=0.0, init=False)

    def use_dataset(self, frames: TensorDictBase) -> None:
        self.see(frames)
        self.dataset = recorded_memory(
            frames,
            self.batch_size,
            self.policy.in_keys,
            chunk=self.chunk,
            device=self.device,
        )

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        # The fraction waits for the next step, as half an update a step is one in two steps.
        self.due, count = math.modf(self.due + self.updates_per_step * steps)
        return self.make_updates(int(count))

    def batches(self, count: int) -> Iterator[TensorDictBase]:
        if self.dataset is None:
            return
        for rows in batches_of([(self.dataset, self.batch_size)], count):
            yield from rows.unbind(0)

    def state_dict(self) -> dict[str, Any]:
        return {**super().state_dict(), "due": self.due}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        self.due = float(state["due"])


def recorded_memory(
    frames: TensorDictBase,
    batch_size: int,
    keys: Sequence[str],
    *,
    chunk: int = 0,
    device: torch.device | str = "cpu",
) -> TransitionReplayBuffer:
    """A buffer of recorded frames ``[time]``. With ``chunk``, actions are the next ``chunk`` ones
    ``[chunk, m]``; the last action of an episode is repeated."""
    if chunk:
        # the transform needs a batch beside time, and reads where episodes end
        whole = frames.select("action", ("next", "done"))[None]
        chunked = ActionChunkTransform(chunk, chunk_key="chunk")(whole)
        # a shallow copy: the caller's frames keep their single actions
        frames = frames.clone(recurse=False).set("action", chunked["chunk"][0])
    memory = TransitionReplayBuffer(
        max(2, len(frames)),
        batch_size,
        keys,
        device=device,
    )
    memory.extend(frames)
    return memory
