"""Fixtures of agent tests."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest
import torch

# fills memory that nobody wrote with NaN: whoever reads it is found out
torch.use_deterministic_algorithms(True, warn_only=True)


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    """Seed torch's generator."""
    # it tells how large each replay buffer is
    logging.getLogger("torchrl").setLevel(logging.WARNING)
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.set_num_threads(1)
        torch.manual_seed(3)
        yield
    torch.set_num_threads(threads)


@pytest.fixture
def double() -> Iterator[None]:
    """Double precision, as TorchRL's log-probabilities after a tanh lose digits in single
    precision."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)
