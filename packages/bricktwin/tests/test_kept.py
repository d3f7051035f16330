"""Results that are kept in the user's cache."""

from __future__ import annotations

import functools
import itertools
import logging
import os
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import HubKind, Mount
from bricktwin import kept
from bricktwin.robots import WALKER
from bricktwin.twin.arena import Place
from bricktwin.twin.scene import Scene


@dataclass
class Cache:
    """A cache of the test's own, and how many results were made."""

    folder: Path
    made: int = 0

    def get(self, *sources: bytes) -> bytes:
        """What is made of these sources."""

        def make() -> bytes:
            self.made += 1
            return b"made of " + b", ".join(sources)

        return kept.kept(lambda: sources, make, bytes, bytes)

    @property
    def files(self) -> list[Path]:
        return list((self.folder / "bricksrl" / "kept").glob("*"))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cache:
    cache = Cache(tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache.folder))
    monkeypatch.setattr(kept, "_code", functools.cache(lambda: b"code"))
    monkeypatch.setattr(kept, "_written", itertools.count())
    return cache


def test_equal_sources_are_made_once(cache: Cache) -> None:
    for _ in range(2):
        assert cache.get(b"ab", b"c") == b"made of ab, c"
        assert cache.get(b"a", b"bc") == b"made of a, bc"
    assert cache.made == 2


@pytest.mark.parametrize(
    "damaged",
    [
        lambda data: data[: len(data) // 2],
        lambda data: data[:20],
        lambda _: b"",
        lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
    ],
    ids=["cut", "short", "empty", "flipped"],
)
def test_damaged_file_is_made_anew(damaged: Callable[[bytes], bytes], cache: Cache) -> None:
    cache.get(b"a source")
    (path,) = cache.files
    path.write_bytes(damaged(path.read_bytes()))
    for _ in range(2):
        assert cache.get(b"a source") == b"made of a source"
    assert cache.made == 2, "the file is whole again"


@pytest.mark.parametrize("home", ["file", "read-only", "none"])
def test_without_a_cache_all_is_made(
    home: str, cache: Cache, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(error: Exception) -> None:
        raise error

    if home == "none":
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setattr(Path, "home", lambda: fail(RuntimeError("no home")))
    elif home == "file":
        monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    else:
        read_only = OSError(30, "read-only")
        monkeypatch.setattr("brickhub.files.temporary_beside", lambda *_: fail(read_only))
    with caplog.at_level(logging.INFO):
        assert cache.get(b"a") == cache.get(b"a")
    assert cache.made == 2 and not caplog.records and not cache.files


def test_cache_is_bounded_and_the_oldest_goes(
    cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    for source in (b"a", b"b"):
        cache.get(source)
        time.sleep(0.02)
    monkeypatch.setattr(kept, "_MAX_BYTES", int(2.5 * cache.files[0].stat().st_size))
    cache.get(b"a")  # used later than b
    time.sleep(0.02)
    cache.get(b"c")
    assert cache.made == 3 and len(cache.files) == 2
    cache.get(b"a")
    assert cache.made == 3
    cache.get(b"b")
    assert cache.made == 4


def test_one_process_keeps_few_results(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "_MAX_WRITTEN", 2)
    for number in range(4):
        cache.get(bytes([number]))
    assert len(cache.files) == 2


@pytest.mark.parametrize("error", [OSError("gone"), kept.UnkeptError("a function")])
def test_what_has_no_digest_is_not_kept(error: Exception, cache: Cache) -> None:
    def sources() -> list[bytes]:
        raise error

    assert kept.kept(sources, lambda: b"made", bytes, bytes) == b"made"
    assert not cache.files


def test_source_that_changes_while_it_is_read_is_not_kept(cache: Cache, tmp_path: Path) -> None:
    source = tmp_path / "source"

    def make() -> bytes:
        source.write_bytes(b"new")
        return b"made of old or new"

    source.write_bytes(b"old")
    kept.kept(lambda: [source.read_bytes()], make, bytes, bytes)
    assert not cache.files


class TestCode:
    """Code of a package of two modules and a table."""

    NAMES = ("__init__.py", "room/module.py", "room/table.csv", "room/picture.bin")

    @pytest.fixture
    def house(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> Iterator[types.SimpleNamespace]:
        folder = tmp_path / "house"
        for name in self.NAMES:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("1")
        house = types.SimpleNamespace(__path__=[str(folder)], LOADED_NS=time.time_ns() + 10**12)
        monkeypatch.setattr(kept, "_HOUSES", (house,))
        kept._code.cache_clear()
        yield house
        kept._code.cache_clear()

    def digest(self) -> bytes | None:
        """As in another process."""
        kept._code.cache_clear()
        return kept._code()

    @pytest.mark.parametrize("name", NAMES)
    def test_every_file_counts(self, house: types.SimpleNamespace, name: str) -> None:
        path = Path(house.__path__[0], name)
        first = self.digest()
        assert first is not None
        path.write_text("2")
        assert self.digest() not in (first, None)
        path.write_text("1")
        compiled = path.parent / "__pycache__" / "module.pyc"
        compiled.parent.mkdir()
        compiled.touch()
        assert self.digest() == first, "what Python compiles does not count"
        path.rename(path.with_stem("other"))
        assert self.digest() not in (first, None)

    @pytest.mark.parametrize("place", ["sys.version", "numpy.__version__", "numpy.show_config"])
    def test_what_runs_it_counts(
        self, house: types.SimpleNamespace, place: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first = self.digest()
        other = (lambda mode: {}) if place == "numpy.show_config" else "9.9"
        monkeypatch.setattr(place, other)
        assert self.digest() not in (first, None)

    def test_code_that_is_newer_than_the_process_has_no_digest(
        self, house: types.SimpleNamespace
    ) -> None:
        path = Path(house.__path__[0], "room", "module.py")
        later_ns = house.LOADED_NS + 1
        os.utime(path, ns=(later_ns, later_ns))
        assert self.digest() is None, "by its content's time, which Windows has only"
        os.utime(path, ns=(0, 0))
        assert self.digest() is not None
        house.LOADED_NS = path.stat().st_ctime_ns - 1
        assert self.digest() is None, "by the time of any change, though its content's is old"

    def test_code_that_changes_before_it_is_imported_is_not_kept(
        self, house: types.SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

        def make() -> bytes:
            Path(house.__path__[0], "room", "module.py").write_text("2")
            return b"made of new code"

        kept.kept(list, make, bytes, bytes)
        assert not (tmp_path / "cache").exists()


@dataclass(frozen=True)
class Foreign:
    """A user's class."""

    value: float = 1.0


def test_descriptions_of_values() -> None:
    values = [
        *(1, 1.0, True, "1", None, (), (1,), ((1,),), {"a": 1}, -0.0, 0.0),
        *(HubKind.PRIME, HubKind.CITY, WALKER, Place(), Mount((1, 2, 3))),
    ]
    texts = [kept.described(value) for value in values]
    assert len(set(texts)) == len(values)
    assert kept.described([1.5, "a"]) == kept.described((np.float64(1.5), "a"))
    unknown = [Foreign(), len, {"light": len}, np.int64(1), Scene(readings={"light": lambda _: 1})]
    for value in unknown:
        with pytest.raises(kept.UnkeptError):
            kept.described(value)
