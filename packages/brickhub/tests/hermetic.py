"""Settings of all tests: fixed examples, one thread, no settings or caches of the user."""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import signal
import tempfile
from pathlib import Path

from hypothesis import settings

# Tests leave the user's own settings and caches alone. The workers of one run, and the runs of one
# `make test`, share their cache: what one has built, all have.
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="bricks-settings-")
atexit.register(shutil.rmtree, os.environ["XDG_CONFIG_HOME"], ignore_errors=True)
if "BRICKS_TESTS_CACHE" not in os.environ:
    os.environ["BRICKS_TESTS_CACHE"] = tempfile.mkdtemp(prefix="bricks-cache-")
    atexit.register(shutil.rmtree, os.environ["BRICKS_TESTS_CACHE"], ignore_errors=True)
os.environ["XDG_CACHE_HOME"] = os.environ["BRICKS_TESTS_CACHE"]

# What Matplotlib finds out of the fonts is the same each time, and takes a second; it stays until
# `make clean`.
os.environ["MPLCONFIGDIR"] = str(Path(__file__).parents[3] / "build" / "matplotlib")

# Before torch is imported, and inherited by the commands that tests start: tests share their cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# What tests start buffers its output, as it does for a user.
os.environ.pop("PYTHONUNBUFFERED", None)

# The most that tests leave is freed without a search for cycles.
gc.set_threshold(50_000)

# A shell's background jobs ignore Ctrl-C, and so would all that they start; tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples at every run, and no deadline on a loaded machine;
# `pytest --hypothesis-profile=explore` looks for new ones.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=2000)
settings.load_profile("fixed")
