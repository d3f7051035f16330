"""``pybricks.hubs``: the class of the robot's hub."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.robot import HubModel
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.accelerometer import Accelerometer
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.hub_parts import Battery, Charger, ColorLight, Keypad, LightMatrix, Speaker, System
from brickhub.virtual.pybricks.imu import IMU
from brickhub.virtual.pybricks.parameters import Axis
from brickhub.virtual.pybricks.radio import Radio

_MOVED_MESSAGE = b"""Hub messaging has been moved. You should use:\r
\r
from pybricks.messaging import BLERadio\r
radio = BLERadio(broadcast_channel, observe_channels)\r
\r
"""
_MODULES = {"battery": "battery", "system": ""}
"""Names of the parts that are modules on a hub."""


class _Hub:
    """A hub; its parts exist once per program."""

    _parts: dict[str, Any]
    _context: Context

    def __init__(self, broadcast_channel: Any = None, observe_channels: Any = ()) -> None:
        self.__dict__.update(self._parts)
        self.ble = None
        if broadcast_channel is not None or observe_channels != ():
            self._context.console.write(_MOVED_MESSAGE)
            self.ble = Radio(self._context, broadcast_channel, observe_channels)


class _OrientedHub(_Hub):
    def __init__(
        self, top_side: Any = Axis.Z, front_side: Any = Axis.X, broadcast_channel: Any = None, observe_channels: Any = ()
    ) -> None:
        super().__init__(broadcast_channel, observe_channels)
        self._parts["imu"].orient(top_side, front_side)


class _MoveHub(_Hub):
    def __init__(self, top_side: Any = 3, front_side: Any = 1, broadcast_channel: Any = None, observe_channels: Any = ()) -> None:
        super().__init__(broadcast_channel, observe_channels)
        self._parts["imu"].orient(top_side, front_side)


def _as_module(name: str, part: Any) -> ModuleType:
    """A module of the part's methods."""

    def function(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            return method(*args, **kwargs)

        return call

    return module(name, {key: function(getattr(part, key)) for key in dir(part) if not key.startswith("_")})


def hubs_module(context: Context, model: HubModel) -> ModuleType:
    classes: dict[str, Any] = {"battery": Battery, "buttons": Keypad, "light": ColorLight, "system": System}
    classes |= {"charger": Charger} if model.is_rechargeable else {}
    classes |= {"display": LightMatrix} if model.has_display else {}
    classes |= {"speaker": Speaker} if model.has_speaker else {}
    classes |= {"imu": IMU} if model.has_imu else {"imu": Accelerometer} if model.has_accelerometer else {}
    parts = {name: part(context) for name, part in classes.items()}
    for part, name in _MODULES.items():
        parts[part] = _as_module(name, parts[part])
    if len(model.buttons) == 1:
        parts["button"] = parts["buttons"]  # older name
    base = _MoveHub if model.has_accelerometer else _OrientedHub if "imu" in parts else _Hub
    hub = type(model.class_name, (base,), {"_parts": parts, "_context": context})
    names = {model.class_name: hub, "ThisHub": hub}
    return module("hubs", names | ({model.alias: hub} if model.alias else {}))
