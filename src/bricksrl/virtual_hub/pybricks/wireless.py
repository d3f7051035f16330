"""Bluetooth devices. Only a remote control can be near: searches for others take their time and fail.

Names and errors: ``pybricks`` 4.0 on PyPI, and the firmware's ``pb_type_pupdevices_remote.c``.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.pybricks.context import Context, RunLoop, bound, charged, expect_type, get_int, os_error
from bricksrl.virtual_hub.pybricks.parameters import Color, buttons

_LONGEST_NAME = 14
_SEARCH_MS = 500  # until a switched-on remote control is found
_REMOTE_BUTTONS = ("left_plus", "left_minus", "right_plus", "right_minus", "left", "right", "center")
_LONGEST_MESSAGE_BYTES = 20


def _absent(name: str) -> Callable[..., Any]:
    """A method that needs the device."""

    @charged
    def method(self: Any, *values: Any) -> Any:
        raise os_error(errno.ENODEV)

    method.__name__ = method.__qualname__ = name
    return method


class Wireless:
    """Base class."""

    _loop: RunLoop
    _machine: Machine

    def __init__(self, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        self._loop.assert_blocking()
        if name is not None:
            expect_type(name, str)
            if len(name.encode()) > _LONGEST_NAME:
                raise ValueError("Name too long")
        self._timeout_ms = None if timeout is None else get_int(timeout) + 1
        if self._timeout_ms is not None and self._timeout_ms < 1:
            raise ValueError("Invalid argument")
        if connect:
            self.connect()

    def connect(self) -> Any:
        self._machine.charge_call()
        start_ms = self._machine.time_ms

        def is_done() -> bool:
            if self._timeout_ms is not None and self._machine.time_ms - start_ms >= self._timeout_ms:
                raise os_error(errno.ETIMEDOUT)
            return False

        return self._loop.finish(is_done, grain_ms=1)

    @charged
    def disconnect(self) -> Any:
        return self._loop.done()

    name = _absent("name")


class _Part:
    """A part of an unconnected device."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine


class _Buttons(_Part):
    pressed = _absent("pressed")


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
        for number in (hub_kind, num_notifications):
            if not 0 <= get_int(number) <= 255:
                raise ValueError("Invalid argument")
        super().__init__(name, timeout, connect)

    @charged
    def write(self, buf: Any) -> Any:
        if len(buf) > _LONGEST_MESSAGE_BYTES:
            raise ValueError("message too long")
        raise os_error(errno.ENODEV)

    read = _absent("read")


class _RemoteButtons(_Part):
    """The buttons of the remote control, pressed by the panel."""

    is_connected = False

    @charged
    def pressed(self) -> set[Any]:
        if not self.is_connected:
            raise os_error(errno.ENODEV)
        down = self._machine.panel.pressed_on_remote(self._machine.time_ms)
        return buttons(name for name in _REMOTE_BUTTONS if name in down)


class _RemoteLight(_Part):
    is_connected = False

    @charged
    def on(self, color: Any) -> None:
        expect_type(color, Color)
        self._check()

    @charged
    def off(self) -> None:
        self._check()

    def _check(self) -> None:
        if not self.is_connected:
            raise os_error(errno.ENODEV)


class Remote(Wireless):
    """The remote control, near if the panel has one."""

    def __init__(self, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        self.buttons, self.light = _RemoteButtons(self._machine), _RemoteLight(self._machine)
        self._name = "Handset" if name is None else name
        super().__init__(name, timeout, connect)

    def connect(self) -> Any:
        if not self._machine.panel.has_remote:
            return super().connect()
        self._machine.charge_call()
        found_ms = self._machine.time_ms + _SEARCH_MS

        def is_done() -> bool:
            if self._machine.time_ms < found_ms:
                return False
            self._set_connected(True)
            return True

        return self._loop.finish(is_done, grain_ms=1)

    @charged
    def disconnect(self) -> Any:
        self._set_connected(False)
        return self._loop.done()

    @charged
    def name(self, name: Any = None) -> Any:
        if not self.buttons.is_connected:
            raise os_error(errno.ENODEV)
        if name is None:
            return self._name
        expect_type(name, str)
        self._name = name
        return self._loop.done()

    def _set_connected(self, is_connected: bool) -> None:
        self.buttons.is_connected = self.light.is_connected = is_connected


class TechnicMoveHub(Wireless):
    drive = _absent("drive")


class DuploTrain(Wireless):
    drive, headlights, sound = _absent("drive"), _absent("headlights"), _absent("sound")
    speed, color = _absent("speed"), _absent("color")


class MarioHub(Wireless):
    color, hsv = _absent("color"), _absent("hsv")

    @charged
    def detectable_colors(self, colors: Any = None) -> None:
        for color in colors or ():
            expect_type(color, Color)


class XboxController(Wireless):
    def __init__(self, joystick_deadzone: Any = 10, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        get_int(joystick_deadzone)
        self.buttons = _Buttons(self._machine)
        super().__init__(name, timeout, connect)

    state, triggers, dpad, profile, rumble = map(_absent, ("state", "triggers", "dpad", "profile", "rumble"))
    joystick_left, joystick_right = _absent("joystick_left"), _absent("joystick_right")


def wireless(kinds: tuple[type[Wireless], ...], context: Context) -> dict[str, Any]:
    """Classes for one program, by name."""
    return {kind.__name__: bound(kind, context) for kind in kinds}
