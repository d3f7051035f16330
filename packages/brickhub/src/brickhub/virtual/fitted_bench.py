"""Bench that provides the devices that a program uses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from brickhub.errors import TwinError
from brickhub.robot import HubKind, MotorKind, Robot, Sense, SensorKind
from brickhub.virtual.bench_body import BenchBody, BenchMotor
from brickhub.virtual.given_readings import GivenReading, for_port
from brickhub.virtual.stimuli import Sensed

_MOTORS = ("Motor", "DCMotor")
_STALL_TRAVEL_MDEG = 90_000.0
_HEADING_PER_WHEEL = 0.25  # wheels of 56 mm, 112 mm apart
_FARTHEST_PCT = 100.0
_DEFAULTS: Mapping[Sense, Sensed] = {
    Sense.SURFACE: (0.0, 0.0, 0.0),
    Sense.AMBIENT: 0.0,
    Sense.DISTANCE: _FARTHEST_PCT,
    Sense.FORCE: 0.0,
    Sense.TILT: (0.0, 0.0),
    Sense.COUNT: 0.0,
}


class FittedBench(BenchBody):
    """A hub without devices until a program uses them; motors turn freely, sensors have given readings.

    With motors, the hub is mounted as the program says; alone, it lies flat. With a drive base, it turns as the wheels do.
    Without one, the first two motors are wheels if they are of one kind and their positive directions are opposite. A motor that
    runs until it stalls is blocked after 90 degrees. Raises TwinError if a reading is for a port that the hub does not have.

    Args:
        hub: kind of hub.
        readings: of sensors; without one a sensor sees nothing near, dark, untouched and level.
        end_stops: lowest and highest angle of the motor on a port, deg of the shaft.
        report: called with a line about what the bench assumes.
    """

    def __init__(
        self,
        hub: HubKind,
        readings: Iterable[GivenReading] = (),
        end_stops: Mapping[str, tuple[float, float]] | None = None,
        report: Callable[[str], object] = lambda line: None,
    ) -> None:
        super().__init__(Robot("bench", hub, needs_imu=hub.model.has_imu))
        self._given_readings = list(readings)
        self._stops = dict(end_stops or {})
        self.motors: dict[str, MotorKind] = {}
        self._devices: dict[str, str] = {}
        self._turns: dict[str, float] = {}
        self._heading_offset_deg = 0.0
        self._report: Callable[[str], object] | None = report
        self._up = (0.0, 0.0, 1.0)
        for port in (*(reading.port for reading in self._given_readings), *self._stops):
            if port not in hub.model.ports:
                raise TwinError(f"the {hub.value} hub has no port {port}; it has {', '.join(hub.model.ports)}")

    def plug_in(self, port: str, device: str) -> bool:
        """Plug in a device of a class of ``pybricks.pupdevices``. Returns whether the port was free or has it already. Raises
        TwinError if the port's reading does not suit the device."""
        if port in self._devices:
            return self._devices[port] == device
        self._devices[port] = device
        if device in _MOTORS:
            self.motors[port] = MotorKind.SPIKE_MEDIUM
            low, high = self._stops.get(port, (None, None))
            self._motors[port] = BenchMotor(None if low is None or high is None else (low * 1000.0, high * 1000.0))
            return True
        for reading in for_port(self._given_readings, port):
            reading.check(self._sense_of(reading, device), device)
        return True

    def block(self, port: str, direction: int) -> None:
        motor = self._motors[port]
        low, high = motor.stops or (-math.inf, math.inf)
        if direction > 0 and high == math.inf:
            motor.stops = low, motor.angle + _STALL_TRAVEL_MDEG
        elif direction < 0 and low == -math.inf:
            motor.stops = motor.angle - _STALL_TRAVEL_MDEG, high

    @property
    def turns_with_its_wheels(self) -> bool:  # type: ignore[override]
        return bool(self._turns)

    def put_on_wheels(self, turns: Mapping[str, float]) -> None:
        heading_deg, self._turns = self.heading_deg(), dict(turns)
        self._heading_offset_deg += heading_deg - self.heading_deg()

    def find_wheels(self, directions: Mapping[str, int]) -> None:
        pair = list(directions)[:2]
        if self._report is None or self._turns or len(pair) < 2 or not any(self._motors[port].angle for port in pair):
            return
        first, second = pair
        if directions[first] != directions[second] and self._devices[first] == self._devices[second]:
            self._turns = dict.fromkeys(pair, -_HEADING_PER_WHEEL / 1000.0)
            self._report(
                f"The bench takes the motors on ports {first} and {second} for wheels, as they come first and their positive "
                "directions are opposite: the hub turns with them."
            )
        else:
            self._report(
                "The hub lies still on the bench: its first two motors are not taken for wheels, as they are not of one kind "
                "with opposite positive directions. It turns with a drive base; or take a robot, such as --robot two-wheeler."
            )
        self._report = None

    def mount(self, up: tuple[float, float, float]) -> None:
        x, y, z = up
        self._up = x + 0.0, y + 0.0, z + 0.0  # -0.0 would change the roll of a hub on end by 180 degrees

    def heading_deg(self) -> float:
        return self._heading_offset_deg + sum(turn * self._motors[port].angle for port, turn in self._turns.items())

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return self._about_vertical(sum(turn * self._motors[port].speed for port, turn in self._turns.items()))

    def rotation_deg(self) -> tuple[float, float, float]:
        return self._about_vertical(self.heading_deg())

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        at_rest = super().acceleration_mm_s2()
        if not self.motors:
            return at_rest
        x, y, z = (at_rest[2] * component for component in self._up)
        return x, y, z

    def tilt_deg(self) -> tuple[float, float]:
        if not self.motors:
            return super().tilt_deg()
        x, y, z = self._up
        return math.degrees(math.atan2(-x, math.hypot(y, z))), math.degrees(math.atan2(y, z))

    def device(self, port: str) -> str | None:
        """Class name of the device on a port."""
        return self._devices.get(port)

    def sensed(self, port: str, sense: Sense) -> Sensed:
        """The given reading at the current time."""
        device = self._devices[port]
        for reading in for_port(self._given_readings, port):
            if self._sense_of(reading, device) is sense:
                return reading.at(self._time_ms / 1000)
        range_mm = SensorKind(device).model.range_mm
        return _DEFAULTS[sense] if range_mm is None else range_mm[1]

    def distance_mm(self, port: str) -> int:
        sensed: Any = self.sensed(port, Sense.DISTANCE)
        return min(max(round(float(sensed)), 40), 2000)

    def _about_vertical(self, clockwise: float) -> tuple[float, float, float]:
        x, y, z = self._up
        return -clockwise * x, -clockwise * y, -clockwise * z

    @staticmethod
    def _sense_of(reading: GivenReading, device: str) -> Sense:
        """Sense of a reading. Raises TwinError if the device has no such sense."""
        available = SensorKind(device).model.senses
        if reading.sense is None and available:
            return available[0]
        if reading.sense not in available:
            names = " or ".join(available) or "nothing"
            raise TwinError(f"the {device} on port {reading.port} senses {names}, not {reading.sense}; give such a reading")
        return reading.sense
