"""Options of the tests of the whole workspace."""

from __future__ import annotations

pytest_plugins = ["cpu_times", "shaken", "skipped"]
