"""Settings of all tests: fixed examples, one thread."""

from __future__ import annotations

import os

# Before torch is imported, and inherited by the commands that tests start: tests share their cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from hypothesis import settings

# The same examples at every run, and no deadline on a loaded machine;
# `pytest --hypothesis-profile=explore` looks for new ones.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=2000)
settings.load_profile("fixed")
