"""Settings of the tests."""

from __future__ import annotations

import hermetic  # noqa: F401  before anything else is imported
import pytest
from ble_fixtures import world  # noqa: F401  a fixture

from bricksrl.envs import registry


@pytest.fixture(autouse=True)
def _registered_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments that a test registers are unknown to the next one."""
    monkeypatch.setattr(registry, "_specs", dict(registry._specs))
