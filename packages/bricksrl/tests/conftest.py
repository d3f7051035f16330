"""Settings of the tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import hermetic  # noqa: F401  before anything else is imported
import pytest
from ble_fixtures import world  # noqa: F401  a fixture
from forked import CAN_FORK, ForkServer, Scratch, ServerOfOthers, children_of
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
def forked(request: pytest.FixtureRequest) -> Iterator[ForkServer]:
    """A server of processes that have torch, TorchRL and MuJoCo."""
    if not CAN_FORK:
        pytest.skip("Windows and macOS have no safe fork")
    shared = getattr(request.config, "workerinput", {}).get(_SHARED)
    server = ServerOfOthers(shared) if shared else ForkServer()
    yield server
    server.close()


# The processes of one run of pytest-xdist share a server: its imports cost five seconds.
_SHARED = "fork_server"
_server = pytest.StashKey[ForkServer]()


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Start the server with the first process that may need it."""
    if CAN_FORK:
        stash = node.config.stash
        if _server not in stash:
            stash[_server] = ForkServer()
        node.workerinput[_SHARED] = stash[_server].path


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the server with the run."""
    if server := config.stash.get(_server, None):
        server.close()
