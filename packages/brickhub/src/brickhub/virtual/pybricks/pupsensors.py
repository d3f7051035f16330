"""Sensors and lights of ``pybricks.pupdevices`` on the robot's ports."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

from brickhub.robot import Sense, SensorKind
from brickhub.virtual.body import SensingBody
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.arguments import expect, expect_type, get_array, get_int, get_number, os_error
from brickhub.virtual.pybricks.context import Native
from brickhub.virtual.pybricks.device_modes import MAX_FORCE_MN, SENSOR_MODES, Plug
from brickhub.virtual.pybricks.parameters import NAMED_COLORS, Color, Direction, nearest
from brickhub.virtual.stimuli import reflection_pct

_TRAVEL_UM = 6670
_TOUCHED_UM = 100
_HSV = ("hue_deg", "saturation_pct", "value_pct")
SEND_MS = 250
WRITE_MS = 11  # above the 10 ms of lego_device_data_set_delay


class Device(Native):
    """A device on a port.

    Measurements depend on the mode. After a mode change values are stale for ``_switch_ms`` (``lego_device_stale_data_delay``),
    and reads wait that long.
    """

    _kind: SensorKind
    _mode = ""
    _switch_ms = 0

    def __init__(self, port: Any) -> None:
        self._loop.assert_blocking()
        self._letter = self._context.port_letter(port)
        if not self._is_plugged_in():
            raise os_error(errno.ENODEV)
        self._machine.modes[self._letter] = self._mode
        self._plug = Plug(self._machine, self._letter)

    def _is_plugged_in(self) -> bool:
        self._switch_ms = SENSOR_MODES[self._kind].stale_ms
        if self._machine.plug_in(self._letter, self._kind.value):
            return True
        is_sensed = self._kind.model.range_mm is not None or isinstance(self._machine.body, SensingBody)
        described = (sensor.kind for sensor in self._machine.robot.sensors if sensor.port == self._letter)
        return is_sensed and self._kind in described

    def _measure(self, mode: str, get: Callable[[], Any], *quantities: str) -> Any:
        """Value of ``get`` in a mode of the device; ``quantities`` are its parts' names in the log of the run."""

        def measured() -> Any:
            value, log = get(), self._machine.log
            if log is not None:
                parts = (value.h, value.s, value.v) if quantities == _HSV else value
                log.read([f"{self._letter}_{quantity}" for quantity in quantities], parts)
            return value

        previous_mode = self._machine.modes[self._letter]
        self._machine.modes[self._letter] = mode
        if mode == previous_mode or not self._switch_ms:
            return self._loop.value(measured)
        ready_ms = self._machine.time_ms + self._switch_ms
        return self._loop.finish(lambda: self._machine.time_ms >= ready_ms, measured, poll_ms=self._switch_ms)

    def _write(self, mode: str, duration_ms: int = WRITE_MS) -> Any:
        """Command without a visible effect; waits until it is done."""
        self._machine.modes[self._letter] = mode
        return self._loop.wait_until(self._machine.time_ms + duration_ms)


def _reading(mode: str, get: Callable[[Any], Any], *quantities: str) -> Callable[..., Any]:
    """A method that measures in one mode, as :meth:`Device._measure`."""

    def read(self: Device) -> Any:
        return self._measure(mode, lambda: get(self), *quantities)

    return read


class LightArray(Native):
    """Lights around the eye of a sensor, without effect; values are checked."""

    def __init__(self, device: Device, count: int) -> None:
        self._device, self._machine, self._count = device, device._machine, count

    def on(self, brightness: Any = 100) -> Any:
        values = brightness if isinstance(brightness, list | tuple) else (brightness,) * self._count
        if len(values) != self._count:
            raise ValueError(f"expected 1 number or tuple of {self._count} values")
        for value in values:
            get_int(value)
        return self._device._write("LIGHT")

    def off(self) -> Any:
        return self._device._write("LIGHT")


LightArray.__name__ = ""  # as in the firmware


class ColorLight(Native):
    """The light of the color and distance sensor."""

    def __init__(self, device: Device) -> None:
        self._device, self._machine = device, device._machine

    def on(self, color: Any) -> Any:
        expect_type(color, Color)
        return self._device._write("COL O")

    def off(self) -> Any:
        return self._device._write("COL O")


class UltrasonicSensor(Device):
    """Distance in mm, 2000 if nothing is near."""

    _kind = SensorKind.ULTRASONIC
    _mode = "DISTL"

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.lights = LightArray(self, 4)

    distance = _reading("DISTL", lambda self: self._machine.body.distance_mm(self._letter), "distance_mm")
    presence = _reading("LISTN", lambda self: False, "presence")
    """Presence of another ultrasonic sensor: there is none."""


class _ColorDevice(Device):
    _mode = "RGB I"

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self._detectable: Any = tuple(NAMED_COLORS[name] for name in ("RED", "YELLOW", "GREEN", "BLUE", "WHITE", "NONE"))

    def detectable_colors(self, colors: Any = None) -> Any:
        if colors is None:
            return self._detectable
        for candidate in get_array(colors):
            expect_type(candidate, Color)
        self._detectable = colors
        return None

    reflection = _reading("RGB I", lambda self: reflection_pct(self._plug.color()), "reflection_pct")

    def _hsv(self, mode: str, sense: Sense) -> Any:
        return self._measure(mode, lambda: Color(*self._plug.color(sense)), *_HSV)

    def _color(self, mode: str, sense: Sense) -> Any:
        def detected() -> Any:
            index = nearest(self._plug.color(sense), [(color.h, color.s, color.v) for color in self._detectable])
            return None if index is None else self._detectable[index]

        return self._measure(mode, detected, "color")


class ColorSensor(_ColorDevice):
    """SPIKE color sensor."""

    _kind = SensorKind.COLOR

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.lights = LightArray(self, 3)

    def hsv(self, surface: Any = True) -> Any:
        return self._hsv("RGB I", Sense.SURFACE) if surface else self._hsv("SHSV", Sense.AMBIENT)

    def color(self, surface: Any = True) -> Any:
        return self._color("RGB I", Sense.SURFACE) if surface else self._color("SHSV", Sense.AMBIENT)

    ambient = _reading("SHSV", lambda self: to_single(self._plug.ambient_pct()), "ambient_pct")


class ColorDistanceSensor(_ColorDevice):
    """Powered Up (BOOST) color and distance sensor."""

    _kind = SensorKind.COLOR_DISTANCE

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.light = ColorLight(self)

    hsv = _reading("RGB I", lambda self: Color(*self._plug.color(Sense.SURFACE)), *_HSV)

    def color(self) -> Any:
        return self._color("RGB I", Sense.SURFACE)

    ambient = _reading("AMBI", lambda self: round(self._plug.ambient_pct()), "ambient_pct")
    distance = _reading("PROX", lambda self: self._plug.proximity() * 10, "distance_pct")


class ForceSensor(Device):
    """A button on a spring, fully pressed at 10 N."""

    _kind = SensorKind.FORCE

    force = _reading("FRAW", lambda self: to_single(self._plug.force_mn() / 1000), "force_n")
    distance = _reading("FRAW", lambda self: to_single(self._moved_um() / 1000), "moved_mm")
    touched = _reading("FRAW", lambda self: self._moved_um() > _TOUCHED_UM, "touched")

    def pressed(self, force: Any = 3) -> Any:
        threshold_mn = int(get_number(force) * 1000)
        return self._measure("FRAW", lambda: self._plug.force_mn() >= threshold_mn, "pressed")

    def _moved_um(self) -> int:
        return self._plug.force_mn() * _TRAVEL_UM // MAX_FORCE_MN


class InfraredSensor(Device):
    """WeDo 2.0 motion sensor."""

    _kind = SensorKind.INFRARED

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self._first_count = self._plug.passed()

    count = _reading("LPF2-COUNT", lambda self: self._plug.passed() - self._first_count, "count")
    reflection = _reading("LPF2-CAL", lambda self: to_single(self._plug.infrared_raw() / 5), "reflection_pct")
    distance = _reading("LPF2-CAL", lambda self: 1100 // (10 + self._plug.infrared_raw()), "distance_pct")


class TiltSensor(Device):
    """WeDo 2.0 tilt sensor, up to 45 degrees."""

    _kind = SensorKind.TILT

    tilt = _reading("LPF2-ANGLE", lambda self: self._plug.tilt_deg(), "pitch_deg", "roll_deg")


class Light(Device):
    """Lamp, without effect."""

    _kind = SensorKind.LIGHT

    def on(self, brightness: Any = 100) -> None:
        get_int(brightness)

    def off(self) -> None:
        """Without effect."""


class ColorLightMatrix(Device):
    """Three rows of three lights, without effect."""

    _kind = SensorKind.COLOR_LIGHT_MATRIX

    def on(self, colors: Any) -> Any:
        pixels = iter((colors,) * 9 if isinstance(colors, Color) else colors)
        for _ in range(9):
            expect_type(next(pixels, None), Color)
        return self._write("PIX O")

    def off(self) -> Any:
        return self._write("PIX O")


class PFMotor(Native):
    """Power Functions motor, commanded by a color and distance sensor with infrared light; without effect."""

    def __init__(self, sensor: Any, channel: Any, color: Any, positive_direction: Any = Direction.CLOCKWISE) -> None:
        expect_type(sensor, ColorDistanceSensor)
        expect(1 <= get_int(channel) <= 4)
        expect_type(color, Color)
        expect(color.h in (NAMED_COLORS["BLUE"].h, NAMED_COLORS["RED"].h))
        expect_type(positive_direction, Direction)
        self._sensor, self._machine = sensor, sensor._machine

    def dc(self, duty: Any) -> Any:
        get_int(duty)
        return self._sensor._write("IR Tx", SEND_MS)

    def stop(self) -> Any:
        return self._sensor._write("IR Tx", SEND_MS)

    brake = stop


DEVICES: tuple[type[Device], ...] = tuple(globals()[kind.value] for kind in SensorKind)
