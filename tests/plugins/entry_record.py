"""``pytest -p entry_record``: the functions that each test enters, in a folder that the environment
names.

A line of JSON a test that passes says its name, its CPU time, its file of numbers, and those of the
fixtures that it shares.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import entered
import pytest
from byte_code import HOUSES

_folder = Path(os.environ[entered.FOLDER])
_shared: dict[Any, str] = {}
"""File of each fixture that several tests have."""
_last_file: list[Path] = []
_not_passed: set[str] = set()

os.environ[entered.FILE] = str(_folder / "import")


def _cpu_s() -> float:
    from cpu_times import children_s

    return time.process_time() + children_s(os.getpid())


@contextmanager
def _noted_in(name: str) -> Iterator[None]:
    """Note what is entered in this file, then go on with the one before."""
    seen, path = bytes(entered.seen), os.environ[entered.FILE]
    entered.forget()
    os.environ[entered.FILE] = str(_folder / name)
    try:
        yield
    finally:
        os.environ[entered.FILE] = path
        entered.seen[:] = seen


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[Any]:
    """What a shared fixture enters counts for all its tests."""
    if fixturedef.scope == "function":
        return (yield)
    name = _shared.setdefault(fixturedef, f"fixture-{len(_shared)}")
    with _noted_in(name):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[Any]:
    """One test."""
    if _last_file != [item.path]:
        _last_file[:] = [item.path]
        _clear_caches()
    number = getattr(pytest_runtest_protocol, "count", 0)
    pytest_runtest_protocol.count = number + 1  # type: ignore[attr-defined]
    begin_s = _cpu_s()
    with _noted_in(f"test-{number}"):
        result = yield
    if item.nodeid in _not_passed:
        return result
    definitions = getattr(item, "_fixtureinfo").name2fixturedefs.values()  # noqa: B009
    shared = [_shared[one] for several in definitions for one in several if one in _shared]
    line = {
        "test": item.nodeid,
        "seconds": round(_cpu_s() - begin_s, 3),
        "files": [f"test-{number}", *shared],
    }
    with (_folder / "tests").open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note what fails or is skipped here: it can find nothing."""
    if report.outcome != "passed":
        _not_passed.add(report.nodeid)


def _clear_caches() -> None:
    """Let each file of tests enter what is cached, not the first that needs it alone."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in HOUSES:
            for one in list(vars(module).values()):
                if isinstance(one, functools._lru_cache_wrapper):
                    one.cache_clear()
