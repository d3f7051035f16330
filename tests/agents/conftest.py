"""Settings of the tests of agents."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bricksrl.training.reproducible import reproducible


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    """The same random numbers in each test at each run."""
    with reproducible(3):
        yield
