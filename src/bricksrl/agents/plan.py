"""What an agent has in mind that predicts several actions at once: chunks under way, and which action is due now."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor


class Plan:
    """Chunks ``[*batch, k, m]`` of actions, one a step, a new one after every ``executed`` steps.

    Args:
        executed: from 1 to ``k``.
        ensemble: chunks that overlap are averaged with the weights exp(-ensemble * i), where i counts from the oldest (the
            temporal ensemble of Zhao et al. 2023); ``None`` takes the newest alone.
    """

    def __init__(self, executed: int, ensemble: float | None) -> None:
        self._executed, self._ensemble = executed, ensemble
        self._step = 0
        self._chunks: list[tuple[int, Tensor]] = []

    def forget(self) -> None:
        """Start anew: nothing that was planned is done."""
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
        weights = torch.softmax(-(self._ensemble or 0.0) * torch.arange(due.shape[-1], dtype=due.dtype), 0)
        return due @ weights
