"""``pybricks.hubs``: the class of the robot's hub, and its parts besides the IMU and its panel."""

import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.robot import HubModel
from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.exceptions import SwitchedOff
from brickhub.virtual.micropython.numbers import expect_int, module
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.arguments import expect, expect_type
from brickhub.virtual.pybricks.context import Context, Native, bind
from brickhub.virtual.pybricks.hub_panel import ColorLight, Keypad, LightMatrix, Speaker
from brickhub.virtual.pybricks.imu import IMU, Accelerometer
from brickhub.virtual.pybricks.parameters import Axis, Button
from brickhub.virtual.pybricks.wireless import Radio

_IDLE_CURRENT_MA = 100
_ROOM_TEMPERATURE_MDEG = 25_000
_MOVED_MESSAGE = b"""Hub messaging has been moved. You should use:\r
\r
from pybricks.messaging import BLERadio\r
radio = BLERadio(broadcast_channel, observe_channels)\r
\r
"""


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
    def __init__(self) -> None:
        self._storage = bytearray(self._machine.robot.hub.model.storage_bytes)

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
        return "Pybricks Hub"

    def reset_reason(self) -> int:
        return 0

    def info(self) -> dict[str, Any]:
        values = {
            "name": self.name(),
            "reset_reason": 0,
            "host_connected_ble": True,
            "host_connected_usb": False,
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
        expect(end <= len(self._storage))
        if write is None:
            return bytes(self._storage[start:end])
        self._storage[start:end] = data
        return None

    def reset_storage(self) -> None:
        self._storage[:] = bytes(len(self._storage))


class _Hub:
    """A hub; its parts exist once per program."""

    _parts: dict[str, Any]
    _context: Context

    def __init__(
        self,
        broadcast_channel: Any = None,
        observe_channels: Any = (),
    ) -> None:
        self.__dict__.update(self._parts)
        self.ble = None
        if broadcast_channel is not None or observe_channels != ():
            self._context.console.write(_MOVED_MESSAGE)
            self.ble = bind(self._context, Radio)(broadcast_channel, observe_channels)


class _OrientedHub(_Hub):
    def __init__(
        self,
        top_side: Any = Axis.Z,
        front_side: Any = Axis.X,
        broadcast_channel: Any = None,
        observe_channels: Any = (),
    ) -> None:
        super().__init__(broadcast_channel, observe_channels)
        self._parts["imu"]._orient(top_side, front_side)


class _MoveHub(_OrientedHub):
    def __init__(
        self,
        top_side: Any = 3,
        front_side: Any = 1,
        broadcast_channel: Any = None,
        observe_channels: Any = (),
    ) -> None:
        super().__init__(
            top_side,
            front_side,
            broadcast_channel,
            observe_channels,
        )


class _Brick(_Hub):
    """EV3 Brick, whose constructor looks at no argument."""

    def __init__(
        self,
        *_unused: Any,
        **_named: Any,
    ) -> None:
        self.__dict__.update(self._parts)


def _as_module(name: str, part: Any) -> ModuleType:
    """A module of the part's methods; those with an argument that can be left out take keywords
    too."""

    def function(method: Callable[..., Any]) -> Callable[..., Any]:
        parameters = inspect.signature(method).parameters.values()
        is_plain = all(parameter.default is parameter.empty for parameter in parameters)

        def call(*args: Any, **kwargs: Any) -> Any:
            if is_plain and kwargs:
                raise TypeError("function doesn't take keyword arguments")
            if is_plain and len(args) != len(parameters):
                raise TypeError(
                    f"function takes {len(parameters)} positional arguments but {len(args)} "
                    "were given"
                )
            return method(*args, **kwargs)

        return call

    functions = {}
    for method_name in dir(part):
        if not method_name.startswith("_"):
            functions[method_name] = function(getattr(part, method_name))
    return module(name, functions)


def hubs_module(context: Context, model: HubModel) -> ModuleType:
    kinds: dict[str, Any] = {
        "battery": Battery,
        "buttons": Keypad,
        "light": ColorLight,
        "system": System,
    }
    if model.is_rechargeable:
        kinds["charger"] = Charger
    if model.has_display:
        kinds["display"] = LightMatrix
    if model.has_speaker:
        kinds["speaker"] = Speaker
    if model.has_imu:
        kinds["imu"] = IMU
    elif model.has_accelerometer:
        kinds["imu"] = Accelerometer
    parts = {}
    for name, kind in kinds.items():
        parts[name] = bind(context, kind)()
    # In the firmware these two are modules and not objects.
    parts["battery"] = _as_module("battery", parts["battery"])
    parts["system"] = _as_module("", parts["system"])
    # Hubs with a single button have this older name too.
    if len(model.buttons) == 1:
        parts["button"] = parts["buttons"]
    base: type[_Hub] = _Hub
    if model.has_accelerometer:
        base = _MoveHub
    elif "imu" in parts:
        base = _OrientedHub
    elif model.screen_pixels:
        base = _Brick
    hub = type(model.class_name, (base,), {"_parts": parts, "_context": context})
    names = {model.class_name: hub, "ThisHub": hub}
    if model.alias:
        names[model.alias] = hub
    return module("hubs", names)
