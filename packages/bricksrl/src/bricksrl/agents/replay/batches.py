"""Batches of transitions for several updates, drawn at once, which is faster."""

from collections.abc import Iterator, Sequence

import torch
from tensordict import TensorDictBase

from bricksrl.agents.replay.buffer import TransitionReplayBuffer

MAX_ROWS = 8192
"""Maximum number of transitions drawn at once for several updates."""

Share = tuple[TransitionReplayBuffer, int]
"""A buffer, and the number of rows of each batch that it gives."""


def batches_of(shares: Sequence[Share], count: int) -> Iterator[TensorDictBase]:
    """``count`` batches, several at a time as rows ``[n, batch]``, each of the shares."""
    size = sum(rows for _, rows in shares)
    at_once = max(1, MAX_ROWS // size)
    for start in range(0, count, at_once):
        n = min(at_once, count - start)
        parts = []
        for buffer, rows in shares:
            drawn = buffer.sample(n * rows, batches=n)
            parts.append(drawn.view(n, rows))
        yield parts[0] if len(parts) == 1 else torch.cat(parts, 1)
