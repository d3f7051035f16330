"""Repeatable conditions of a run: one thread and a seeded generator."""

import contextlib
from collections.abc import Iterator

import torch

from bricksrl.quiet import without_torchrl_notes


@contextlib.contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """One thread and a seeded global generator inside; both are restored afterwards. Also silences
    TorchRL's log. Sums over several threads are rounded differently for each number of cores; small
    networks hardly gain from threads."""
    threads = torch.get_num_threads()
    # Devices have random generators of their own.
    devices = range(torch.cuda.device_count())
    with torch.random.fork_rng(devices=devices), without_torchrl_notes():
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
