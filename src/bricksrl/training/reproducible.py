"""Seeds, and the conditions under which equal seeds give equal runs."""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Iterator

import torch


def derive_seed(seed: int, purpose: str, index: int = 0) -> int:
    """A seed in 0..2**31-1 of its own for each purpose and index, as if drawn anew."""
    digest = hashlib.sha256(f"{seed}/{purpose}/{index}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1


@contextlib.contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """One thread and a freshly seeded global generator inside; outside, both are as they were. TorchRL's log is kept short.

    One thread because sums split over threads round differently on another number of cores; the networks are small enough that
    more threads would hardly be faster.
    """
    threads = torch.get_num_threads()
    logger = logging.getLogger("torchrl")
    level = logger.level
    with torch.random.fork_rng(devices=[]):
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        logger.setLevel(logging.WARNING)  # it tells how large each replay buffer is
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            logger.setLevel(level)
