"""Sensors and lights of ``pybricks.pupdevices`` on the robot's ports."""

from __future__ import annotations

import errno
from collections.abc import Callable
from functools import partial
from typing import Any

from brickhub.robot import Sense, SensorKind
from brickhub.virtual.body import SensingBody
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.colors import nearest
from brickhub.virtual.pybricks.context import RunLoop, expect_type, get_array, get_int, get_number, os_error
from brickhub.virtual.pybricks.device_modes import MAX_FORCE_MN, SENSOR_MODES, Plug
from brickhub.virtual.pybricks.parameters import NAMED_COLORS, Color, Direction, Parameters
from brickhub.virtual.run_log import RunLog
from brickhub.virtual.stimuli import reflection_pct

_TRAVEL_UM = 6670
_TOUCHED_UM = 100
_HSV = ("hue_deg", "saturation_pct", "value_pct")
SEND_MS = 250
WRITE_MS = 11  # above the 10 ms of lego_device_data_set_delay


class Device:
    """A device on a port.

    Measurements depend on the mode. After a mode change values are stale for ``_switch_ms`` (``lego_device_stale_data_delay``),
    and reads wait that long.
    """

    _machine: Machine
    _loop: RunLoop
    _parameters: Parameters
    _kind: SensorKind
    _mode = ""
    _switch_ms = 0

    def __init__(self, port: Any) -> None:
        self._loop.assert_blocking()
        self._letter = self._parameters.port_letter(port)
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
        self._machine.charge_call()
        if self._machine.log is not None:
            get = partial(self._logged, self._machine.log, get, quantities)
        previous_mode = self._machine.modes[self._letter]
        self._machine.modes[self._letter] = mode
        if mode == previous_mode or not self._switch_ms:
            return self._loop.value(get)
        ready_ms = self._machine.time_ms + self._switch_ms
        return self._loop.finish(lambda: self._machine.time_ms >= ready_ms, get, poll_ms=self._switch_ms)

    def _logged(self, log: RunLog, get: Callable[[], Any], quantities: tuple[str, ...]) -> Any:
        value = get()
        parts = (value.h, value.s, value.v) if quantities == _HSV else value
        log.read([f"{self._letter}_{quantity}" for quantity in quantities], parts)
        return value

    def _write(self, mode: str, duration_ms: int = WRITE_MS) -> Any:
        """Command without a visible effect; waits until it is done."""
        self._machine.charge_call()
        self._machine.modes[self._letter] = mode
        return self._loop.wait_until(self._machine.time_ms + duration_ms)


class LightArray:
    """Lights around the eye of a sensor, without effect; values are checked."""

    def __init__(self, device: Device, count: int) -> None:
        self._device = device
        self._count = count

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


class ColorLight:
    """The light of the color and distance sensor."""

    def __init__(self, device: Device) -> None:
        self._device = device

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

    def distance(self) -> Any:
        return self._measure("DISTL", lambda: self._machine.body.distance_mm(self._letter), "distance_mm")

    def presence(self) -> Any:
        """Presence of another ultrasonic sensor: there is none."""
        return self._measure("LISTN", lambda: False, "presence")


class _ColorDevice(Device):
    _mode = "RGB I"

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self._detectable: Any = tuple(NAMED_COLORS[name] for name in ("RED", "YELLOW", "GREEN", "BLUE", "WHITE", "NONE"))

    def detectable_colors(self, colors: Any = None) -> Any:
        self._machine.charge_call()
        if colors is None:
            return self._detectable
        for candidate in get_array(colors):
            expect_type(candidate, Color)
        self._detectable = colors
        return None

    def reflection(self) -> Any:
        return self._measure("RGB I", lambda: reflection_pct(self._plug.color()), "reflection_pct")

    def _hsv(self, mode: str, sense: Sense) -> Any:
        return self._measure(mode, lambda: Color(*self._plug.color(sense)), *_HSV)

    def _color(self, mode: str, sense: Sense) -> Any:
        return self._measure(mode, lambda: self._nearest(sense), "color")

    def _nearest(self, sense: Sense) -> Any:
        index = nearest(self._plug.color(sense), [(color.h, color.s, color.v) for color in self._detectable])
        return None if index is None else self._detectable[index]


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

    def ambient(self) -> Any:
        return self._measure("SHSV", lambda: to_single(self._plug.ambient_pct()), "ambient_pct")


class ColorDistanceSensor(_ColorDevice):
    """Powered Up (BOOST) color and distance sensor."""

    _kind = SensorKind.COLOR_DISTANCE

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.light = ColorLight(self)

    def hsv(self) -> Any:
        return self._hsv("RGB I", Sense.SURFACE)

    def color(self) -> Any:
        return self._color("RGB I", Sense.SURFACE)

    def ambient(self) -> Any:
        return self._measure("AMBI", lambda: round(self._plug.ambient_pct()), "ambient_pct")

    def distance(self) -> Any:
        """In steps of ten."""
        return self._measure("PROX", lambda: self._plug.proximity() * 10, "distance_pct")


class ForceSensor(Device):
    """A button on a spring, fully pressed at 10 N."""

    _kind = SensorKind.FORCE

    def force(self) -> Any:
        return self._measure("FRAW", lambda: to_single(self._plug.force_mn() / 1000), "force_n")

    def distance(self) -> Any:
        return self._measure("FRAW", lambda: to_single(self._moved_um() / 1000), "moved_mm")

    def pressed(self, force: Any = 3) -> Any:
        threshold_mn = int(get_number(force) * 1000)
        return self._measure("FRAW", lambda: self._plug.force_mn() >= threshold_mn, "pressed")

    def touched(self) -> Any:
        return self._measure("FRAW", lambda: self._moved_um() > _TOUCHED_UM, "touched")

    def _moved_um(self) -> int:
        return self._plug.force_mn() * _TRAVEL_UM // MAX_FORCE_MN


class InfraredSensor(Device):
    """WeDo 2.0 motion sensor."""

    _kind = SensorKind.INFRARED

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self._first_count = self._plug.passed()

    def count(self) -> Any:
        return self._measure("LPF2-COUNT", lambda: self._plug.passed() - self._first_count, "count")

    def reflection(self) -> Any:
        return self._measure("LPF2-CAL", lambda: to_single(self._plug.infrared_raw() / 5), "reflection_pct")

    def distance(self) -> Any:
        return self._measure("LPF2-CAL", lambda: 1100 // (10 + self._plug.infrared_raw()), "distance_pct")


class TiltSensor(Device):
    """WeDo 2.0 tilt sensor, up to 45 degrees."""

    _kind = SensorKind.TILT

    def tilt(self) -> Any:
        return self._measure("LPF2-ANGLE", self._plug.tilt_deg, "pitch_deg", "roll_deg")


class Light(Device):
    """Lamp, without effect."""

    _kind = SensorKind.LIGHT

    def on(self, brightness: Any = 100) -> None:
        self._machine.charge_call()
        get_int(brightness)

    def off(self) -> None:
        self._machine.charge_call()


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


class PFMotor:
    """Power Functions motor, commanded by a color and distance sensor with infrared light; without effect."""

    def __init__(self, sensor: Any, channel: Any, color: Any, positive_direction: Any = Direction.CLOCKWISE) -> None:
        expect_type(sensor, ColorDistanceSensor)
        if not 1 <= get_int(channel) <= 4:
            raise ValueError("Invalid argument")
        expect_type(color, Color)
        if color.h not in (NAMED_COLORS["BLUE"].h, NAMED_COLORS["RED"].h):
            raise ValueError("Invalid argument")
        expect_type(positive_direction, Direction)
        self._sensor = sensor

    def dc(self, duty: Any) -> Any:
        get_int(duty)
        return self._send()

    def stop(self) -> Any:
        return self._send()

    def brake(self) -> Any:
        return self._send()

    def _send(self) -> Any:
        return self._sensor._write("IR Tx", SEND_MS)


DEVICES: tuple[type[Device], ...] = tuple(globals()[kind.value] for kind in SensorKind)
