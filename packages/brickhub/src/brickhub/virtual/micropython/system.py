"""Modules ``sys``, ``select``, ``io``, ``json``, ``errno``, ``gc`` and ``micropython`` of a hub."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from greenlet import GreenletExit

from brickhub.errors import SceneError, WriteError
from brickhub.virtual.console import Console
from brickhub.virtual.host_stop import HostStop
from brickhub.virtual.memory import BLOCK_BYTES
from brickhub.virtual.micropython.builtins import cooked
from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.exceptions import ERROR_NAMES, HubOSError, ProgramInterrupt
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.json_text import read_json
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import BytesIO, IOBase, Stream, StringIO, as_bytes, part_of, write_text
from brickhub.virtual.micropython.text import format_traceback, representation, text

_POLLIN, _POLLOUT, _POLLERR, _POLLHUP = 1, 4, 8, 16
_STDIN = 0
_CTRL_C = 3
_ENOENT = 2
_STACK_BYTES = 8 * 1024
_FOREVER_MS = 1000  # polling interval


def is_program_error(error: BaseException) -> bool:
    """Whether the program raised it, not an external stop, a failing scene or a film that cannot be written."""
    if isinstance(error, ProgramInterrupt):
        return True
    return not isinstance(error, HostStop | SceneError | WriteError | KeyboardInterrupt | GreenletExit)


class Keyboard:
    """The byte that interrupts a program; ``kbd_intr(-1)`` disables it."""

    def __init__(self) -> None:
        self.interrupt = _CTRL_C

    def check(self, data: bytes) -> bytes:
        if self.interrupt >= 0 and self.interrupt in data:
            raise ProgramInterrupt
        return data


class FileIO(Stream):
    """Standard input and output as bytes."""

    def __init__(self, number: int, console: Console, keyboard: Keyboard, tick: Callable[[], None]) -> None:
        self._number = number
        self._console = console
        self._keyboard = keyboard
        self._tick = tick

    def __repr__(self) -> str:
        return f"<io.{type(self).__name__} {self._number}>"

    def __enter__(self) -> FileIO:
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def close(self) -> None:
        pass

    def events(self) -> int:
        # Standard output is never ready: programs register standard input without a mask and rely on it.
        return _POLLIN if self._console.available() else 0

    def read(self, size: int = -1) -> Any:
        self._tick()
        return self._take(1 << 20 if size < 0 else size) if size else b""

    def readinto(self, buffer: bytearray, size: int = -1) -> int:
        if not isinstance(buffer, bytearray | memoryview):
            raise TypeError("object with buffer protocol required")
        data = self._take(len(buffer) if size < 0 else min(size, len(buffer)))
        buffer[: len(data)] = data
        return len(data)

    def readline(self, size: int = -1) -> Any:
        line = bytearray()
        while len(line) != size:
            byte = self._take(1)
            line += byte
            if byte == b"\n":
                break
        return bytes(line)

    def _take(self, count: int) -> bytes:
        """Read bytes, and look for the one that interrupts."""
        return self._keyboard.check(self._console.read(count))

    def write(self, data: Any, *part: int) -> int:
        """Write :func:`part_of` a buffer; returns the number of bytes."""
        return self._write(part_of(data, *part))

    def _write(self, data: bytes) -> int:
        self._console.write(data)
        return len(data)


class TextIOWrapper(FileIO):
    """Standard input or output as text; ``buffer`` is the byte stream. The Enter key, CR, is read as LF."""

    def __init__(self, number: int, console: Console, keyboard: Keyboard, tick: Callable[[], None]) -> None:
        super().__init__(number, console, keyboard, tick)
        self.buffer = FileIO(0, console, keyboard, tick)

    def _take(self, count: int) -> bytes:
        if self._number != _STDIN:
            raise HubOSError(errno.EPERM)
        return super()._take(count).replace(b"\r", b"\n")

    def read(self, size: int = -1) -> str:
        """Read a number of characters."""
        self._tick()
        return self._take(1 << 20).decode() if size < 0 else "".join(self._character() for _ in range(size))

    def _character(self) -> str:
        first = self._take(1)
        others = (first >= b"\xc0") + (first >= b"\xe0") + (first >= b"\xf0")
        return (first + self._take(others)).decode()

    def readline(self, size: int = -1) -> str:
        return super().readline(size).decode()  # type: ignore[no-any-return]

    def _write(self, data: bytes) -> int:
        if self._number == _STDIN:
            raise HubOSError(errno.EPERM)
        self._console.write(cooked(data))
        return len(data)


class Poll:
    """``select.poll()``; ``advance`` lets simulated time pass until possible input, and returns the ms that passed."""

    def __init__(self, advance: Callable[[int], int], tick: Callable[[], None]) -> None:
        self._advance, self._tick = advance, tick
        self._streams: dict[int, tuple[FileIO, int]] = {}

    def register(self, stream: Any, eventmask: int = _POLLIN | _POLLOUT) -> None:
        self._streams[id(stream)] = (_pollable(stream), eventmask)

    def unregister(self, stream: Any) -> None:
        self._streams.pop(id(stream), None)

    def modify(self, stream: Any, eventmask: int) -> None:
        if id(stream) not in self._streams:
            raise HubOSError(_ENOENT)
        self._streams[id(stream)] = (stream, eventmask)

    def poll(self, timeout: int = -1, flags: int = 0) -> list[tuple[FileIO, int]]:
        self._tick()
        while not (ready := self._ready()) and timeout:
            if timeout < 0:
                self._advance(_FOREVER_MS)
            else:
                timeout -= self._advance(timeout)
        if flags & 1:
            for stream, _ in ready:
                self.modify(stream, 0)
        return ready

    def ipoll(self, timeout: int = -1, flags: int = 0) -> Iterator[tuple[FileIO, int]]:
        return iter(self.poll(timeout, flags))

    def _ready(self) -> list[tuple[FileIO, int]]:
        ready = []
        for stream, mask in self._streams.values():
            events = stream.events() & mask
            if events:
                ready.append((stream, events))
        return ready


Poll.__name__ = Poll.__qualname__ = "poll"


def _pollable(stream: Any) -> FileIO:
    if not isinstance(stream, FileIO):
        raise HubOSError("stream operation not supported")
    return stream


def sys_module(console: Console, keyboard: Keyboard, tick: Callable[[], None], version: str, machine: str) -> ModuleType:
    stdout = TextIOWrapper(1, console, keyboard, tick)

    def print_exception(error: object, file: Any = stdout) -> None:
        if not isinstance(error, BaseException):
            write_text(file, f"{representation(error)}\n")
            return
        write_text(file, format_traceback(error, ""))

    return module(
        "sys",
        {
            "stdin": TextIOWrapper(0, console, keyboard, tick),
            "stdout": stdout,
            "stderr": TextIOWrapper(2, console, keyboard, tick),
            "path": ["", ".frozen"],
            "argv": [],
            "version": f"3.4.0; Pybricks MicroPython v{version}",
            "version_info": (3, 4, 0),
            "implementation": ("micropython", (1, 26, 0, ""), machine, 0x2306),
            "byteorder": "little",
            "print_exception": print_exception,
        },
    )


def select_module(advance: Callable[[int], int], tick: Callable[[], None]) -> ModuleType:
    flags = {"POLLIN": _POLLIN, "POLLOUT": _POLLOUT, "POLLERR": _POLLERR, "POLLHUP": _POLLHUP}

    def select(readers: Any, writers: Any, others: Any, timeout: float | None = None, /) -> tuple[list[FileIO], ...]:
        """Streams that can be read, be written, or failed; ``timeout`` in seconds."""
        poll, masks = Poll(advance, tick), (_POLLIN, _POLLOUT, _POLLERR | _POLLHUP)
        masks_by_stream: dict[FileIO, int] = {}
        for streams, mask in zip((readers, writers, others), masks, strict=True):
            if not isinstance(streams, list | tuple):
                raise TypeError(f"object '{type(streams).__name__}' isn't a tuple or list")
            for stream in map(_pollable, streams):
                masks_by_stream[stream] = masks_by_stream.get(stream, 0) | mask
        for stream, mask in masks_by_stream.items():
            poll.register(stream, mask)
        ready = poll.poll(-1 if timeout is None or timeout < 0 else int(to_single(timeout * 1000)))
        return tuple([stream for stream, events in ready if events & mask] for mask in masks)

    return module("select", {"poll": lambda: Poll(advance, tick), "select": select, **flags})


def micropython_module(keyboard: Keyboard, console: Console, memory: Callable[[], tuple[int, int]]) -> ModuleType:
    """``memory`` returns the bytes in use and the free ones."""
    state = {"level": 0, "locks": 0}

    def kbd_intr(character: int) -> None:
        keyboard.interrupt = character

    def opt_level(level: int | None = None) -> int | None:
        if level is None:
            return state["level"]
        state["level"] = level
        return None

    def heap_lock() -> None:
        state["locks"] += 1

    def heap_unlock() -> int:
        state["locks"] = max(0, state["locks"] - 1)
        return state["locks"]

    def mem_info(verbose: Any = None) -> None:
        used_bytes, free_bytes = memory()
        lines = (
            f"stack: 0 out of {_STACK_BYTES}",
            f"GC: total: {used_bytes + free_bytes}, used: {used_bytes}, free: {free_bytes}",
            f" No. of 1-blocks: 0, 2-blocks: 0, max blk sz: 0, max free sz: {free_bytes // BLOCK_BYTES}",
        )
        console.write(cooked("".join(f"{line}\n" for line in lines).encode()))

    def qstr_info(verbose: Any = None) -> None:
        console.write(cooked(b"qstr pool: n_pool=0, n_qstr=0, n_str_data_bytes=0, n_total_bytes=0\n"))

    names: dict[str, Any] = {
        "mem_info": mem_info,
        "qstr_info": qstr_info,
        "const": lambda value: value,
        "kbd_intr": kbd_intr,
        "opt_level": opt_level,
    }
    return module("micropython", {**names, "heap_lock": heap_lock, "heap_unlock": heap_unlock, "stack_use": lambda: 0})


def gc_module(memory: Callable[[], tuple[int, int]]) -> ModuleType:
    state = {"on": True}
    limit = [-1]

    def threshold(*size: int) -> int | None:
        if not size:
            return limit[0]
        limit[:] = size
        return None

    def switch(on: bool) -> Callable[[], None]:
        def call() -> None:
            state["on"] = on

        return call

    names: dict[str, Any] = {"enable": switch(True), "disable": switch(False), "isenabled": lambda: state["on"]}
    names["threshold"] = threshold
    return module("gc", {**names, "collect": lambda: None, "mem_alloc": lambda: memory()[0], "mem_free": lambda: memory()[1]})


def errno_module() -> ModuleType:
    return module("errno", {**{name: code for code, name in ERROR_NAMES.items()}, "errorcode": HubDict.in_order(ERROR_NAMES)})


def io_module() -> ModuleType:
    return module("io", {"BytesIO": BytesIO, "IOBase": IOBase, "StringIO": StringIO})


def json_module() -> ModuleType:
    def dumps(value: Any, /, *, separators: tuple[str, str] | None = None) -> str:
        item, key = separators or (", ", ": ")

        def write(value: Any) -> str:
            if isinstance(value, dict):
                return "{" + item.join(write_key(k) + key + write(v) for k, v in value.items()) + "}"
            if isinstance(value, list | tuple):
                return "[" + item.join(map(write, value)) + "]"
            if value is None or isinstance(value, bool):
                return json.dumps(value)
            if isinstance(value, bytes):
                value = value.decode()
            return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else text(value)

        def write_key(name: Any) -> str:
            return write(name) if isinstance(name, str) else f'"{write(name)}"'

        return write(value)

    def loads(source: str | bytes, /) -> Any:
        return read_json(source if isinstance(source, str) else as_bytes(source).decode())

    def dump(value: Any, stream: Any, /, *, separators: tuple[str, str] | None = None) -> None:
        write_text(stream, dumps(value, separators=separators))

    return module("json", {"dumps": dumps, "loads": loads, "dump": dump, "load": lambda stream: loads(stream.read())})
