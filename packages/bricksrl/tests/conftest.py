"""Settings of the tests."""

from __future__ import annotations

from collections.abc import Iterator

import hermetic  # noqa: F401  before anything else is imported
import pytest
from ble_fixtures import world  # noqa: F401  a fixture
from forked import ForkServer

from bricksrl.envs import registry


@pytest.fixture(autouse=True)
def _registered_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments that a test registers are unknown to the next one."""
    monkeypatch.setattr(registry, "_specs", dict(registry._specs))


@pytest.fixture(scope="session")
def forked() -> Iterator[ForkServer]:
    """A server of processes that have torch, TorchRL and MuJoCo."""
    server = ForkServer()
    yield server
    server.close()
