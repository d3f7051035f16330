"""``Motor.model``: what the firmware believes about a motor, beside what its encoder measures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bricksrl.twin.firmware.observer import Observer, ObserverSettings
from bricksrl.twin.machine import Machine
from bricksrl.twin.micropython.floats import to_single
from bricksrl.twin.pybricks.context import charged, get_array, get_int


class MotorModel:
    """State of the observer, at the motor's own shaft: gears do not count (``pb_type_motor_model.c``)."""

    def __init__(self, observer: Callable[[], Observer], machine: Machine) -> None:
        self._observer = observer
        self._machine = machine

    @charged
    def state(self) -> tuple[float, float, float, bool]:
        """Angle (deg), speed (deg/s), current (mA), and whether it stalls at this moment, however shortly."""
        observer = self._observer()
        numbers = (observer.angle / 1000, observer.speed / 1000, observer.current / 10)
        return (*map(to_single, numbers), observer.is_pushed_back)  # type: ignore[return-value]

    @charged
    def settings(self, values: Any = None) -> tuple[int, ...] | None:
        """The eight ``ObserverSettings``, or set them all."""
        observer = self._observer()
        if values is None:
            return tuple(observer.settings)
        if len(get_array(values)) != len(ObserverSettings._fields):
            raise ValueError("Invalid argument")
        observer.tune(ObserverSettings(*map(get_int, values)))
        return None
