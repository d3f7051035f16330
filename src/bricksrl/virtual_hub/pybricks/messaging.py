"""``pybricks.messaging`` of Pybricks 4.0: AppData and radio."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from bricksrl.virtual_hub.console import AppDataConsole
from bricksrl.virtual_hub.micropython.numbers import module
from bricksrl.virtual_hub.pybricks.context import Context, os_error
from bricksrl.virtual_hub.pybricks.radio import radio_class

_EOPNOTSUPP = 95
_MAX_EVENT_BYTES = 19
_SET_UP, _CONFIGURE = 0, 1


def _is_mode(pair: Any) -> bool:
    return isinstance(pair, tuple | list) and len(pair) == 2 and pair[0] <= 255


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
            if not isinstance(modes, list) or not all(map(_is_mode, modes)):
                raise TypeError("modes must be a list of (mode, size) tuples")
            self._slices: dict[int, tuple[int, int]] = {}
            start = 0
            for mode, size in sorted(modes):
                if mode in self._slices:
                    raise ValueError("mode numbers must be unique")
                self._slices[mode] = (start, size)
                start += size
            console.inbox = bytearray(start)
            self._console = console
            self.write_bytes(bytes((_SET_UP, *self._slices)))

        def get_bytes(self, mode: int, index: int | None = None) -> bytes | int:
            machine.charge_call()
            if mode not in self._slices:
                raise ValueError("invalid mode")
            start, size = self._slices[mode]
            if index is None:
                return bytes(self._console.inbox[start : start + size])
            if not 0 <= index < size:
                raise ValueError("index out of range")
            return self._console.inbox[start + index]

        def write_bytes(self, data: Any) -> None:
            if len(data) > _MAX_EVENT_BYTES:
                raise ValueError("Invalid argument")
            self._console.write_app_data(bytes(data))

        def configure(self, mode: int, parameter: int, value: Any) -> None:
            self.write_bytes(bytes((_CONFIGURE, mode, parameter)) + bytes(value))

        def close(self) -> None:
            self._console.inbox = bytearray()

    return module("pybricks.messaging", {"AppData": AppData, "BLERadio": radio_class(context)})
