"""Settings of the tests."""

from __future__ import annotations

from collections.abc import Iterator

import hermetic  # noqa: F401  before anything else is imported
import pytest
from ble_fixtures import world  # noqa: F401  a fixture
from forked import CAN_FORK, ForkServer, Scratch, children_of
from quick_files import quick_files  # noqa: F401  a fixture

from bricksrl import child_process
from bricksrl.envs import registry


@pytest.fixture(autouse=True)
def _registered_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments that a test registers are unknown to the next one."""
    monkeypatch.setattr(registry, "_specs", dict(registry._specs))


@pytest.fixture
def forked_children(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that learn or have a robot are forked, too: those of the test itself, and those of
    the commands that it starts."""
    if CAN_FORK:
        forked: ForkServer = request.getfixturevalue("forked")
        monkeypatch.setattr(child_process, "subprocess", children_of(forked))
        monkeypatch.setattr(forked, "forks_children", True)


@pytest.fixture
def processes(request: pytest.FixtureRequest) -> ForkServer | Scratch:
    """Starts commands and scripts: forked, or from scratch where there is no safe fork."""
    return request.getfixturevalue("forked") if CAN_FORK else Scratch()


@pytest.fixture(scope="session")
def forked() -> Iterator[ForkServer]:
    """A server of processes that have torch, TorchRL and MuJoCo."""
    if not CAN_FORK:
        pytest.skip("Windows and macOS have no safe fork")
    server = ForkServer()
    yield server
    server.close()
