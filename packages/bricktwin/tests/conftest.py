"""Settings of the tests."""

from __future__ import annotations

import hermetic  # noqa: F401  before anything else is imported
import pytest
from ble_fixtures import world  # noqa: F401  a fixture

from bricktwin import target

# Its asserts are those of tests, and say as much.
pytest.register_assert_rewrite("on_a_body")


@pytest.fixture(autouse=True)
def _without_bricksrl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands know the names of this house, whatever else is installed."""
    monkeypatch.setattr("brickhub.target._finder", lambda: target.find)
