"""``pybricks.messaging`` of Pybricks 4.0: AppData and radio."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from brickhub.virtual.console import AppDataConsole
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.context import Context, expect_type, get_array, get_exact_int, os_error
from brickhub.virtual.pybricks.radio import radio_class

_EOPNOTSUPP = 95
_MAX_EVENT_BYTES = 19
_SET_UP, _CONFIGURE = 0, 1


def _mode(pair: Any) -> tuple[int, int]:
    """Number and size of a mode."""
    if len(get_array(pair)) != 2 or get_exact_int(pair[0]) > 255:
        raise TypeError("modes must be a list of (mode, size) tuples")
    return pair[0] & 0xFF, get_exact_int(pair[1])


def _payload(data: Any) -> bytes:
    """Bytes of text or bytes; unlike elsewhere, a bytearray is neither."""
    if not isinstance(data, str | bytes):
        raise TypeError(f"can't convert '{type(data).__name__}' object to str implicitly")
    return as_bytes(data)


def messaging_module(context: Context) -> ModuleType:
    console = context.console
    machine = context.machine

    class AppData:
        """A byte buffer besides the standard streams; the host overwrites it."""

        def __init__(self, modes: Any) -> None:
            if not isinstance(console, AppDataConsole):
                raise os_error(_EOPNOTSUPP)
            context.loop.assert_blocking()
            if console.inbox:
                raise RuntimeError("host rx_buffer already allocated")
            expect_type(get_array(modes), list)
            self._slices: dict[int, tuple[int, int]] = {}
            start = 0
            for mode, size in map(_mode, sorted(modes)):
                if mode in self._slices:
                    raise ValueError("mode numbers must be unique")
                self._slices[mode] = (start, size)
                start += size
            console.inbox = bytearray(start)
            self._console = console
            self.write_bytes(bytes((_SET_UP, *self._slices)))

        def get_bytes(self, mode: int, index: int | None = None) -> bytes | int:
            machine.charge_call()
            if get_exact_int(mode) not in self._slices:
                raise ValueError("invalid mode")
            start, size = self._slices[mode]
            if index is None:
                return bytes(self._console.inbox[start : start + size])
            if not 0 <= get_exact_int(index) < size:
                raise ValueError("index out of range")
            return self._console.inbox[start + index]

        def write_bytes(self, data: Any, /) -> Any:
            payload = _payload(data)
            if len(payload) > _MAX_EVENT_BYTES:
                raise ValueError("Invalid argument")
            self._console.write_app_data(payload)
            return context.loop.done()

        def configure(self, mode: Any, parameter: Any, value: Any) -> Any:
            numbers = (_CONFIGURE, get_exact_int(mode) & 0xFF, get_exact_int(parameter) & 0xFF)
            return self.write_bytes(bytes(numbers) + _payload(value))

        def close(self) -> None:
            self._console.inbox = bytearray()

    return module("messaging", {"AppData": AppData, "BLERadio": radio_class(context)})
