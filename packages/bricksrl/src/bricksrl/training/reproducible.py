"""Repeatable conditions of a run: one thread and a seeded generator."""

import contextlib
import logging
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """One thread and a seeded global generator inside; both are restored afterwards. Also silences
    TorchRL's log. Sums over several threads are rounded differently for each number of cores; small
    networks hardly gain from threads."""
    threads = torch.get_num_threads()
    logger = logging.getLogger("torchrl")
    level = logger.level
    # Devices have random generators of their own.
    with torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        # TorchRL logs the size of each replay buffer.
        logger.setLevel(logging.WARNING)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            logger.setLevel(level)
