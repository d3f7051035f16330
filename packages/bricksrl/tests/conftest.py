"""Settings of all tests: fixed examples, one thread."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import tempfile

os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="bricksrl-settings-")  # tests leave the user's own settings alone
if "PYTEST_XDIST_WORKER" not in os.environ:  # workers share the cache of the session, which begins empty
    os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="bricksrl-cache-")
    atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)

# Before torch is imported, and inherited by the commands that tests start: tests share their cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A shell's background jobs ignore Ctrl-C, and so would all that they start; tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import pytest
from hypothesis import settings

from bricksrl.envs import registry

atexit.register(shutil.rmtree, os.environ["XDG_CONFIG_HOME"], ignore_errors=True)

# The same examples at every run, and no deadline on a loaded machine;
# `pytest --hypothesis-profile=explore` looks for new ones.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=2000)
settings.load_profile("fixed")


@pytest.fixture(autouse=True)
def _registered_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments that a test registers are unknown to the next one."""
    monkeypatch.setattr(registry, "_specs", dict(registry._specs))
