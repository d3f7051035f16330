"""The conditions under which equal seeds give equal runs."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """One thread and a freshly seeded global generator inside; outside, both are as they were. TorchRL's log is kept short.

    One thread because sums split over threads round differently on another number of cores; the networks are small enough that
    more threads would hardly be faster.
    """
    threads = torch.get_num_threads()
    logger = logging.getLogger("torchrl")
    level = logger.level
    with torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        logger.setLevel(logging.WARNING)  # it tells how large each replay buffer is
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            logger.setLevel(level)
