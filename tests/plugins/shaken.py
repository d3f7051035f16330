"""``pytest --shake SEED``: tests with starts that are a little off. ``--met FILE`` says which tests
that touches, and ``--only FILE`` runs those."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import shaking


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("bricks")
    group.addoption(
        "--shake",
        type=int,
        metavar="SEED",
        help="each body starts 1e-9 off, each first weight is 1e-7 off",
    )
    group.addoption(
        "--only", type=Path, metavar="FILE", help="run only the tests whose names are in a file"
    )
    group.addoption(
        "--met",
        type=Path,
        metavar="FILE",
        help="append the names of the tests that meet something shaken",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Shake, before any test is imported."""
    seed = config.getoption("shake")
    if seed is None:
        return
    os.environ[shaking.SEED] = str(seed)
    shaking._SEED = seed
    if config.getoption("met"):
        number, path = tempfile.mkstemp(prefix="bricks-met-")
        os.close(number)
        os.environ[shaking.MET] = shaking._MET = path
        config.add_cleanup(lambda: Path(path).unlink(missing_ok=True))
        config.pluginmanager.register(_Meetings(Path(path), config.getoption("met")))
    shaking.shake_everything()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is not asked for."""
    path = config.getoption("only")
    if path is not None:
        asked = set(path.read_text(encoding="utf-8").splitlines())
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in asked])
        items[:] = [item for item in items if item.nodeid in asked]


class _Meetings:
    """Record of the tests that meet something shaken, themselves or by a fixture."""

    def __init__(self, said: Path, record: Path) -> None:
        self._said, self._record = said, record
        self._fixtures: set[Any] = set()

    def _size(self) -> int:
        return self._said.stat().st_size

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Note the fixtures that meet it, as later tests share them."""
        before = self._size()
        try:
            return (yield)
        finally:
            if self._size() > before:
                self._fixtures.add(fixturedef)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Note the tests."""
        before = self._size()
        try:
            return (yield)
        finally:
            definitions = getattr(item, "_fixtureinfo").name2fixturedefs.values()  # noqa: B009
            shared = any(one in self._fixtures for several in definitions for one in several)
            if shared or self._size() > before:
                with self._record.open("a", encoding="utf-8") as file:
                    file.write(f"{item.nodeid}\n")
