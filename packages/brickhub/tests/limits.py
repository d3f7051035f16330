"""Tables of limits: what makes a value, values that are taken, and values that are refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

Limit = tuple[Callable[[Any], object], Iterable[Any], Iterable[Any]]


def assert_kept(limit: Limit, error: type[Exception]) -> None:
    """All that is within is taken, and all beyond is refused in one line."""
    make, taken, refused = limit
    for value in taken:
        make(value)
    for value in refused:
        with pytest.raises(error) as caught:
            make(value)
        assert "\n" not in str(caught.value), value
