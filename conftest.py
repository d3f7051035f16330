"""Options of the tests of the whole workspace."""

from __future__ import annotations

import gc

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
