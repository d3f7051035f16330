"""Action chunks: actions of several steps, predicted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.transforms import ActionChunkTransform
from torchrl.objectives import LossModule

from bricksrl.agents.encoder import encode, encoder_keys
from bricksrl.agents.learner import Learner, adam
from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.settings import NotNegative, Positive, Range, Settings
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ChunkSettings(Settings):
    """Settings of policies with action chunks; they learn from a dataset only."""

    updates_per_step: Annotated[float, Positive] = 2.0
    """Updates for each robot step."""
    chunk: Annotated[int, Range(1, 1000)] = 8
    """Length of an action chunk."""
    executed: Annotated[int, Range(1, 1000)] = 1
    """Steps between predictions."""
    ensemble: Annotated[float | None, NotNegative] = 0.01
    """Extra weight of older chunks when overlapping chunks are averaged; none uses the newest only."""
    weight_decay: Annotated[float, NotNegative] = 1e-4
    """Decoupled weight decay."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executed > self.chunk:
            raise DescriptionError(f"executed is {self.executed}; a chunk has only {self.chunk} actions")


class ChunkPolicy(TensorDictModuleBase):  # type: ignore[misc]
    """A policy with action chunks; needs a `reset` at the start of an episode and after an intervention. Overlapping chunks are
    averaged with weights exp(-ensemble * i), i from the oldest (temporal ensemble of Zhao et al., 2023). ``network``: features
    ``[*batch, f]`` of the ``encoder`` to a chunk ``[*batch, k, m]``."""

    def __init__(self, encoder: nn.Module, network: nn.Module, settings: ChunkSettings) -> None:
        super().__init__()
        self.in_keys, self.out_keys = encoder_keys(encoder), ["action"]
        self.encoder, self.network = encoder, network
        self._executed, self._ensemble = settings.executed, settings.ensemble
        self._step = 0
        self._shape: torch.Size | None = None
        self._chunks: list[tuple[int, Tensor]] = []

    def reset(self) -> None:
        """Discard predictions: the next observation does not follow from the last action."""
        self._step = 0
        self._chunks.clear()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        shape = tensordict[self.in_keys[0]].shape
        if self._chunks and shape != self._shape:  # another batch: its observations do not follow
            self.reset()
        self._shape = shape
        if self._step % self._executed == 0:
            self._chunks.append((self._step, self.network(encode(self.encoder, tensordict))))
        if self._ensemble is None:
            del self._chunks[:-1]
        self._chunks = [(start, chunk) for start, chunk in self._chunks if start + chunk.shape[-2] > self._step]
        actions = torch.stack([chunk[..., self._step - start, :] for start, chunk in self._chunks], -1)
        self._step += 1
        age = torch.arange(actions.shape[-1], dtype=actions.dtype, device=actions.device)
        weights = torch.softmax(-(self._ensemble or 0.0) * age, 0)
        return tensordict.set("action", (actions @ weights).clamp(-1.0, 1.0))


def chunk_learner(policy: ChunkPolicy, loss: LossModule, settings: ChunkSettings, **options: Any) -> Learner:
    """The learner of a chunk policy: imitates a dataset, acts without dropout."""
    optimizer = adam(loss.parameters(), settings, settings.weight_decay)
    options |= {"updates_per_step": settings.updates_per_step, "chunk": settings.chunk}
    return Learner(policy, loss, optimizer, imitates=True, **options)


def recorded_memory(
    frames: TensorDictBase, batch_size: int, keys: Sequence[str], *, chunk: int = 0, device: torch.device | str = "cpu"
) -> TransitionReplayBuffer:
    """A buffer of recorded frames ``[time]``. With ``chunk``, actions are the next ``chunk`` ones ``[chunk, m]``; the last action
    of an episode is repeated."""
    if chunk:
        rows = ActionChunkTransform(chunk, chunk_key="chunk")(frames.select("action", ("next", "done"))[None])
        frames = frames.clone(recurse=False).set("action", rows["chunk"][0])
    memory = TransitionReplayBuffer(max(2, len(frames)), batch_size, keys, device=device)
    memory.extend(frames)
    return memory
