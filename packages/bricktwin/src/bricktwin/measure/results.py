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
"""Exchanges that take this time or longer count as late."""
_ENDS = 5
"""Number of answers at either end of the rest, of which the mean is taken."""
_STARTING_MS = 400
"""Time in which a motor gets up to speed."""
_GRAVITY_MM_S2 = 9810.0
_EXACT = {"error_deg": 0.0, "error_s": 0.0}
"""A person without errors, who measures the twin."""


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
    # An accelerometer's bias b adds atan(b / g) to a tilt, which for small angles is b / g; this is
    # for 1 mm/s2.
    tilt_deg = math.degrees(1.0 / _GRAVITY_MM_S2)
    motors = []
    for number, motor in enumerate(robot.motors, 1):
        motors += [
            Quantity(
                f"speed of {motor.name}, free",
                "deg/s",
                f"motor_{number}_scale",
                None,
            ),
            Quantity(f"battery with {motor.name} held", "V"),
        ]
    return (
        Quantity(
            "link, median",
            "ms",
            "link_interval_ms",
            2.0,
        ),
        Quantity("link, 95 of 100 within", "ms"),
        Quantity("link, 999 of 1000 within", "ms"),
        Quantity(f"link, over {LATE_MS:g} ms", "%"),
        Quantity("gyroscope, scale error", "%", "gyro_scale_error_pct"),
        Quantity("gyroscope, drift", "deg/min", "gyro_drift_deg_min"),
        Quantity("gyroscope, noise", "deg/s", "gyro_noise_deg_s"),
        Quantity(
            "pitch at rest",
            "deg",
            "acceleration_bias_x_mm_s2",
            -tilt_deg,
        ),
        Quantity(
            "roll at rest",
            "deg",
            "acceleration_bias_y_mm_s2",
            tilt_deg,
        ),
        Quantity("tilt, noise", "deg", "tilt_noise_deg"),
        Quantity("battery at rest", "V", "battery_v"),
        *motors,
        Quantity(f"wall at {WALL_MM:g} mm", "mm", "distance_bias_mm"),
        Quantity("distance, noise", "mm", "distance_noise_mm"),
        Quantity(
            "distance, failed readings",
            "%",
            "distance_dropout_share",
            100.0,
        ),
        Quantity("wall aslant", "mm"),
        Quantity("wall aslant, failed readings", "%"),
    )


def measured(log: SessionLog) -> dict[str, float]:
    """Numbers by the names of the quantities, of those that the log has."""
    phases: dict[str, list[Row]] = {}
    for row in log.rows:
        phases.setdefault(row.phase, []).append(row)
    # A session without the time or the sensor for a number has no rows for it.
    numbers = _link(log.rows)
    if {"rest", "turned"} <= phases.keys():
        numbers |= _inertial(log.rows)
    if "lifted" in phases:
        numbers["battery at rest"] = _mean(phases["lifted"], "battery_v")
    for phase, answers in phases.items():
        kind, _, motor = phase.partition(" ")
        if kind == "free":
            # Both directions are measured, because a motor may be faster in one of them.
            forward_deg_s = _speed(answers, motor)
            back_deg_s = _speed(phases[f"back {motor}"], motor)
            numbers[f"speed of {motor}, free"] = (forward_deg_s + back_deg_s) / 2
        elif kind == "held":
            numbers[f"battery with {motor} held"] = _mean(answers, "battery_v")
    if "wall" in phases:
        numbers |= _straight_wall(phases["wall"])
    if "aslant" in phases:
        numbers |= _slanting_wall(phases["aslant"])
    return numbers


def _link(rows: Iterable[Row]) -> dict[str, float]:
    """Numbers of the link's delays."""
    delays_ms = []
    for before, row in pairwise(rows):
        passed_ms = row.time_ms - before.time_ms
        if passed_ms < PAUSE_MS + row.delay_ms:
            delays_ms.append(row.delay_ms)
    percentiles_ms = np.percentile(delays_ms, (50, 95, 99.9))
    median_ms, most_ms, nearly_all_ms = percentiles_ms.tolist()
    late_share = float(np.mean(np.array(delays_ms) > LATE_MS))
    return {
        "link, median": median_ms,
        "link, 95 of 100 within": most_ms,
        "link, 999 of 1000 within": nearly_all_ms,
        f"link, over {LATE_MS:g} ms": 100.0 * late_share,
    }


def _straight_wall(rows: Iterable[Row]) -> dict[str, float]:
    """Numbers of an ultrasonic sensor that looks straight at a wall."""
    distances_mm, failed_pct = _distances(rows)
    numbers = {"distance, failed readings": failed_pct}
    if len(distances_mm):
        numbers[f"wall at {WALL_MM:g} mm"] = float(np.mean(distances_mm))
        numbers["distance, noise"] = float(np.std(distances_mm))
    return numbers


def _slanting_wall(rows: Iterable[Row]) -> dict[str, float]:
    """Numbers of an ultrasonic sensor that looks at a wall aslant."""
    distances_mm, failed_pct = _distances(rows)
    numbers = {"wall aslant, failed readings": failed_pct}
    if len(distances_mm):
        numbers["wall aslant"] = float(np.mean(distances_mm))
    return numbers


def _distances(rows: Iterable[Row]) -> tuple[NDArray[np.float64], float]:
    """Distances of the readings that have an echo (mm) ``[n]``, and the share of others, %."""
    readings_mm = _column(rows, "distance")
    # A sensor that hears nothing reports its largest distance, which is no measurement.
    heard_mm = readings_mm[readings_mm < UltrasonicSensor.FARTHEST_MM]
    failed_pct = 100.0 * (1.0 - len(heard_mm) / len(readings_mm))
    return heard_mm, failed_pct


def _column(rows: Iterable[Row], name: str) -> NDArray[np.float64]:
    """A channel's values ``[rows]``."""
    return np.array([row.values[name] for row in rows])


def _mean(rows: Iterable[Row], name: str) -> float:
    return float(_column(rows, name).mean())


def _speed(rows: list[Row], motor: str) -> float:
    """Speed of a motor, once it runs, without its sign."""
    begin_ms = rows[0].time_ms + _STARTING_MS
    running = [row for row in rows if row.time_ms >= begin_ms]
    times_s = np.array([row.time_ms / 1000 for row in running])
    angles_deg = _column(running, f"{motor}_angle")
    # The slope of a fitted line is hardly moved by the noise of the first and the last angle.
    slope_deg_s, _ = np.polyfit(times_s, angles_deg, 1)
    return abs(float(slope_deg_s))


def _inertial(rows: Iterable[Row]) -> dict[str, float]:
    """Numbers of gyroscope and accelerometer. Half a turn separates their tilt from that of the
    table."""
    turning = [row for row in rows if "heading" in row.values]
    # The wire wraps headings, so they are unwrapped here, for which the answers are close enough
    # together.
    headings_deg = np.unwrap(_column(turning, "heading"), period=360.0)
    times_min = np.array([row.time_ms / 60_000 for row in turning])
    pitch_deg = _column(turning, "pitch")
    roll_deg = _column(turning, "roll")
    rate_deg_s = _column(turning, "yaw_rate")
    is_rest = np.array([row.phase == "rest" for row in turning])
    is_turned = np.array([row.phase == "turned" for row in turning])

    def ends(values: NDArray[np.float64]) -> tuple[float, float, float]:
        """Means at the beginning and at the end of the rest, and after the turn."""
        at_rest = values[is_rest]
        turned = values[is_turned]
        return (
            float(at_rest[:_ENDS].mean()),
            float(at_rest[-_ENDS:].mean()),
            float(turned[:_ENDS].mean()),
        )

    # The gyroscope also drifts while the robot is turned, so that drift is subtracted from the
    # turn.
    first_min, last_min, after_min = ends(times_min)
    first_deg, last_deg, after_deg = ends(headings_deg)
    drift_deg_min = (last_deg - first_deg) / (last_min - first_min)
    drift_deg = drift_deg_min * (after_min - last_min)
    turn_deg = after_deg - last_deg - drift_deg

    # A twin has only one parameter for the noise of both tilts, so their root mean square is
    # compared.
    pitch_noise_deg = pitch_deg[is_rest].std()
    roll_noise_deg = roll_deg[is_rest].std()
    tilt_noise_deg = np.hypot(pitch_noise_deg, roll_noise_deg) / math.sqrt(2.0)
    # The robot has been turned by half a turn, so the tilt of the table cancels out in these sums.
    pitch_sum_deg = pitch_deg[is_rest].mean() + pitch_deg[is_turned].mean()
    roll_sum_deg = roll_deg[is_rest].mean() + roll_deg[is_turned].mean()
    return {
        "gyroscope, scale error": 100.0 * (turn_deg / TURNED_DEG - 1.0),
        "gyroscope, drift": drift_deg_min,
        "gyroscope, noise": float(rate_deg_s[is_rest].std()),
        "pitch at rest": float(pitch_sum_deg) / 2,
        "roll at rest": float(roll_sum_deg) / 2,
        "tilt, noise": float(tilt_noise_deg),
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

    def at(
        self,
        quantity: Quantity,
        value: float,
    ) -> float:
        """The number of a twin whose parameter has this value."""
        base: float = getattr(self.base, quantity.parameter)
        change = self._factor(quantity) * (value - base)
        return self.twin[quantity.name] + change

    def scale(self, quantity: Quantity) -> tuple[float, float, float]:
        """Lowest, nominal and highest number of the twins that are drawn."""
        parameter = PARAMETERS[quantity.parameter]
        # The ends are sorted, because with a negative factor the lowest number belongs to the
        # highest parameter.
        low, high = sorted(self.at(quantity, end) for end in parameter.random_range)
        default = getattr(Physics(), quantity.parameter)
        nominal = self.at(quantity, default)
        return low, nominal, high

    def _factor(self, quantity: Quantity) -> float:
        """Change of a number for one unit of its parameter."""
        if quantity.factor is None:
            base = float(getattr(self.base, quantity.parameter))
            return self.twin[quantity.name] / base
        return quantity.factor

    def fitted(self) -> Physics:
        """Physics of the robot; what several numbers say of a parameter is averaged, what none says
        of it is the default."""
        values: dict[str, list[float]] = {}
        for quantity in self.quantities:
            name = quantity.name
            parameter = quantity.parameter
            if not parameter or name not in self.robot or name not in self.twin:
                continue
            difference = self.robot[name] - self.twin[name]
            change = difference / self._factor(quantity)
            value = getattr(self.base, parameter) + change
            values.setdefault(parameter, []).append(value)
        fitted = {}
        for parameter, estimates in values.items():
            # The numbers of a faulty robot may be beyond anything that a twin can be.
            low, high = PARAMETERS[parameter].allowed_range
            mean = np.mean(estimates)
            fitted[parameter] = float(np.clip(mean, low, high))
        return replace(Physics(), **fitted)


def compare(log: SessionLog, robot: Robot) -> Comparison:
    """A robot's log beside its twin. A robot without a body that moves has no twin to measure."""
    numbers = measured(log)
    known = quantities(robot)
    # Motor speeds depend on the battery, so the twin gets that of the robot.
    battery_v = numbers.get("battery at rest", Physics().battery_v)
    low_v, high_v = PARAMETERS["battery_v"].allowed_range
    # The twin must not add noise of its own to the noise that was measured.
    noise_free: dict[str, float] = {}
    for quantity in known:
        if "noise" in quantity.parameter and quantity.name in numbers:
            noise_free[quantity.parameter] = 0.0
    base = Physics(**noise_free, battery_v=float(np.clip(battery_v, low_v, high_v)))
    return Comparison(
        known,
        numbers,
        _measured_twin(robot, base),
        base,
    )


def _measured_twin(robot: Robot, physics: Physics) -> dict[str, float]:
    """Numbers of a robot's twin, measured in the same way; none of a robot on the bench."""
    if lies_on_bench(robot, OPEN_FLOOR):
        return {}
    hub = virtual(robot, physics)
    person = SimulatedPerson(hub, np.random.default_rng(0), **_EXACT)
    return measured(measure(hub, robot, person, {}))


def virtual(
    robot: Robot,
    physics: Physics,
    seed: int = 0,
) -> VirtualHub:
    """A virtual robot, before a wall if it can see one."""
    sees = any(sensor.kind.model.range_mm is not None for sensor in robot.sensors)
    scene = Scene(wall_distance_mm=(WALL_MM, WALL_MM)) if sees else OPEN_FLOOR
    return VirtualHub(
        make_body(
            robot,
            scene=scene,
            physics=physics,
            seed=seed,
        )
    )
