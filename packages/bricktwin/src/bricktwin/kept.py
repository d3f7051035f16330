"""Kept results: what takes long to make, in the user's cache under a digest of all that it is made
of.

A result is made anew when anything of that changes: its sources, a line of our code or tables, the
version of Python or NumPy, or the kind of processor, on which the last digits depend. Where nothing
can be written, it is made each time.
"""

import contextlib
import dataclasses
import enum
import functools
import hashlib
import itertools
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import numpy as np

import brickhub
import bricktwin
from brickhub.files import user_cache, write_durably

_HOUSES = (brickhub, bricktwin)
"""Packages whose code may shape a result; all of it counts, as reading it takes milliseconds."""
_MAX_BYTES = 200_000_000
"""Size of all kept files, about 50 models; those that were not used for longest are removed."""
_MAX_WRITTEN = 32
"""Number of results that one process keeps: one that makes a scene for each episode does not wear
out the disk."""
_TICK_NS = 20_000_000
"""Steps in which file systems count time."""
_written = itertools.count()
_log = logging.getLogger(__name__)
_Made = TypeVar("_Made")


class UnkeptError(Exception):
    """A source that has no digest; what is made of it is not kept."""


def kept(
    sources: Callable[[], Iterable[bytes]],
    make: Callable[[], _Made],
    encode: Callable[[_Made], bytes],
    decode: Callable[[bytes], _Made],
) -> _Made:
    """``make()``, or what an earlier process made of the same sources.

    Args:
        sources: gives all that the result depends on, except our code. It may raise OSError or
            UnkeptError: the result is then made and not kept.
        encode, decode: conversion to bytes and back; ``decode`` raises ValueError for bytes that it
            does not know.
    """
    path = _path(sources)
    data = None if path is None else _read(path)
    if data is not None:
        with contextlib.suppress(ValueError):
            return decode(data)
    made = make()
    if path is not None and next(_written) < _MAX_WRITTEN:
        # A source, or a module that was imported to make the result, may have changed in the
        # meantime. The result would then be kept under the wrong digest.
        _code.cache_clear()
        if path == _path(sources):
            _write(path, encode(made))
    return made


def described(value: object) -> bytes:
    """Text of a value of plain types, enums and dataclasses of ours, equal in each process. Raises
    UnkeptError for others."""
    return json.dumps(value, default=_plain).encode()


def _plain(value: object) -> list[object]:
    """Bytes, an enum or a dataclass of ours, in JSON."""
    if isinstance(value, bytes):
        # Pixels of a picture are megabytes.
        return ["bytes", hashlib.sha256(value).hexdigest()]
    kind = type(value)
    name = f"{kind.__module__}.{kind.__qualname__}"
    # Only our own types are described by name: the digest of our code covers what they mean, but no
    # other package's.
    package, _, _ = kind.__module__.partition(".")
    if package in {house.__name__ for house in _HOUSES}:
        if isinstance(value, enum.Enum):
            return [name, value.name]
        if dataclasses.is_dataclass(value):
            fields = [getattr(value, field.name) for field in dataclasses.fields(value)]
            return [name, *fields]
    raise UnkeptError(f"{value!r:.80} has no digest")


def _path(sources: Callable[[], Iterable[bytes]]) -> Path | None:
    """Path of a result; ``None`` if it cannot be kept."""
    code = _code()
    if code is None:
        return None
    try:
        digest = _digest((code, *sources()))
        return user_cache() / "kept" / digest.hex()
    except (OSError, RuntimeError, UnkeptError) as error:
        # RuntimeError is raised for a user without a home.
        _log.debug("not kept: %s", error)
        return None


@functools.cache
def _code() -> bytes | None:
    """Digest of our code and of what runs it; ``None`` if this process may have loaded other code
    than is in the files."""
    loaded_ns = min(house.LOADED_NS for house in _HOUSES) - _TICK_NS
    runtime = (sys.version, np.__version__, np.show_config(mode="dicts"))
    texts = [repr(runtime).encode()]
    paths: list[Path] = []
    try:
        for house in _HOUSES:
            paths += sorted(Path(house.__path__[0]).rglob("*"))
        for path in paths:
            # Everything counts but what Python itself writes, so there is no list of the files that
            # matter to keep up to date.
            if path.parent.name == "__pycache__" or not path.is_file():
                continue
            # Tools that copy or unpack files set `st_mtime` to that of the original, so `st_ctime`,
            # the last change of any kind, is compared too. (On Windows it is when the file was
            # made.)
            state = path.stat()
            if max(state.st_ctime_ns, state.st_mtime_ns) > loaded_ns:
                return None
            texts += [path.name.encode(), path.read_bytes()]
    except OSError:
        return None
    if len(texts) == 1:
        # Without any file the packages are in a zip, whose members have no paths.
        return None
    return _digest(texts)


def _digest(texts: Iterable[bytes]) -> bytes:
    """SHA-256 of a sequence."""
    digest = hashlib.sha256()
    for text in texts:
        # The length goes in front, because "ab", "c" and "a", "bc" are two sequences.
        digest.update(len(text).to_bytes(8, "big") + text)
    return digest.digest()


def _read(path: Path) -> bytes | None:
    """Content of a file; ``None`` if there is none, or it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    checksum = content[:32]
    data = content[32:]
    if hashlib.sha256(data).digest() != checksum:
        _log.debug("%s is damaged", path)
        return None
    # The time of the file is when it was last used, by which the oldest are removed.
    with contextlib.suppress(OSError):
        os.utime(path)
    return data


def _write(path: Path, data: bytes) -> None:
    """Write a file, and remove the oldest ones if all together are too large."""
    try:
        write_durably(path, hashlib.sha256(data).digest() + data)
        states = {file: file.stat() for file in path.parent.iterdir()}
        left_bytes = sum(state.st_size for state in states.values())
        oldest_first = sorted(states, key=lambda file: states[file].st_mtime_ns)
        for file in oldest_first:
            if left_bytes <= _MAX_BYTES:
                break
            left_bytes -= states[file].st_size
            file.unlink(missing_ok=True)
    except OSError as error:
        # Two processes that remove files at once may end here too.
        _log.debug("not kept: %s", error)
