"""Sensors of ``pybricks.ev3devices`` on the robot's ports (``pb_type_ev3devices_*.c``, v4)."""

from typing import Any

from brickhub.robot import Sense, SensorKind
from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.containers import HubSet
from brickhub.virtual.pybricks.arguments import expect, expect_type, get_int, os_error, truncated
from brickhub.virtual.pybricks.ev3.ev3_modes import (
    BEACON_DEG_PER_UNIT,
    BUTTONS_OF_CODE,
    CHANNELS,
    KEYPAD_BITS,
    KEYPAD_NONE,
    KNOWN_COLORS,
    NO_BEACON,
    RGB_SCALES,
    button_code,
    color_number,
    keypad_bits,
    proximity_pct,
    raw_rgb,
    red_pct,
    seen_beacon,
    sent_rotation,
)
from brickhub.virtual.pybricks.parameters import NAMED_COLORS, Button, Direction
from brickhub.virtual.pybricks.pupsensors import Device, _reading
from brickhub.virtual.stimuli import number, rotation

_PRESSED_N = 0.5
"""Force that presses the button of a touch sensor; an estimate."""
_GYRO_SETTLE_MS = 100
_GYRO_OFF_MS = 300
"""Time without power that lets a gyroscope begin anew."""


class Ev3Device(Device):
    """A sensor on one of the ports that take sensors."""

    def __init__(self, port: Any) -> None:
        letter = self._context.port_letter(port)
        # A motor's port has no serial line, and a sensor there nobody who would ask for it.
        if letter not in self._machine.robot.hub.model.takes(self._kind.model):
            raise os_error(error_numbers.EOPNOTSUPP)
        super().__init__(port)


class TouchSensor(Ev3Device):
    _kind = SensorKind.EV3_TOUCH

    pressed = _reading("", lambda self: self._is_pressed(), "pressed")

    def _is_pressed(self) -> bool:
        return number(self._plug.sensed(Sense.FORCE)) >= _PRESSED_N


class ColorSensor(Ev3Device):
    _kind = SensorKind.EV3_COLOR

    reflection = _reading("COL-REFLECT", lambda self: red_pct(self._plug), "reflection_pct")
    ambient = _reading("COL-AMBIENT", lambda self: round(self._plug.ambient_pct()), "ambient_pct")

    def color(self) -> Any:
        def detected() -> Any:
            seen = color_number(self._plug)
            name = KNOWN_COLORS[seen - 1] if seen else "NONE"
            return NAMED_COLORS[name]

        return self._measure("COL-COLOR", detected, "color")

    def rgb(self) -> Any:
        def percents() -> tuple[int, ...]:
            scaled = []
            for raw, (factor, offset) in zip(raw_rgb(self._plug), RGB_SCALES, strict=True):
                scaled.append(max(0, min(100, truncated(factor * raw - offset))))
            return tuple(scaled)

        return self._measure("RGB-RAW", percents, "red_pct", "green_pct", "blue_pct")


class UltrasonicSensor(Ev3Device):
    """Distance in mm, 2550 if nothing is near."""

    _kind = SensorKind.EV3_ULTRASONIC

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self._silent_mm = 0

    def distance(self, silent: Any = False) -> Any:
        if not silent:
            return self._measure("US-DIST-CM", self._distance_mm, "distance_mm")
        # In this mode the sensor measures once, when it is selected.
        if self._mode.name != "US-SI-CM":
            self._silent_mm = self._distance_mm()
        return self._measure("US-SI-CM", lambda: self._silent_mm, "distance_mm")

    presence = _reading("US-LISTEN", lambda self: False, "presence")
    """Presence of another ultrasonic sensor: there is none."""

    def _distance_mm(self) -> int:
        return self._machine.body.distance_mm(self._letter)


class GyroSensor(Ev3Device):
    """Angle and rate about the sensor's axis; the angle is 0 where the program begins."""

    _kind = SensorKind.EV3_GYRO

    def __init__(
        self,
        port: Any,
        direction: Any = Direction.CLOCKWISE,
    ) -> None:
        super().__init__(port)
        # The sensor takes no other mode before it has sent something in its first one.
        if self._mode.name != "GYRO-G&A":
            self._machine.advance(_GYRO_SETTLE_MS)
            self._set_mode("GYRO-G&A")
            self._finish(None)
        expect_type(direction, Direction)
        self._sign = 1 if direction is Direction.CLOCKWISE else -1
        # What the sensor itself takes for 0, and for rest, since when, and what the program takes
        # for 0.
        self._sensor_zero_deg = 0.0
        self._rest_deg_s = 0.0
        self._since_ms = 0
        self._zero_deg = 0
        self._zero_deg = self._angle_deg()

    def angle(self) -> int:
        self._check_mode()
        angle_deg = self._angle_deg()
        self._log("angle_deg", angle_deg)
        return angle_deg

    def speed(self) -> int:
        self._check_mode()
        _, rate_deg_s = self._turned()
        self._log("rate_deg_s", rate_deg_s * self._sign)
        return rate_deg_s * self._sign

    def reset_angle(self, angle: Any) -> None:
        new_deg = get_int(angle)
        self._check_mode()
        self._zero_deg += self._angle_deg() - new_deg

    def calibrate(self) -> Any:
        """Switch the sensor off and on; it must rest meanwhile."""
        if not self._is_ready():
            raise os_error(error_numbers.EAGAIN)
        off_and_on_ms = _GYRO_OFF_MS + 2 * _GYRO_SETTLE_MS
        begin_ms = self._told_ms()
        before_deg, _ = rotation(self._plug.sensed(Sense.ROTATION))
        self._mode.ready_ms = begin_ms + off_and_on_ms

        def begin() -> None:
            # Whatever it turns by meanwhile is rest to the sensor from now on.
            now_ms = self._machine.time_ms
            now_deg, _ = rotation(self._plug.sensed(Sense.ROTATION))
            self._rest_deg_s = (now_deg - before_deg) * 1000 / max(now_ms - begin_ms, 1)
            self._sensor_zero_deg = now_deg
            self._since_ms = now_ms

        return self._finish(begin)

    def _turned(self) -> tuple[int, int]:
        """Angle and rate, as the sensor sends them."""
        angle_deg, rate_deg_s = rotation(self._plug.sensed(Sense.ROTATION))
        at_rest_deg = self._rest_deg_s * (self._machine.time_ms - self._since_ms) / 1000
        return sent_rotation(
            angle_deg - self._sensor_zero_deg - at_rest_deg, rate_deg_s - self._rest_deg_s
        )

    def _angle_deg(self) -> int:
        angle_deg, _ = self._turned()
        return angle_deg * self._sign - self._zero_deg

    def _check_mode(self) -> None:
        if not self._is_ready():
            raise os_error(error_numbers.EAGAIN)
        if self._mode.name != "GYRO-G&A":
            raise os_error(error_numbers.EPERM)

    def _log(self, quantity: str, value: int) -> None:
        log = self._machine.log
        if log is not None:
            log.read([f"{self._letter}_{quantity}"], value)


class InfraredSensor(Ev3Device):
    """Distance in %, and the infrared beacon, which is a remote control too; it is on channel 1."""

    _kind = SensorKind.EV3_INFRARED

    distance = _reading("IR-PROX", lambda self: proximity_pct(self._plug), "distance_pct")

    def beacon(self, channel: Any) -> Any:
        number_of_channel = _channel(channel)

        def seen() -> tuple[int | None, int | None]:
            direction, distance_pct = seen_beacon(self._plug)
            if number_of_channel != 1 or distance_pct == NO_BEACON:
                return None, None
            return distance_pct, direction * BEACON_DEG_PER_UNIT

        return self._measure("IR-SEEK", seen, "beacon_pct", "beacon_deg")

    def buttons(self, channel: Any) -> Any:
        number_of_channel = _channel(channel)

        def down() -> HubSet:
            code = button_code(self._plug) if number_of_channel == 1 else 0
            return HubSet(getattr(Button, name.upper()) for name in BUTTONS_OF_CODE[code])

        return self._measure("IR-REMOTE", down, "buttons")

    def keypad(self) -> Any:
        def down() -> list[Any]:
            bits = keypad_bits(self._plug)
            # No button is a number of its own, which has the last one's bit too.
            if bits == KEYPAD_NONE:
                return []
            names = [name for name, bit in KEYPAD_BITS.items() if bits & bit]
            return [getattr(Button, name.upper()) for name in names]

        return self._measure("IR-REM-A", down, "keypad")


def _channel(value: Any) -> int:
    channel = get_int(value)
    expect(1 <= channel <= CHANNELS)
    return channel


EV3_SENSORS: tuple[type[Ev3Device], ...] = (
    TouchSensor,
    ColorSensor,
    UltrasonicSensor,
    GyroSensor,
    InfraredSensor,
)
