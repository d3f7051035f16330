"""Results of a measuring session: numbers from its log, beside those of the twin, and the twin
fitted to them.

A number of a robot depends on a parameter of its twin linearly, near enough. So a twin that is
measured in the same way shows by how much each parameter is off.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from brickhub.robot import Robot, UltrasonicSensor
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.measure.hands import SimulatedPerson
from bricktwin.measure.session import TURNED_DEG, WALL_MM, Row, SessionLog, measure
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.physics import PARAMETERS, Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

LATE_MS = 150.0
_ENDS = 5  # answers at either end of the rest, whose mean counts
_STARTING_MS = 400
_GRAVITY_MM_S2 = 9810.0
_EXACT = {"error_deg": 0.0, "error_s": 0.0}


@dataclass(frozen=True)
class Quantity:
    """A number of a robot.

    Attributes:
        parameter: parameter of the twin on which it depends; "" for none.
        factor: change of the number for one unit of the parameter; ``None`` where it is in
            proportion to it.
    """

    name: str
    unit: str
    parameter: str = ""
    factor: float | None = 1.0


PAUSE_MS = 300.0
"""Time without an exchange after which the next one is late for that alone, and says nothing of the
others."""


def quantities(robot: Robot) -> tuple[Quantity, ...]:
    """All that can be measured of a robot."""
    tilt_deg = math.degrees(1.0 / _GRAVITY_MM_S2)
    motors = []
    for number, motor in enumerate(robot.motors, 1):
        motors += [
            Quantity(f"speed of {motor.name}, free", "deg/s", f"motor_{number}_scale", None),
            Quantity(f"battery with {motor.name} held", "V"),
        ]
    return (
        Quantity("link, median", "ms", "link_interval_ms", 2.0),
        Quantity("link, 95 of 100 within", "ms"),
        Quantity("link, 999 of 1000 within", "ms"),
        Quantity(f"link, over {LATE_MS:g} ms", "%"),
        Quantity("gyroscope, scale error", "%", "gyro_scale_error_pct"),
        Quantity("gyroscope, drift", "deg/min", "gyro_drift_deg_min"),
        Quantity("gyroscope, noise", "deg/s", "gyro_noise_deg_s"),
        Quantity("pitch at rest", "deg", "acceleration_bias_x_mm_s2", -tilt_deg),
        Quantity("roll at rest", "deg", "acceleration_bias_y_mm_s2", tilt_deg),
        Quantity("tilt, noise", "deg", "tilt_noise_deg"),
        Quantity("battery at rest", "V", "battery_v"),
        *motors,
        Quantity(f"wall at {WALL_MM:g} mm", "mm", "distance_bias_mm"),
        Quantity("distance, noise", "mm", "distance_noise_mm"),
        Quantity("distance, failed readings", "%", "distance_dropout_share", 100.0),
        Quantity("wall aslant", "mm"),
        Quantity("wall aslant, failed readings", "%"),
    )


def measured(log: SessionLog) -> dict[str, float]:
    """Numbers by the names of the quantities, of those that the log has."""
    rows: dict[str, list[Row]] = {}
    for row in log.rows:
        rows.setdefault(row.phase, []).append(row)
    delays_ms = [
        row.delay_ms
        for before, row in pairwise(log.rows)
        if row.time_ms - before.time_ms < PAUSE_MS + row.delay_ms
    ]
    names = "link, median", "link, 95 of 100 within", "link, 999 of 1000 within"
    numbers = dict(zip(names, np.percentile(delays_ms, (50, 95, 99.9)), strict=True))
    numbers[f"link, over {LATE_MS:g} ms"] = 100.0 * float(np.mean(np.array(delays_ms) > LATE_MS))
    if {"rest", "turned"} <= rows.keys():
        numbers |= _inertial(log.rows)
    if "lifted" in rows:
        numbers["battery at rest"] = _mean(rows["lifted"], "battery_v")
    for phase, answers in rows.items():
        kind, _, motor = phase.partition(" ")
        if kind == "free":
            numbers[f"speed of {motor}, free"] = (
                _speed(answers, motor) + _speed(rows[f"back {motor}"], motor)
            ) / 2
        elif kind == "held":
            numbers[f"battery with {motor} held"] = _mean(answers, "battery_v")
    for phase, name in (("wall", f"wall at {WALL_MM:g} mm"), ("aslant", "wall aslant")):
        if phase in rows:
            distances = np.array([row.values["distance"] for row in rows[phase]])
            seen = distances[distances < UltrasonicSensor.FARTHEST_MM]
            failed = "distance" if phase == "wall" else name
            numbers[f"{failed}, failed readings"] = 100.0 * (1.0 - len(seen) / len(distances))
            if len(seen):
                numbers[name] = float(np.mean(seen))
                numbers |= {"distance, noise": float(np.std(seen))} if phase == "wall" else {}
    return {name: float(value) for name, value in numbers.items()}


def _column(rows: Iterable[Row], name: str) -> NDArray[np.float64]:
    return np.array([row.values[name] for row in rows])


def _mean(rows: Iterable[Row], name: str) -> float:
    return float(_column(rows, name).mean())


def _speed(rows: list[Row], motor: str) -> float:
    """Speed of a motor, once it runs, without its sign."""
    running = [row for row in rows if row.time_ms >= rows[0].time_ms + _STARTING_MS]
    times_s = np.array([row.time_ms / 1000 for row in running])
    return abs(float(np.polyfit(times_s, _column(running, f"{motor}_angle"), 1)[0]))


def _inertial(rows: Iterable[Row]) -> dict[str, float]:
    """Numbers of gyroscope and accelerometer. Half a turn separates their tilt from that of the
    table."""
    turning = [row for row in rows if "heading" in row.values]
    headings_deg = np.unwrap(_column(turning, "heading"), period=360.0)
    times_min = np.array([row.time_ms / 60_000 for row in turning])
    (rest, turned) = (
        np.array([row.phase == phase for row in turning]) for phase in ("rest", "turned")
    )

    def ends(values: NDArray[np.float64]) -> tuple[float, float, float]:
        return (
            float(values[rest][:_ENDS].mean()),
            float(values[rest][-_ENDS:].mean()),
            float(values[turned][:_ENDS].mean()),
        )

    (first_min, last_min, after_min) = ends(times_min)
    (first_deg, last_deg, after_deg) = ends(headings_deg)
    drift_deg_min = (last_deg - first_deg) / (last_min - first_min)
    turn_deg = after_deg - last_deg - drift_deg_min * (after_min - last_min)
    pitch, roll, rate = (_column(turning, name) for name in ("pitch", "roll", "yaw_rate"))
    return {
        "gyroscope, scale error": 100.0 * (turn_deg / TURNED_DEG - 1.0),
        "gyroscope, drift": drift_deg_min,
        "gyroscope, noise": float(rate[rest].std()),
        "pitch at rest": float(pitch[rest].mean() + pitch[turned].mean()) / 2,
        "roll at rest": float(roll[rest].mean() + roll[turned].mean()) / 2,
        "tilt, noise": float(np.hypot(pitch[rest].std(), roll[rest].std()) / math.sqrt(2.0)),
    }


@dataclass(frozen=True)
class Comparison:
    """A robot beside its twin.

    Attributes:
        robot: numbers of the robot, by the names of the quantities.
        twin: the same of the twin with ``base``, measured by exact hands.
        base: physics with the robot's battery, without the noise that is measured.
    """

    quantities: tuple[Quantity, ...]
    robot: Mapping[str, float]
    twin: Mapping[str, float]
    base: Physics

    def at(self, quantity: Quantity, value: float) -> float:
        """The number of a twin whose parameter has this value."""
        base: float = getattr(self.base, quantity.parameter)
        return self.twin[quantity.name] + self._factor(quantity) * (value - base)

    def scale(self, quantity: Quantity) -> tuple[float, float, float]:
        """Lowest, nominal and highest number of the twins that are drawn."""
        low, high = sorted(
            self.at(quantity, end) for end in PARAMETERS[quantity.parameter].random_range
        )
        return low, self.at(quantity, getattr(Physics(), quantity.parameter)), high

    def _factor(self, quantity: Quantity) -> float:
        if quantity.factor is None:
            return self.twin[quantity.name] / float(getattr(self.base, quantity.parameter))
        return quantity.factor

    def fitted(self) -> Physics:
        """Physics of the robot; what several numbers say of a parameter is averaged, what none says
        of it is the default."""
        values: dict[str, list[float]] = {}
        for one in self.quantities:
            if one.parameter and one.name in self.robot and one.name in self.twin:
                off = (self.robot[one.name] - self.twin[one.name]) / self._factor(one)
                values.setdefault(one.parameter, []).append(getattr(self.base, one.parameter) + off)
        fitted = {
            name: float(np.clip(np.mean(found), *PARAMETERS[name].allowed_range))
            for name, found in values.items()
        }
        return replace(Physics(), **fitted)


def compare(log: SessionLog, robot: Robot) -> Comparison:
    """A robot's log beside its twin. A robot without a body that moves has no twin to measure."""
    numbers = measured(log)
    known = quantities(robot)
    volts = numbers.get("battery at rest", Physics().battery_v)
    noises = [one.parameter for one in known if "noise" in one.parameter and one.name in numbers]
    base = Physics(
        **dict.fromkeys(noises, 0.0),
        battery_v=float(np.clip(volts, *PARAMETERS["battery_v"].allowed_range)),
    )
    hub = None if lies_on_bench(robot, OPEN_FLOOR) else virtual(robot, base)
    twin = (
        {}
        if hub is None
        else measured(
            measure(hub, robot, SimulatedPerson(hub, np.random.default_rng(0), **_EXACT), {})
        )
    )
    return Comparison(known, numbers, twin, base)


def virtual(robot: Robot, physics: Physics, seed: int = 0) -> VirtualHub:
    """A virtual robot, before a wall if it can see one."""
    sees = any(sensor.kind.model.range_mm is not None for sensor in robot.sensors)
    scene = Scene(wall_distance_mm=(WALL_MM, WALL_MM)) if sees else OPEN_FLOOR
    return VirtualHub(make_body(robot, scene=scene, physics=physics, seed=seed))
