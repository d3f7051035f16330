"""Bluetooth devices. Only a remote control and an Xbox controller can be near: searches for others time out.

Names and errors: ``pybricks`` 4.0 on PyPI, ``pb_type_iodevices_lwp3device.c`` and ``pb_type_iodevices_xbox_controller.c``, v4.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.context import (
    Context,
    RunLoop,
    bind,
    charged,
    expect_type,
    get_exact_int,
    get_int,
    get_text,
    os_error,
)
from brickhub.virtual.pybricks.parameters import Color, buttons

_MAX_NAME_BYTES = 14
_SEARCH_MS = 500  # until a switched-on device is found
_REMOTE_BUTTONS = ("left_plus", "left", "left_minus", "right_plus", "right", "right_minus", "center")
_XBOX_BUTTONS = ("a", "b", "", "x", "y", "", "lb", "rb", "", "", "view", "menu", "guide", "lj", "rj")
"""By their bit."""
_XBOX_EXTRAS = ("upload", "p1", "p2", "p3", "p4")
_RUMBLE_MOTORS = 4
_STICK_MAX, _TRIGGER_MAX = 2**15 - 1, 1023
_MESSAGE_BYTES = range(3, 21)


def _unavailable(name: str) -> Callable[..., Any]:
    """A method that needs the device."""

    @charged
    def method(self: Any, *values: Any) -> Any:
        raise os_error(errno.ENODEV)

    method.__name__ = method.__qualname__ = name
    return method


class Wireless:
    """Bluetooth device."""

    _kind = ""  # name of the device among those that can be near
    _loop: RunLoop
    _machine: Machine
    _is_connected = False
    _pause_ms: int | None = None
    """Pause before the second search; ``None`` if there is none."""

    def __init__(self, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        self._loop.assert_blocking()
        if name is not None and len(get_text(name).encode()) > _MAX_NAME_BYTES:
            raise ValueError("Name too long")
        self._timeout_ms = None if timeout is None else max(0, get_int(timeout)) + 1
        if connect:
            self.connect()

    def connect(self) -> Any:
        self._machine.charge_call()
        start_ms = self._machine.time_ms
        is_near = self._kind in self._machine.panel.near
        longest_ms = self._timeout_ms
        if longest_ms is not None and self._pause_ms is not None:
            longest_ms = 2 * longest_ms + self._pause_ms

        def is_done() -> bool:
            waited_ms = self._machine.time_ms - start_ms
            self._is_connected = is_near and waited_ms >= _SEARCH_MS
            if not is_near and longest_ms is not None and waited_ms >= longest_ms:
                raise os_error(errno.ETIMEDOUT)
            return self._is_connected

        return self._loop.finish(is_done, poll_ms=1)

    @charged
    def disconnect(self) -> Any:
        self._is_connected = False
        return self._loop.done()

    name = _unavailable("name")

    def _down(self) -> frozenset[str]:
        """Names of the buttons that are down. Raises OSError, ENODEV, while it is not connected."""
        self._check_connected()
        return self._machine.panel.pressed_on(self._kind, self._machine.time_ms)

    def _check_connected(self) -> None:
        if not self._is_connected:
            raise os_error(errno.ENODEV)


class _Part:
    """Part of a device."""

    def __init__(self, device: Wireless) -> None:
        self._device = device
        self._machine = device._machine  # for ``charged``


class _Buttons(_Part):
    """Its buttons in the firmware's order, pressed by the panel."""

    def __init__(self, device: Wireless, names: tuple[str, ...]) -> None:
        super().__init__(device)
        self._names = names

    @charged
    def pressed(self) -> Any:
        down = self._device._down()
        return buttons([name for name in self._names if name in down], self._machine.robot.hub.model)


class LWP3Device(Wireless):
    def __init__(
        self,
        hub_kind: Any,
        name: Any = None,
        timeout: Any = 10000,
        pair: Any = False,
        num_notifications: Any = 8,
        connect: Any = True,
    ) -> None:
        for number in (num_notifications, hub_kind):
            get_exact_int(number)
        super().__init__(name, timeout, connect)

    @charged
    def write(self, buf: Any, /) -> Any:
        message = as_bytes(buf)
        if len(message) not in _MESSAGE_BYTES:
            raise ValueError("bad length")
        if message[0] != len(message):
            raise ValueError("length in header wrong")
        raise os_error(errno.ENODEV)

    read = _unavailable("read")


class _RemoteLight(_Part):
    def on(self, color: Any) -> Any:
        expect_type(color, Color)
        return self.off()

    @charged
    def off(self) -> Any:
        self._device._check_connected()
        return self._device._loop.done()


class Remote(Wireless):
    """The remote control, near if the panel has one."""

    _kind = "remote"

    def __init__(self, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        self.buttons, self.light = _Buttons(self, _REMOTE_BUTTONS), _RemoteLight(self)
        self._name = "Handset" if name is None else name
        super().__init__(name, timeout, connect)

    @charged
    def name(self, *name: Any) -> Any:
        text = get_text(name[0]) if name else self._name
        if not 1 <= len(text.encode()) <= _MAX_NAME_BYTES:
            raise ValueError("bad name length")
        self._check_connected()
        self._name = text
        return self._loop.done() if name else text


class TechnicMoveHub(Wireless):
    drive = _unavailable("drive")


class DuploTrain(Wireless):
    drive, headlights, sound = _unavailable("drive"), _unavailable("headlights"), _unavailable("sound")
    speed, color = _unavailable("speed"), _unavailable("color")


class MarioHub(Wireless):
    color, hsv = _unavailable("color"), _unavailable("hsv")

    @charged
    def detectable_colors(self, colors: Any = None) -> None:
        for color in colors or ():
            expect_type(color, Color)


class XboxController(Wireless):
    """The game controller, near if the panel has one."""

    _kind = "xbox"
    _pause_ms = 2000

    def __init__(self, joystick_deadzone: Any = 10, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        get_int(joystick_deadzone)
        self.buttons = _Buttons(self, (*filter(None, _XBOX_BUTTONS), *_XBOX_EXTRAS, "up", "right", "down", "left"))
        super().__init__(name, timeout, connect)

    @charged
    def name(self, name: Any = None) -> str:
        self._check_connected()
        return "Xbox Wireless Controller"

    @charged
    def state(self) -> tuple[int, ...]:
        """Raw values, as the controller sends them."""
        down = self._down()
        sticks = (_stick(down, side, _STICK_MAX) for side in ("left", "right"))
        axes = [value for x, y in sticks for value in (x, -y)]
        raw = (value + (value == _STICK_MAX) for value in axes)  # it sends 0 to 65535 for both ends
        triggers = (_TRIGGER_MAX * (f"{side}_trigger" in down) for side in ("left", "right"))
        bits = sum(1 << bit for bit, name in enumerate(_XBOX_BUTTONS) if name in down)
        upload, *paddles = (name in down for name in _XBOX_EXTRAS)
        extras = int(upload), 0, 0, sum(is_down << bit for bit, is_down in enumerate(paddles))
        return *raw, *triggers, _dpad(down), bits, *extras

    @charged
    def dpad(self) -> int:
        return _dpad(self._down())

    @charged
    def profile(self) -> int:
        self._check_connected()
        return 0

    @charged
    def joystick_left(self) -> tuple[int, int]:
        return _stick(self._down(), "left", 100)

    @charged
    def joystick_right(self) -> tuple[int, int]:
        return _stick(self._down(), "right", 100)

    @charged
    def triggers(self) -> tuple[int, int]:
        down = self._down()
        return 100 * ("left_trigger" in down), 100 * ("right_trigger" in down)

    @charged
    def rumble(self, power: Any = 100, duration: Any = 200, count: Any = 1, delay: Any = 100) -> Any:
        powers = power if isinstance(power, list | tuple) else (power,) * _RUMBLE_MOTORS
        if len(powers) != _RUMBLE_MOTORS:
            raise ValueError(f"expected 1 number or tuple of {_RUMBLE_MOTORS} values")
        for number in (duration, delay, count, *powers):
            get_int(number)
        self._check_connected()
        return self._loop.done()


def _stick(down: frozenset[str], side: str, limit: int) -> tuple[int, int]:
    """Position of a stick of the Xbox controller: to the right, and up."""
    left, right, back, ahead = (f"joystick_{side}_{direction}" in down for direction in ("left", "right", "down", "up"))
    return limit * (right - left), limit * (ahead - back)


def _dpad(down: frozenset[str]) -> int:
    """Direction of the pad: 0 for none, 1 for up, then clockwise."""
    x, y = ("right" in down) - ("left" in down), ("up" in down) - ("down" in down)
    return {(0, 1): 1, (1, 1): 2, (1, 0): 3, (1, -1): 4, (0, -1): 5, (-1, -1): 6, (-1, 0): 7, (-1, 1): 8}.get((x, y), 0)


def wireless(kinds: tuple[type[Wireless], ...], context: Context) -> dict[str, Any]:
    """Classes for one program, by name; without those that its hub lacks."""
    missing = context.machine.robot.hub.model.missing
    return {kind.__name__: bind(kind, context) for kind in kinds if kind.__name__ not in missing}
