"""Modules ``sys``, ``select``, ``io``, ``json``, ``errno``, ``gc`` and ``micropython`` of a hub.

JSON is read as in ``extmod/modjson.c`` of MicroPython 1.26: commas and colons are spaces, any
bracket closes.
"""

import json
import re
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.builtins import cooked
from brickhub.virtual.micropython.containers import FixedDict, HubDict
from brickhub.virtual.micropython.exceptions import ERROR_NAMES, HubOSError, ProgramInterrupt
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.memory import BLOCK_BYTES
from brickhub.virtual.micropython.numbers import expect_int, module
from brickhub.virtual.micropython.operators import to_float, to_int
from brickhub.virtual.micropython.streams import Console, Stream, as_bytes, part_of, write_text
from brickhub.virtual.micropython.text import format_traceback, representation, text

_TOKEN = re.compile(
    r"""[,:\ \t\n\r]*(?:
        (?P<word>null|false|true)
      | "(?P<text>(?:[^"\\]|\\.)*)"
      | (?P<number>[-0-9][-+.eE0-9]*)
      | (?P<open>[\[{])
      | (?P<close>[\]}])
    )""",
    re.VERBOSE | re.DOTALL,
)
_WORDS = {"null": None, "false": False, "true": True}
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t"}
_SPACES = " \t\n\r\v\f"
_NO_KEY = object()
_SYNTAX_ERROR = "syntax error in JSON"
# Programs compare with the numbers of `py/stream.h`.
_POLLIN = 1
_POLLOUT = 4
_POLLERR = 8
_POLLHUP = 16
_STDIN = 0
_CTRL_C = 3
_STACK_BYTES = 8 * 1024
_ENDLESS_BYTES = 1 << 20
"""Size of an endless read, which is more than anybody types."""
_FOREVER_MS = 1000
"""Simulated time between two looks for input where there is no timeout."""


def read_json(source: str) -> Any:
    """Parse JSON. Raises ValueError as on the hub, OverflowError if a number needs more than 31
    bits."""
    # A hub does not recurse here, so the containers around the innermost one wait in a list.
    parents: list[Any] = []
    top: Any = None
    key: Any = _NO_KEY
    position = 0
    while True:
        token = _TOKEN.match(source, position)
        if token is None or (token["close"] and top is None):
            raise ValueError(_SYNTAX_ERROR)
        position = token.end()
        if token["close"]:
            if not parents:
                break
            top = parents.pop()
            continue
        value = _value(token)
        opens = token["open"] is not None
        if isinstance(top, list):
            top.append(value)
        elif top is not None and key is not _NO_KEY:
            top[key] = value
            key = _NO_KEY
        elif top is not None:
            # A key may be anything but a container.
            if opens:
                raise ValueError(_SYNTAX_ERROR)
            key = value
        if opens:
            if top is not None:
                parents.append(top)
            top = value
        elif top is None:
            top = value
            break
    if source[position:].strip(_SPACES):
        raise ValueError(_SYNTAX_ERROR)
    return top


def _value(token: re.Match[str]) -> Any:
    if token["open"]:
        return [] if token["open"] == "[" else HubDict()
    if token["word"]:
        return _WORDS[token["word"]]
    number = token["number"]
    if number is None:
        return re.sub(
            r"\\(u.{4}|.)",
            _unescaped,
            token["text"],
            flags=re.DOTALL,
        )
    is_float = re.search("[.eE]", number)
    return to_float(number) if is_float else to_int(number, 10)


def _unescaped(escape: re.Match[str]) -> str:
    text = escape[1]
    if len(text) == 1:
        return _ESCAPES.get(text, text)
    try:
        return chr(int(text[1:], 16))
    except ValueError:
        raise ValueError(_SYNTAX_ERROR) from None


class Terminal:
    """Standard streams of a program: its console, what is called before it reads, and the byte that
    interrupts it.

    ``kbd_intr(-1)`` lets no byte interrupt.
    """

    def __init__(
        self,
        console: Console,
        tick: Callable[[], None],
    ) -> None:
        self.console = console
        self.tick = tick
        self.interrupt = _CTRL_C

    def read(self, count: int) -> bytes:
        """Bytes of the console. Raises ProgramInterrupt if one interrupts."""
        data = self.console.read(count)
        if self.interrupt >= 0 and self.interrupt in data:
            raise ProgramInterrupt
        return data


class FileIO(Stream):
    """Standard input and output as bytes."""

    def __init__(
        self,
        number: int,
        terminal: Terminal,
    ) -> None:
        self._number = number
        self._terminal = terminal

    def __repr__(self) -> str:
        return f"<io.{type(self).__name__} {self._number}>"

    def __enter__(self) -> "FileIO":
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def close(self) -> None:
        pass

    def events(self) -> int:
        # Standard output is never ready, because programs register standard input without a mask
        # and rely on that.
        return _POLLIN if self._terminal.console.available() else 0

    def read(self, size: int = -1) -> Any:
        self._terminal.tick()
        if size == 0:
            return b""
        # A console has no end, so reading to the end waits until it is interrupted.
        return self._take(_ENDLESS_BYTES if size < 0 else size)

    def readinto(
        self,
        buffer: bytearray,
        size: int = -1,
    ) -> int:
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
        return self._terminal.read(count)

    def write(
        self,
        data: Any,
        *part: int,
    ) -> int:
        """Write :func:`part_of` a buffer; returns the number of bytes."""
        content = part_of(data, *part)
        self._terminal.console.write(self._cooked(content))
        return len(content)

    def _cooked(self, data: bytes) -> bytes:
        """Bytes as they are sent."""
        return data


class TextIOWrapper(FileIO):
    """Standard input or output as text; ``buffer`` is the byte stream. The Enter key, CR, is read
    as LF."""

    def __init__(
        self,
        number: int,
        terminal: Terminal,
    ) -> None:
        super().__init__(number, terminal)
        self.buffer = FileIO(0, terminal)

    def _take(self, count: int) -> bytes:
        if self._number != _STDIN:
            raise HubOSError(error_numbers.EPERM)
        return super()._take(count).replace(b"\r", b"\n")

    def read(self, size: int = -1) -> str:
        """Read a number of characters."""
        self._terminal.tick()
        if size < 0:
            return self._take(_ENDLESS_BYTES).decode()
        characters = ""
        for _ in range(size):
            # In UTF-8, the first byte of a character says how many follow.
            first = self._take(1)
            others = (first >= b"\xc0") + (first >= b"\xe0") + (first >= b"\xf0")
            character = first + self._take(others)
            characters += character.decode()
        return characters

    def readline(self, size: int = -1) -> str:
        return super().readline(size).decode()  # type: ignore[no-any-return]

    def _cooked(self, data: bytes) -> bytes:
        if self._number == _STDIN:
            raise HubOSError(error_numbers.EPERM)
        return cooked(data)


class Poll:
    """``select.poll()``; ``advance`` lets simulated time pass until possible input, and returns the
    ms that passed."""

    def __init__(
        self,
        advance: Callable[[int], int],
        tick: Callable[[], None],
    ) -> None:
        self._advance = advance
        self._tick = tick
        self._streams: dict[int, tuple[FileIO, int]] = {}

    def register(
        self,
        stream: Any,
        eventmask: int = _POLLIN | _POLLOUT,
    ) -> None:
        self._streams[id(stream)] = (_pollable(stream), eventmask)

    def unregister(self, stream: Any) -> None:
        self._streams.pop(id(stream), None)

    def modify(
        self,
        stream: Any,
        eventmask: int,
    ) -> None:
        if id(stream) not in self._streams:
            raise HubOSError(error_numbers.ENOENT)
        self._streams[id(stream)] = (stream, eventmask)

    def poll(
        self,
        timeout: int = -1,
        flags: int = 0,
    ) -> list[tuple[FileIO, int]]:
        self._tick()
        # Streams are looked at once at least, even without a timeout.
        ready = self._ready()
        while not ready and timeout:
            if timeout < 0:
                self._advance(_FOREVER_MS)
            else:
                timeout -= self._advance(timeout)
            ready = self._ready()
        # A one-shot stream is not looked at any more once it was ready.
        if flags & 1:
            for stream, _ in ready:
                self.modify(stream, 0)
        return ready

    def _ready(self) -> list[tuple[FileIO, int]]:
        """Streams with those of their events that the program asked for."""
        ready = []
        for stream, mask in self._streams.values():
            events = stream.events() & mask
            if events:
                ready.append((stream, events))
        return ready

    def ipoll(
        self,
        timeout: int = -1,
        flags: int = 0,
    ) -> Iterator[tuple[FileIO, int]]:
        return iter(self.poll(timeout, flags))


Poll.__name__ = Poll.__qualname__ = "poll"


def _pollable(stream: Any) -> FileIO:
    if not isinstance(stream, FileIO):
        raise HubOSError("stream operation not supported")
    return stream


def sys_module(
    terminal: Terminal,
    build: str,
    machine: str,
) -> ModuleType:
    stdout = TextIOWrapper(1, terminal)

    def print_exception(error: object, file: Any = stdout) -> None:
        if isinstance(error, BaseException):
            shown = format_traceback(error, "")
        else:
            shown = f"{representation(error)}\n"
        write_text(file, shown)

    names: dict[str, Any] = {
        "stdin": TextIOWrapper(0, terminal),
        "stdout": stdout,
        "stderr": TextIOWrapper(2, terminal),
        "path": ["", ".frozen"],
        "argv": [],
        "version": f"3.4.0; Pybricks MicroPython {build}",
        "version_info": (3, 4, 0),
        "implementation": ("micropython", (1, 26, 0, ""), machine, 0x2306),
        "byteorder": "little",
    }
    return module("sys", names, print_exception)


def select_module(advance: Callable[[int], int], tick: Callable[[], None]) -> ModuleType:
    def select(
        readers: Any,
        writers: Any,
        others: Any,
        timeout: float | None = None,
        /,
    ) -> tuple[list[FileIO], ...]:
        """Streams that can be read, be written, or failed; ``timeout`` in seconds."""
        poll = Poll(advance, tick)
        masks = (_POLLIN, _POLLOUT, _POLLERR | _POLLHUP)
        groups = (readers, writers, others)
        # A stream may be in several groups, whose masks are joined.
        masks_by_stream: dict[FileIO, int] = {}
        for streams, mask in zip(groups, masks, strict=True):
            if not isinstance(streams, list | tuple):
                kind = type(streams).__name__
                raise TypeError(f"object '{kind}' isn't a tuple or list")
            for stream in map(_pollable, streams):
                mask_before = masks_by_stream.get(stream, 0)
                masks_by_stream[stream] = mask_before | mask
        for stream, mask in masks_by_stream.items():
            poll.register(stream, mask)
        timeout_ms = -1 if timeout is None or timeout < 0 else int(to_single(timeout * 1000))
        ready = poll.poll(timeout_ms)
        return tuple([stream for stream, events in ready if events & mask] for mask in masks)

    names: dict[str, Any] = {
        "poll": lambda: Poll(advance, tick),
        "POLLIN": _POLLIN,
        "POLLOUT": _POLLOUT,
        "POLLERR": _POLLERR,
        "POLLHUP": _POLLHUP,
    }
    return module("select", names, select)


def micropython_module(terminal: Terminal, memory: Callable[[], tuple[int, int]]) -> ModuleType:
    """``memory`` returns the bytes in use and the free ones."""
    state = {"level": 0, "locks": 0}

    def kbd_intr(character: int) -> None:
        expect_int(character)
        terminal.interrupt = character

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
        # The lines have a hub's form, for programs that read the numbers, but there are no blocks
        # here.
        lines = (
            f"stack: 0 out of {_STACK_BYTES}",
            f"GC: total: {used_bytes + free_bytes}, used: {used_bytes}, free: {free_bytes}",
            (
                " No. of 1-blocks: 0, 2-blocks: 0, max blk sz: 0, max free sz: "
                f"{free_bytes // BLOCK_BYTES}"
            ),
        )
        shown = "".join(f"{line}\n" for line in lines)
        terminal.console.write(cooked(shown.encode()))

    def qstr_info(verbose: Any = None) -> None:
        line = b"qstr pool: n_pool=0, n_qstr=0, n_str_data_bytes=0, n_total_bytes=0\n"
        terminal.console.write(cooked(line))

    names = {"const": lambda value: value, "stack_use": lambda: 0}
    return module(
        "micropython",
        names,
        mem_info,
        qstr_info,
        kbd_intr,
        opt_level,
        heap_lock,
        heap_unlock,
    )


def gc_module(memory: Callable[[], tuple[int, int]]) -> ModuleType:
    state = {"on": True, "limit": -1}

    def threshold(*size: int) -> int | None:
        if not size:
            return state["limit"]
        (limit_bytes,) = size
        # The firmware counts it in blocks.
        state["limit"] = limit_bytes // BLOCK_BYTES * BLOCK_BYTES if limit_bytes >= 0 else -1
        return None

    # CPython collects garbage by itself, so none of this changes what a program needs.
    names: dict[str, Any] = {
        "enable": lambda: state.update(on=True),
        "disable": lambda: state.update(on=False),
        "isenabled": lambda: state["on"],
        "mem_alloc": lambda: memory()[0],
        "mem_free": lambda: memory()[1],
        "collect": lambda: None,
    }
    return module("gc", names, threshold)


def errno_module() -> ModuleType:
    names: dict[str, Any] = {name: code for code, name in ERROR_NAMES.items()}
    names["errorcode"] = FixedDict.of(ERROR_NAMES)
    return module("errno", names)


def json_module() -> ModuleType:
    def dumps(value: Any, /, *, separators: tuple[str, str] | None = None) -> str:
        between_items, after_key = separators or (", ", ": ")

        def write(value: Any) -> str:
            if isinstance(value, dict):
                pairs = []
                for name, part in zip(value, value.values(), strict=True):
                    # A key that is no text is written as one, in quotes.
                    key = write(name)
                    if not isinstance(name, str):
                        key = f'"{key}"'
                    pairs.append(key + after_key + write(part))
                return "{" + between_items.join(pairs) + "}"
            if isinstance(value, list | tuple):
                return "[" + between_items.join(map(write, value)) + "]"
            if value is None or isinstance(value, bool):
                return json.dumps(value)
            if isinstance(value, bytes):
                value = value.decode()
            if isinstance(value, str):
                return json.dumps(value, ensure_ascii=False)
            # A hub writes anything else too, as `print` does.
            return text(value)

        return write(value)

    def loads(source: str | bytes, /) -> Any:
        return read_json(source if isinstance(source, str) else as_bytes(source).decode())

    def dump(
        value: Any,
        stream: Any,
        /,
        *,
        separators: tuple[str, str] | None = None,
    ) -> None:
        write_text(stream, dumps(value, separators=separators))

    def load(stream: Any, /) -> Any:
        if not hasattr(stream, "read"):
            raise HubOSError("stream operation not supported")
        return loads(stream.read())

    return module("json", {}, dumps, loads, dump, load)
