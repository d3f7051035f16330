"""``pybricks.hubs``: the class of the robot's hub, with its parts."""

import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.robot import HubModel
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.ble_radio import Radio
from brickhub.virtual.pybricks.context import Context, bind
from brickhub.virtual.pybricks.ev3.ev3brick import BrickBattery, BrickLight, BrickSpeaker
from brickhub.virtual.pybricks.ev3.image import Screen
from brickhub.virtual.pybricks.hub_panel import ColorLight, Keypad, LightMatrix, Speaker
from brickhub.virtual.pybricks.hub_system import Battery, Charger, System
from brickhub.virtual.pybricks.imu import IMU, Accelerometer
from brickhub.virtual.pybricks.parameters import Axis

_MOVED_MESSAGE = b"""Hub messaging has been moved. You should use:\r
\r
from pybricks.messaging import BLERadio\r
radio = BLERadio(broadcast_channel, observe_channels)\r
\r
"""


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


_OWN_PARTS: dict[tuple[str, str], Any] = {
    ("EV3Brick", "battery"): BrickBattery,
    ("EV3Brick", "light"): BrickLight,
    ("EV3Brick", "speaker"): BrickSpeaker,
}
"""Parts that are other on a class of hub than elsewhere."""


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
        own_kind = _OWN_PARTS.get((model.class_name, name), kind)
        parts[name] = bind(context, own_kind)()
    if model.screen_pixels is not None:
        parts["screen"] = bind(context, Screen)(*model.screen_pixels)
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
    elif model.screen_pixels is not None:
        base = _Brick
    hub = type(model.class_name, (base,), {"_parts": parts, "_context": context})
    names = {model.class_name: hub, "ThisHub": hub}
    if model.alias:
        names[model.alias] = hub
    return module("hubs", names)
