"""Devices that connect over Bluetooth. None is near: looking for one takes its time, and fails.

What they are called and how they refuse: ``pybricks`` 4.0 on PyPI, and the firmware's ``pb_type_pupdevices_remote.c``.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

from bricksrl.twin.machine import Machine
from bricksrl.twin.pybricks.context import Context, RunLoop, bound, charged, expect_type, get_int, os_error
from bricksrl.twin.pybricks.parameters import Color

_LONGEST_NAME = 14
_LONGEST_MESSAGE_BYTES = 20


def _absent(name: str) -> Callable[..., Any]:
    """A method that needs the device."""

    @charged
    def method(self: Any, *values: Any) -> Any:
        raise os_error(errno.ENODEV)

    method.__name__ = method.__qualname__ = name
    return method


class Wireless:
    """What all of them have in common."""

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
    """A part of a device that is not connected."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine


class _Buttons(_Part):
    pressed = _absent("pressed")


class _Light(_Part):
    on, off = _absent("on"), _absent("off")


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


class Remote(Wireless):
    def __init__(self, name: Any = None, timeout: Any = 10000, connect: Any = True) -> None:
        self.buttons, self.light = _Buttons(self._machine), _Light(self._machine)
        super().__init__(name, timeout, connect)


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
    """Classes of one program, by their names."""
    return {kind.__name__: bound(kind, context) for kind in kinds}
