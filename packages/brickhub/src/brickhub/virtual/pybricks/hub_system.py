"""Battery, charger and system of a hub."""

from typing import Any

from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.exceptions import SwitchedOff
from brickhub.virtual.micropython.numbers import expect_int
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.arguments import expect, expect_type
from brickhub.virtual.pybricks.context import Native
from brickhub.virtual.pybricks.parameters import Button

_IDLE_CURRENT_MA = 100
_ROOM_TEMPERATURE_MDEG = 25_000


class Battery(Native):
    def voltage(self) -> int:
        return self._machine.body.battery_mv

    def current(self) -> int:
        return _IDLE_CURRENT_MA

    def type(self) -> str:
        return "Li-ion" if self._machine.robot.hub.model.is_rechargeable else "Alkaline"

    def temperature(self) -> int:
        return _ROOM_TEMPERATURE_MDEG


class Charger(Native):
    """Charger, never connected."""

    def connected(self) -> int:
        return 0

    status = current = connected


class System(Native):
    def set_stop_button(self, button: Any) -> None:
        """Set the buttons; ``Button`` itself is none. A hub with one button takes it for anything
        that is true."""
        panel = self._machine.panel
        model = self._machine.robot.hub.model
        if len(model.buttons) == 1:
            panel.stop_buttons = frozenset({model.stop_button}) if button else frozenset()
            return
        # The argument may be one button, or a set of them.
        try:
            chosen = list(button) if button else []
        except TypeError:
            chosen = [button]
        names = set()
        for choice in chosen:
            # Types are compared by name, because `parameters.Button` of a program is an object
            # whose class has this name too.
            if type(choice).__name__ != Button.__name__:
                expect_type(button, Button)
            # "Button.CENTER" has its name after the dot, where `Button` itself has nothing.
            name = str(choice).partition(".")[2].lower()
            if name:
                names.add(name)
        panel.stop_buttons = frozenset(names)

    def name(self) -> str:
        return self._machine.hub_name

    def reset_reason(self) -> int:
        return 0

    def info(self) -> dict[str, Any]:
        has_bluetooth = self._machine.robot.hub.model.has_bluetooth
        values = {
            "name": self.name(),
            "reset_reason": 0,
            "host_connected_ble": has_bluetooth,
            "host_connected_usb": not has_bluetooth,
            "program_start_type": 3,
            "program_id": 0,
        }
        return HubDict.sized(len(values), values.items())

    def shutdown(self) -> None:
        raise SwitchedOff

    def storage(
        self,
        offset: Any,
        read: Any = None,
        write: Any = None,
    ) -> bytes | None:
        expect_int(offset, 0 if read is None else read)
        start: int = offset
        if (read is None) == (write is None):
            raise TypeError("Must set either read (int) or write (bytes).")
        data = b"" if write is None else as_bytes(write)
        size = read if write is None else len(data)
        end = start + size
        expect(start >= 0 and size >= 0)
        stored = self._machine.storage
        expect(end <= len(stored))
        if write is None:
            return bytes(stored[start:end])
        stored[start:end] = data
        return None

    def reset_storage(self) -> None:
        stored = self._machine.storage
        stored[:] = bytes(len(stored))
