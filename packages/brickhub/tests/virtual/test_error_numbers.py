"""Error numbers of a hub, which are those of Linux."""

from __future__ import annotations

import errno
import sys

import pytest

from brickhub.virtual import error_numbers

NAMES = [name for name in vars(error_numbers) if name.startswith("E")]


def test_every_number_has_a_name() -> None:
    assert len(NAMES) >= 10 and all(hasattr(errno, name) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_those_of_linux(name: str) -> None:
    # Python knows those of the system that it runs on, and only Linux has a hub's.
    if sys.platform == "linux":
        assert getattr(error_numbers, name) == getattr(errno, name)
