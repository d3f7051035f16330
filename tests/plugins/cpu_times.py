"""``pytest --cpu-times FILE``: CPU time of each test, with all processes that it starts, as lines
of JSON."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

_TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    group = parser.getgroup("bricks")
    group.addoption(
        "--cpu-times",
        type=Path,
        metavar="FILE",
        help="append the CPU time of each test, as lines of JSON (Linux)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Measure, if that is asked for."""
    path = config.getoption("cpu_times")
    # With several processes, their times are what the first of them would count as its own.
    has_workers = bool(config.getoption("numprocesses", None))
    if path is not None and not has_workers:
        config.pluginmanager.register(_CpuTimes(path))


class _CpuTimes:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._last_s = 0.0

    def _say(self, name: str) -> None:
        """CPU time since the last line is that of ``name``."""
        now_s = time.process_time() + children_s(os.getpid())
        with self._path.open("a", encoding="utf-8") as file:
            file.write(
                json.dumps(
                    {"test": name, "cpu_s": round(now_s - self._last_s, 3), "process": os.getpid()}
                )
                + "\n"
            )
        self._last_s = now_s

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Imports and collection."""
        self._say("collection")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """One test, with the fixtures that it was the first to need."""
        try:
            return (yield)
        finally:
            self._say(item.nodeid)

    def pytest_unconfigure(self, config: pytest.Config) -> None:
        """What is left."""
        self._say("end")


def children_s(pid: int) -> float:
    """CPU time of all processes below one, living or waited for."""
    waited = os.times()
    total_s = waited.children_user + waited.children_system
    below = _children(pid)
    while below:
        child = below.pop()
        try:
            fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        total_s += sum(map(int, fields[11:15])) / _TICKS
        below += _children(child)
    return total_s


def _children(pid: int) -> list[int]:
    found: list[int] = []
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (thread / "children").read_text().split())
    except OSError:
        pass
    return found
