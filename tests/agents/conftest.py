"""Settings of the tests of agents."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest
import torch

torch.use_deterministic_algorithms(True, warn_only=True)  # fills memory that nobody wrote with NaN: whoever reads it is found out


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    """The same random numbers in each test at each run."""
    logging.getLogger("torchrl").setLevel(logging.WARNING)  # it tells how large each replay buffer is
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.set_num_threads(1)
        torch.manual_seed(3)
        yield
    torch.set_num_threads(threads)


@pytest.fixture
def double() -> Iterator[None]:
    """Double precision: TorchRL takes log-probabilities of actions after a tanh, where single precision loses digits."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)
