"""``pybricks.messaging`` of Pybricks 4.0: AppData, and Bluetooth messages between hubs.

A virtual hub sends messages, but receives nothing.
"""

from __future__ import annotations

import errno
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.context import Context, Native, bind, expect_type, get_array, get_exact_int, os_error

_LAST_CHANNEL = 255
_MAX_PAYLOAD_BYTES = 26
_NOTHING_HEARD_DBM = -128
_MAX_EVENT_BYTES = 19
_SET_UP, _CONFIGURE = 0, 1


class Radio(Native):
    """``hub.ble`` and ``pybricks.messaging.BLERadio``; channels 0 to 255."""

    def __init__(self, broadcast_channel: Any = None, observe_channels: Any = ()) -> None:
        if broadcast_channel is not None and not 0 <= get_exact_int(broadcast_channel) <= _LAST_CHANNEL:
            raise ValueError("Broadcast channel must be 0 to 255 or None")
        channels = [get_exact_int(observe_channels[index]) for index in range(len(observe_channels))]
        if not all(0 <= channel <= _LAST_CHANNEL for channel in channels):
            raise ValueError("observe channel must be 0 to 255")
        self._broadcast_channel = broadcast_channel
        self._observed = frozenset(channels)

    def broadcast(self, data: Any) -> Any:
        if self._broadcast_channel is None:
            raise RuntimeError("no broadcast channel selected")
        if data is not None:
            values = data if isinstance(data, list | tuple) else [data]
            if sum(map(_encoded_bytes, values)) + (values is not data) > _MAX_PAYLOAD_BYTES:
                raise ValueError(f"payload limited to {_MAX_PAYLOAD_BYTES} bytes")
        return self._loop.done()

    def observe(self, channel: Any) -> None:
        self._check(channel)

    def signal_strength(self, channel: Any) -> int:
        self._check(channel)
        return _NOTHING_HEARD_DBM

    def version(self) -> str:
        return "v1.0"

    def _check(self, channel: Any) -> None:
        if get_exact_int(channel) not in self._observed:
            raise ValueError("channel not configured")


def _encoded_bytes(value: Any) -> int:
    """Size of a value in an advertisement: type byte and value."""
    if isinstance(value, bool):
        return 1
    if isinstance(value, int):
        return 2 if -(2**7) <= value < 2**7 else 3 if -(2**15) <= value < 2**15 else 5
    if isinstance(value, float):
        return 5
    if isinstance(value, str):
        return 1 + len(value.encode())
    if isinstance(value, bytes | bytearray | memoryview):
        return 1 + len(value)
    raise TypeError("must be True, False, int, float, str or bytes")


class BLERadio(Radio):
    """Radio of Pybricks 4, separate from the hub."""


@runtime_checkable
class AppDataConsole(Protocol):
    """A console with AppData. ``inbox``: buffer that the host writes to; the program sets its size."""

    inbox: bytearray

    def write_app_data(self, data: bytes) -> None:
        """Send bytes; raises OSError without a listener."""


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
                raise os_error(errno.EOPNOTSUPP)
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

    return module("messaging", {"AppData": AppData, "BLERadio": bind(context, BLERadio)})
