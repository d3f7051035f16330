"""Sensors and lights of ``pybricks.pupdevices`` on the robot's ports."""

from collections.abc import Callable
from typing import Any

from brickhub.robot import Sense, SensorKind
from brickhub.virtual import error_numbers
from brickhub.virtual.machine import PortMode
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_array,
    get_int,
    get_number,
    os_error,
    truncated,
)
from brickhub.virtual.pybricks.context import Native
from brickhub.virtual.pybricks.device_modes import SENSOR_MODES
from brickhub.virtual.pybricks.parameters import NAMED_COLORS, Color, Direction, nearest
from brickhub.virtual.pybricks.plug import MAX_FORCE_MN, DeviceModes, Plug
from brickhub.virtual.stimuli import Hsv

_TRAVEL_UM = 6670
"""Way of the force sensor's button from released to fully pressed."""
_TOUCHED_UM = 100
_START_MS = 50
"""Time between two looks whether a device is ready, when a program takes it into use."""
_HSV = ("hue_deg", "saturation_pct", "value_pct")
# What was written takes this time (`lego_device_data_set_delay`), in one mode and in others.
_DELAYS_MS = {"IR Tx": 250}
_DELAY_MS = 10


class Device(Native):
    """A device on a port.

    Measurements depend on the mode. After a change of mode values are stale for some time, for
    which reads wait; meanwhile, nobody can change it again.
    """

    _kind: SensorKind
    _read_first: tuple[str, ...] = ()
    """Modes that the constructor reads."""
    _device_modes: DeviceModes

    def __init__(self, port: Any) -> None:
        self._context.assert_blocking()
        self._letter = self._context.port_letter(port)
        if not self._is_plugged_in():
            raise os_error(error_numbers.ENODEV)
        # The mode belongs to the port, so it outlasts this object.
        first_mode = PortMode(self._device_modes.first_mode)
        self._mode = self._machine.modes.setdefault(self._letter, first_mode)
        while not self._is_ready():
            self._machine.advance(_START_MS)
        self._plug = Plug(self._machine, self._letter)
        for mode in self._read_first:
            self._set_mode(mode)
            self._finish(None)

    def _is_plugged_in(self) -> bool:
        self._device_modes = SENSOR_MODES[self._kind]
        # One of the user's own is there in place of a sensor.
        if self._letter in self._machine.own_devices:
            return False
        if self._machine.plug_in(self._letter, self._kind.value):
            return True
        for sensor in self._machine.robot.sensors:
            if sensor.port == self._letter and sensor.kind == self._kind:
                return True
        return False

    def _measure(
        self,
        mode: str,
        get: Callable[[], Any],
        *quantities: str,
    ) -> Any:
        """Value of ``get`` in a mode of the device; ``quantities`` are its parts' names in the log
        of the run."""

        def measured() -> Any:
            # Another task has changed the mode before the driver knew that this one was asked for.
            if self._mode.name != mode:
                raise os_error(error_numbers.EPERM)
            value = get()
            log = self._machine.log
            if log is not None:
                columns = [f"{self._letter}_{quantity}" for quantity in quantities]
                parts = value
                if quantities == _HSV:
                    parts = (value.h, value.s, value.v)
                log.read(columns, parts)
            return value

        self._set_mode(mode)
        return self._finish(measured)

    def _show(self, brightness_pct: int) -> None:
        """Show the brightness of its light on the panel."""
        panel = self._machine.panel
        limited_pct = max(0, min(100, brightness_pct))
        # The dict is a new one, because the panel notices a change by comparing the old with the
        # new one.
        panel.change(lamps={**panel.lamps, self._letter: limited_pct})

    def _write(self, mode: str) -> Any:
        """Command without a visible effect; waits until it is done."""
        self._set_mode(mode)
        delay_ms = _DELAYS_MS.get(mode, _DELAY_MS)
        # A change of mode may take longer than the command itself.
        done_ms = self._told_ms() + delay_ms + 1
        self._mode.ready_ms = max(self._mode.ready_ms, done_ms)
        return self._finish(None)

    def _set_mode(self, mode: str) -> None:
        """Begin a change of mode, unless it is in that mode. Raises OSError (EAGAIN) during another
        change or command."""
        state = self._mode
        machine = self._machine
        # Until the device has received a change, its driver takes it to be in the former mode.
        is_in_previous = mode == state.previous and machine.body_ms <= state.changed_ms
        if mode == state.name or is_in_previous:
            return
        if not self._is_ready():
            raise os_error(error_numbers.EAGAIN)
        state.previous = state.name
        state.name = mode
        state.changed_ms = self._told_ms()
        stale_ms = self._device_modes.stale_ms(mode)
        state.ready_ms = state.changed_ms + stale_ms + 1

    def _told_ms(self) -> int:
        """Time at which the device answers to what it is told now: in the next millisecond if the
        hub has done what is due in this one, as before a program begins."""
        machine = self._machine
        if machine.time_ms == self._context.start_ms:
            return machine.time_ms + 1
        return machine.body_ms

    def _is_ready(self) -> bool:
        return self._machine.time_ms >= self._mode.ready_ms

    def _finish(self, result: Callable[[], Any] | None) -> Any:
        """Wait until the device is ready, or return an awaitable."""
        # The time is known, so one look at its end is enough.
        remaining_ms = self._mode.ready_ms - self._machine.time_ms
        return self._context.finish(self._is_ready, result, poll_ms=max(1, remaining_ms))


def _reading(
    mode: str,
    get: Callable[[Any], Any],
    *quantities: str,
) -> Callable[..., Any]:
    """A method that measures in one mode, as :meth:`Device._measure`."""

    def read(self: Device) -> Any:
        return self._measure(mode, lambda: get(self), *quantities)

    return read


class LightArray(Native):
    """Lights around the eye of a sensor; the panel shows the brightest."""

    def __init__(
        self,
        device: Device,
        count: int,
    ) -> None:
        self._device = device
        self._machine = device._machine
        self._count = count

    def on(self, brightness: Any = 100) -> Any:
        is_sequence = isinstance(brightness, list | tuple)
        values = brightness if is_sequence else (brightness,) * self._count
        if len(values) != self._count:
            raise ValueError(f"expected 1 number or tuple of {self._count} values")
        self._device._show(max(map(get_int, values)))
        return self._device._write("LIGHT")

    def off(self) -> Any:
        self._device._show(0)
        return self._device._write("LIGHT")


# This class has no name in the firmware either.
LightArray.__name__ = ""


class ColorLight(Native):
    """Light of a device; ``command`` tells the device its color, without a visible effect."""

    def __init__(
        self,
        device: Any,
        command: Callable[[], Any],
    ) -> None:
        self._machine = device._machine
        self._command = command

    def on(self, color: Any) -> Any:
        expect_type(color, Color)
        return self._command()

    def off(self) -> Any:
        return self._command()


class UltrasonicSensor(Device):
    """Distance in mm, 2000 if nothing is near."""

    _kind = SensorKind.ULTRASONIC

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.lights = LightArray(self, 4)

    distance = _reading(
        "DISTL", lambda self: self._machine.body.distance_mm(self._letter), "distance_mm"
    )
    presence = _reading("LISTN", lambda self: False, "presence")
    """Presence of another ultrasonic sensor: there is none."""


class _ColorDevice(Device):
    _is_boost = False

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        names = ("RED", "YELLOW", "GREEN", "BLUE", "WHITE", "NONE")
        self._detectable: Any = tuple(NAMED_COLORS[name] for name in names)

    def detectable_colors(self, colors: Any = None) -> Any:
        if colors is None:
            return self._detectable
        for candidate in get_array(colors):
            expect_type(candidate, Color)
        # The program's own list is kept and not a copy, because on a hub its later changes count
        # too.
        self._detectable = colors
        return None

    def reflection(self) -> Any:
        # All three channels count together: 400 each are full for the BOOST sensor, and 1024 for
        # SPIKE's.
        full = 12 * 100 if self._is_boost else 3 * 1024

        def reflection_pct() -> int:
            channels = self._plug.raw_rgb(self._is_boost)
            return sum(channels) * 100 // full

        return self._measure("RGB I", reflection_pct, "reflection_pct")

    def hsv(self, surface: Any = True) -> Any:
        mode = "RGB I" if surface else "SHSV"
        return self._measure(mode, lambda: Color(*self._seen(surface)), *_HSV)

    def color(self, surface: Any = True) -> Any:
        def detected() -> Any:
            seen_color = self._seen(surface)
            candidates = [(color.h, color.s, color.v) for color in self._detectable]
            index = nearest(seen_color, candidates)
            return None if index is None else self._detectable[index]

        mode = "RGB I" if surface else "SHSV"
        return self._measure(mode, detected, "color")

    def _seen(self, surface: Any) -> Hsv:
        """Color of a surface in the sensor's light, or of the incoming light."""
        if surface:
            return self._plug.reflected_hsv(self._is_boost)
        return self._plug.color(Sense.AMBIENT)


class ColorSensor(_ColorDevice):
    """SPIKE color sensor."""

    _kind = SensorKind.COLOR
    _read_first = ("RGB I",)

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.lights = LightArray(self, 3)

    ambient = _reading(
        "SHSV", lambda self: to_single(round(self._plug.ambient_pct() * 10) / 100), "ambient_pct"
    )
    """Of what the sensor sends, tenths of a percent, the firmware makes a tenth."""


class ColorDistanceSensor(_ColorDevice):
    """Powered Up (BOOST) color and distance sensor."""

    _kind = SensorKind.COLOR_DISTANCE
    _is_boost = True

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.light = ColorLight(self, lambda: self._write("COL O"))

    # This sensor cannot measure without its own light, so both methods take no argument.

    def hsv(self) -> Any:  # type: ignore[override]
        return super().hsv()

    def color(self) -> Any:  # type: ignore[override]
        return super().color()

    ambient = _reading("AMBI", lambda self: round(self._plug.ambient_pct()), "ambient_pct")
    distance = _reading("PROX", lambda self: self._plug.proximity() * 10, "distance_pct")


class ForceSensor(Device):
    """A button on a spring, fully pressed at 10 N."""

    _kind = SensorKind.FORCE
    _read_first = ("CALIB", "FRAW")

    force = _reading("FRAW", lambda self: to_single(self._plug.force_mn() / 1000), "force_n")
    distance = _reading("FRAW", lambda self: to_single(self._moved_um() / 1000), "moved_mm")
    touched = _reading("FRAW", lambda self: self._moved_um() > _TOUCHED_UM, "touched")

    def pressed(self, force: Any = 3) -> Any:
        threshold_mn = truncated(get_number(force) * 1000)
        return self._measure("FRAW", lambda: self._plug.force_mn() >= threshold_mn, "pressed")

    def _moved_um(self) -> int:
        return self._plug.force_mn() * _TRAVEL_UM // MAX_FORCE_MN


class InfraredSensor(Device):
    """WeDo 2.0 motion sensor."""

    _kind = SensorKind.INFRARED
    _read_first = ("LPF2-COUNT", "LPF2-CAL")

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        # The device counts since it was plugged in, but a program since it began.
        self._first_count = self._plug.passed()

    count = _reading("LPF2-COUNT", lambda self: self._plug.passed() - self._first_count, "count")
    reflection = _reading(
        "LPF2-CAL", lambda self: to_single(self._plug.infrared_raw() / 5), "reflection_pct"
    )
    distance = _reading(
        "LPF2-CAL", lambda self: 1100 // (10 + self._plug.infrared_raw()), "distance_pct"
    )


class TiltSensor(Device):
    """WeDo 2.0 tilt sensor, up to 45 degrees."""

    _kind = SensorKind.TILT

    tilt = _reading(
        "LPF2-ANGLE",
        lambda self: self._plug.tilt_deg(),
        "pitch_deg",
        "roll_deg",
    )


class Light(Device):
    """Lamp; the panel shows its brightness."""

    _kind = SensorKind.LIGHT

    def on(self, brightness: Any = 100) -> None:
        self._show(get_int(brightness))

    def off(self) -> None:
        self._show(0)


class ColorLightMatrix(Device):
    """Three rows of three lights, without effect."""

    _kind = SensorKind.COLOR_LIGHT_MATRIX

    def on(self, colors: Any) -> Any:
        # One color is for all lights. If one of nine is missing, its light has no color.
        nine = (colors,) * 9 if isinstance(colors, Color) else colors
        pixels = iter(nine)
        for _ in range(9):
            expect_type(next(pixels, None), Color)
        return self._write("PIX O")

    def off(self) -> Any:
        return self._write("PIX O")


class PFMotor(Native):
    """Power Functions motor, commanded by a color and distance sensor with infrared light; without
    effect."""

    def __init__(
        self,
        sensor: Any,
        channel: Any,
        color: Any,
        positive_direction: Any = Direction.CLOCKWISE,
    ) -> None:
        expect_type(sensor, ColorDistanceSensor)
        expect(1 <= get_int(channel) <= 4)
        expect_type(color, Color)
        expect(color.h in (NAMED_COLORS["BLUE"].h, NAMED_COLORS["RED"].h))
        expect_type(positive_direction, Direction)
        self._sensor = sensor
        self._machine = sensor._machine

    def dc(self, duty: Any) -> Any:
        get_int(duty)
        return self._sensor._write("IR Tx")

    def stop(self) -> Any:
        return self._sensor._write("IR Tx")

    brake = stop


def _own_devices() -> tuple[type[Device], ...]:
    """The classes of this module's kinds of sensors, which are named after them."""
    models = [kind.model for kind in SensorKind]
    return tuple(globals()[model.name] for model in models if model.module == "pupdevices")


DEVICES = _own_devices()
