"""Action chunks: the actions of several steps, predicted at once and carried out one a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.transforms import ActionChunkTransform
from torchrl.objectives import LossModule

from bricksrl.agents.encoder import encoder_keys
from bricksrl.agents.learner import Learner, adam
from bricksrl.agents.operators import acting_copy
from bricksrl.agents.replay import TransitionReplayBuffer
from bricksrl.agents.settings import NotNegative, Positive, Range, Settings
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ChunkSettings(Settings):
    """Settings of policies that predict chunks of actions; they learn from a dataset and from nothing else."""

    updates_per_step: Annotated[float, Positive] = 2.0
    """Updates for each robot step."""
    chunk: Annotated[int, Range(1, 1000)] = 8
    """Actions that are predicted at once, one a step."""
    executed: Annotated[int, Range(1, 1000)] = 1
    """Steps after which the next chunk is predicted."""
    ensemble: Annotated[float | None, NotNegative] = 0.01
    """Chunks that overlap are averaged, the older ones with the more weight the larger this is; none takes the newest."""
    weight_decay: Annotated[float, NotNegative] = 1e-4
    """Share of the weights, times the step size, that each step takes off them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executed > self.chunk:
            raise DescriptionError(f"executed is {self.executed}; a chunk has only {self.chunk} actions")


class ActionChunkBuffer:
    """Chunks ``[*batch, k, m]`` of actions under way, one a step, a new one after every ``executed`` steps.

    Args:
        executed: from 1 to ``k``.
        ensemble: chunks that overlap are averaged with the weights exp(-ensemble * i), where i counts from the oldest (the
            temporal ensemble of Zhao et al., 2023); ``None`` takes the newest alone.
    """

    def __init__(self, executed: int, ensemble: float | None) -> None:
        self._executed, self._ensemble = executed, ensemble
        self._step = 0
        self._chunks: list[tuple[int, Tensor]] = []

    def clear(self) -> None:
        """Start anew: nothing that was predicted is done."""
        self._step = 0
        self._chunks.clear()

    def next(self, predict: Callable[[], Tensor]) -> Tensor:
        """The action ``[*batch, m]`` of this step; ``predict`` gives a new chunk and is called where one is due."""
        if self._step % self._executed == 0:
            self._chunks.append((self._step, predict()))
        if self._ensemble is None:
            del self._chunks[:-1]
        self._chunks = [(start, chunk) for start, chunk in self._chunks if start + chunk.shape[-2] > self._step]
        due = torch.stack([chunk[..., self._step - start, :] for start, chunk in self._chunks], -1)
        self._step += 1
        weights = torch.softmax(-(self._ensemble or 0.0) * torch.arange(due.shape[-1], dtype=due.dtype, device=due.device), 0)
        return due @ weights


class ChunkPolicy(TensorDictModuleBase):  # type: ignore[misc]
    """A policy that acts by chunks; whoever starts an episode, or gives the robot back to it, calls `reset`.

    Args:
        encoder: what is observed to features.
        network: features ``[*batch, f]`` to a chunk ``[*batch, k, m]``.
    """

    def __init__(self, encoder: nn.Module, network: nn.Module, settings: ChunkSettings) -> None:
        super().__init__()
        self.in_keys, self.out_keys = encoder_keys(encoder), ["action"]
        self.encoder, self.network = encoder, network
        self._chunks = ActionChunkBuffer(settings.executed, settings.ensemble)

    def reset(self) -> None:
        """What is observed next does not follow from the last action."""
        self._chunks.clear()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        inputs = [tensordict[key] for key in self.in_keys]
        action = self._chunks.next(lambda: self.network(self.encoder(*inputs)))
        return tensordict.set("action", action.clamp(-1.0, 1.0))


def chunk_learner(policy: ChunkPolicy, loss: LossModule, settings: ChunkSettings, **numbers: Any) -> Learner:
    """The learner of a policy by chunks: it imitates a dataset, and acts without dropout."""
    acting = acting_copy(policy)
    optimizer = adam(loss.parameters(), settings, settings.weight_decay)
    numbers |= {"updates_per_step": settings.updates_per_step, "chunk": settings.chunk, "reset_policy": acting.reset}
    return Learner(acting, loss, optimizer, imitates=True, **numbers)


def recorded_memory(
    frames: TensorDictBase, batch_size: int, keys: Sequence[str], *, chunk: int = 0, device: torch.device | str = "cpu"
) -> TransitionReplayBuffer:
    """A memory of recorded frames ``[time]``; with ``chunk`` the action of each is the next so many, ``[chunk, m]``, the last one
    of an episode repeated beyond its end."""
    if chunk:
        rows = ActionChunkTransform(chunk, chunk_key="chunk")(frames.select("action", ("next", "done"))[None])
        frames = frames.clone(recurse=False).set("action", rows["chunk"][0])
    memory = TransitionReplayBuffer(max(2, len(frames)), batch_size, keys, device=device)
    memory.extend(frames)
    return memory
