"""Options of the tests of the whole workspace."""

from __future__ import annotations

import gc
import socket

import pytest

pytest_plugins = ["cpu_times", "shaken", "skipped"]

# What torch and TorchRL define stays; looking through it again and again is a quarter of the time
# of their import, and once more seconds of the tests.
gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Look for garbage again, but not among what was imported."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-rerunfailures send at once."""
    # A process of tests writes twice to it and then waits for an answer. The second write waits
    # for the first to be confirmed, which the system puts off by 40 ms: at each test.
    connection = getattr(getattr(config, "failures_db", None), "sock", None)
    if connection is not None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
