"""Two minutes with a robot: what its hub sends says what it is."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import BENCH, HubKind, Motor, Robot
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.measure import session
from bricktwin.measure.hands import Deed, SimulatedPerson
from bricktwin.measure.report import lines
from bricktwin.measure.results import (
    Comparison,
    Quantity,
    compare,
    measured,
    quantities,
    virtual,
)
from bricktwin.measure.session import Row, SessionLog, measure, read_log, write_log
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import PARAMETERS, Physics

HIDDEN = Physics(
    battery_v=7.7,
    motor_1_scale=1.1,
    motor_2_scale=0.9,
    gyro_scale_error_pct=-0.9,
    gyro_drift_deg_min=0.35,
    gyro_noise_deg_s=0.15,
    acceleration_bias_x_mm_s2=150.0,
    acceleration_bias_y_mm_s2=-170.0,
    distance_bias_mm=-14.0,
    distance_dropout_share=0.01,
    link_interval_ms=40.0,
    slope_deg=0.7,
)


@pytest.fixture(scope="module")
def hub() -> VirtualHub:
    return virtual(TWO_WHEELER, HIDDEN, seed=5)


@pytest.fixture(scope="module")
def log(hub: VirtualHub) -> SessionLog:
    return measure(
        hub, TWO_WHEELER, SimulatedPerson(hub, np.random.default_rng(5)), {"hub": "virtual"}
    )


@pytest.fixture(scope="module")
def comparison(log: SessionLog) -> Comparison:
    return compare(log, TWO_WHEELER)


def test_a_virtual_robot_s_noise_is_that_of_its_seed() -> None:
    def noise(seed: int) -> list[float]:
        body = virtual(TWO_WHEELER, HIDDEN, seed).body
        (eyes,) = TWO_WHEELER.sensors
        return [body.distance_mm(eyes.port) for _ in range(10)]

    assert noise(5) == noise(5) != noise(6)


def test_it_takes_two_minutes(hub: VirtualHub, log: SessionLog) -> None:
    assert 60 < hub.now_s() < 120 and log.robot == "two-wheeler"


def test_a_robot_is_found_that_differs_in_all(comparison: Comparison) -> None:
    found = comparison.fitted()
    assert comparison.robot["link, median"] == pytest.approx(80, abs=3)
    assert found.gyro_scale_error_pct == pytest.approx(HIDDEN.gyro_scale_error_pct, abs=0.3)
    assert found.gyro_drift_deg_min == pytest.approx(HIDDEN.gyro_drift_deg_min, abs=0.15)
    assert found.gyro_noise_deg_s == pytest.approx(HIDDEN.gyro_noise_deg_s, rel=0.15)
    for axis in "xy":  # 0.2 degrees, on a table that is not level
        name = f"acceleration_bias_{axis}_mm_s2"
        assert getattr(found, name) == pytest.approx(getattr(HIDDEN, name), abs=34)
    assert found.distance_bias_mm == pytest.approx(HIDDEN.distance_bias_mm, abs=5)
    assert found.battery_v == pytest.approx(HIDDEN.battery_v, abs=0.01)
    assert (found.motor_1_scale, found.motor_2_scale) == pytest.approx(
        (HIDDEN.motor_1_scale, HIDDEN.motor_2_scale), rel=0.02
    )
    assert found.color_noise_pct == Physics().color_noise_pct, "nothing is known of it"


def test_speeds_of_the_motors(hub: VirtualHub, comparison: Comparison) -> None:
    body = virtual(TWO_WHEELER, HIDDEN).body
    assert isinstance(body, MujocoBody)
    body.model.opt.gravity[:] = 0.0
    body.data.qpos[2] = 1.0
    for motor in TWO_WHEELER.motors:
        body.set_voltage(motor.port, 7700)
    body.advance_to(1000)
    before = {motor.port: body.angle_mdeg(motor.port) for motor in TWO_WHEELER.motors}
    body.advance_to(2000)
    for motor in TWO_WHEELER.motors:
        true_deg_s = (body.angle_mdeg(motor.port) - before[motor.port]) / 1000
        assert comparison.robot[f"speed of {motor.name}, free"] == pytest.approx(
            true_deg_s, rel=0.03
        )


def test_a_held_motor_stands_still(log: SessionLog) -> None:
    for motor in TWO_WHEELER.motors:
        turned = [
            row.values[f"{motor.name}_angle"]
            for row in log.rows
            if row.phase == f"held {motor.name}"
        ]
        assert np.ptp(turned) < 15
        free = [
            row.values[f"{motor.name}_angle"]
            for row in log.rows
            if row.phase == f"free {motor.name}"
        ]
        assert np.ptp(free) > 500


def test_what_no_drawn_twin_is_like_is_told(comparison: Comparison) -> None:
    told = {name: remark for name, *_, remark in lines(comparison)}
    assert not any(told.values())
    outside = dataclasses.replace(comparison, robot={**comparison.robot, "gyroscope, drift": 3.0})
    told = {name: remark for name, *_, remark in lines(outside)}
    assert (
        told["gyroscope, drift, deg/min"]
        == "outside of what --randomize draws (gyro_drift_deg_min)"
    )
    assert sum(map(bool, told.values())) == 1


def test_link_times_and_failures_are_counted() -> None:
    delays_ms = [*[40.0] * 95, *[200.0] * 5]
    rows = [
        Row("wall", 10 * number, delay, {"distance": 310.0})
        for number, delay in enumerate(delays_ms)
    ]
    rows += [Row("aslant", 10 * number, 40.0, {"distance": 2000.0}) for number in range(100)]
    numbers = measured(SessionLog("two-wheeler", {}, tuple(rows)))
    assert numbers["link, median"] == 40.0 and numbers["link, over 150 ms"] == pytest.approx(
        2.5, rel=0.01
    )
    assert numbers["wall at 300 mm"] == 310.0 and numbers["distance, failed readings"] == 0.0
    assert numbers["wall aslant, failed readings"] == 100.0 and "wall aslant" not in numbers


def test_log_round_trip_and_other_files(log: SessionLog, tmp_path: Path) -> None:
    path = tmp_path / "folder" / "log.jsonl"
    write_log(path, log)
    assert read_log(path) == log
    for text in (
        "",
        "{}\n",
        "[1]\n",
        path.read_text()[:5000],
        path.read_text().replace('"bricktwin_measure": 1', '"bricktwin_measure": 9'),
    ):
        path.write_text(text)
        with pytest.raises(TwinError, match="it is another file|format 9"):
            read_log(path)
    with pytest.raises(TwinError, match="No such file"):
        read_log(tmp_path / "nothing")


def test_robots_that_nobody_can_handle_are_refused() -> None:
    for robot in (ROBO_ARM, BENCH):
        with pytest.raises(TwinError, match="cannot be taken in hand"):
            SimulatedPerson(virtual(robot, Physics()), np.random.default_rng(0))
    arm = Robot("arm", HubKind.CITY, motors=(Motor("low", "A", range_deg=(0, 90)),))
    hub = virtual(arm, Physics())
    with pytest.raises(TwinError, match="no IMU, endless motor or ultrasonic sensor"):
        measure(hub, arm, Nobody(), {})


class Nobody:
    """A person for whom all is done at once."""

    def begin(self, deed: Deed) -> None:
        self.deed = deed

    def is_done(self) -> bool:
        return True


def test_a_robot_without_a_twin_is_measured_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_LIFTED_S", 0.3)
    fan = Robot("fan", HubKind.CITY, motors=(Motor("blades", "A"),))
    log = measure(virtual(fan, Physics()), fan, Nobody(), {})
    alone = compare(log, fan)
    assert alone.robot["speed of blades, free"] > 900 and not alone.twin
    assert alone.fitted() == Physics()
    assert [name for name, *_ in lines(alone)][-1] == "battery with blades held, V"


def rows_of(phase: str, start_ms: int, count: int, **values: Any) -> list[Row]:
    """Answers every 100 ms; each value is a number, or a function of the time in seconds."""
    rows = []
    for number in range(count):
        time_ms = start_ms + 100 * number
        now = {
            name: value(time_ms / 1000) if callable(value) else value
            for name, value in values.items()
        }
        rows.append(Row(phase, time_ms, 20.0, now))
    return rows


def test_inertial_numbers_are_those_of_a_gyroscope_that_drifts_and_errs() -> None:
    """At rest for a minute, three and a half turns by hand in six seconds, and at rest."""
    turned_deg = 1260.0 * 1.02

    def heading(now_s: float) -> float:
        # A drift of 3 degrees a minute; the wire wraps headings.
        share = min(max((now_s - 60.0) / 6.0, 0.0), 1.0)
        angle = now_s / 20 + share * turned_deg
        return (angle + 180.0) % 360.0 - 180.0

    def alternating(low: float, high: float) -> Any:
        return lambda now_s: high if round(10 * now_s) % 2 else low

    common = {"heading": heading, "yaw_rate": alternating(-0.2, 0.2)}
    # A table that is tilted by 1 and 2 degrees, which half a turn turns round.
    rest = rows_of(
        "rest", 0, 600, **common, pitch=alternating(1.2, 1.8), roll=alternating(2.3, 2.3)
    )
    hands = rows_of("hands", 60_000, 60, **common, pitch=0.0, roll=0.0)
    turned = rows_of("turned", 66_000, 20, **common, pitch=-0.5, roll=-1.7)
    numbers = measured(SessionLog("r", {}, (*rest, *hands, *turned)))
    assert numbers["gyroscope, drift"] == pytest.approx(3.0)
    assert numbers["gyroscope, scale error"] == pytest.approx(2.0)
    assert numbers["gyroscope, noise"] == pytest.approx(0.2)
    assert numbers["pitch at rest"] == pytest.approx(0.5)
    assert numbers["roll at rest"] == pytest.approx(0.3)
    # Of a deviation of 0.3 and one of none.
    assert numbers["tilt, noise"] == pytest.approx(0.3 / math.sqrt(2))


def test_motors_are_measured_in_both_directions_once_they_run() -> None:
    def angle(speed_deg_s: float, start_s: float) -> Any:
        # It stands for the first 0.3 s.
        return lambda now_s: speed_deg_s * max(now_s - start_s - 0.3, 0.0) + 17.0

    rows = [
        *rows_of("lifted", 0, 10, battery_v=8.0),
        *rows_of("free arm", 1000, 12, arm_angle=angle(500.0, 1.0), battery_v=7.9),
        *rows_of("back arm", 3000, 12, arm_angle=angle(-540.0, 3.0), battery_v=7.9),
        *rows_of("held arm", 5000, 10, arm_angle=0.0, battery_v=lambda now_s: 7.0 + now_s - 5.45),
    ]
    numbers = measured(SessionLog("r", {}, tuple(rows)))
    assert numbers["speed of arm, free"] == pytest.approx(520.0)
    assert numbers["battery at rest"] == 8.0
    assert numbers["battery with arm held"] == pytest.approx(7.0)
    assert "pitch at rest" not in numbers and "distance, noise" not in numbers


def test_failed_readings_of_a_distance_are_no_distances() -> None:
    wall_mm = [300.0, 310.0, 2000.0, 290.0, 300.0]
    rows = [Row("wall", 10 * n, 20.0, {"distance": mm}) for n, mm in enumerate(wall_mm)]
    rows += [Row("aslant", 10 * n, 20.0, {"distance": mm}) for n, mm in enumerate((200.0, 1999.0))]
    numbers = measured(SessionLog("r", {}, tuple(rows)))
    assert numbers["distance, failed readings"] == pytest.approx(20.0)
    assert numbers["wall at 300 mm"] == 300.0
    assert numbers["distance, noise"] == pytest.approx(math.sqrt(50.0))
    assert numbers["wall aslant, failed readings"] == 0.0
    assert numbers["wall aslant"] == pytest.approx(1099.5)


def test_an_exchange_after_a_pause_says_nothing_of_the_others() -> None:
    times_ms = [0, 50, 100, 449, 600, 1000]
    delays_ms = [900.0, 30.0, 40.0, 50.0, 160.0, 99.0]
    rows = [Row("hands", *pair, {}) for pair in zip(times_ms, delays_ms, strict=True)]
    numbers = measured(SessionLog("r", {}, tuple(rows)))
    # The first one, and the last one after 400 ms, are left out; that after 349 ms took 50 itself.
    assert numbers["link, median"] == 45.0
    assert numbers["link, over 150 ms"] == 25.0


NOISY = Quantity("noise", "deg/s", "gyro_noise_deg_s")
SPEED = Quantity("speed of left, free", "deg/s", "motor_1_scale", None)
PITCH = Quantity("pitch at rest", "deg", "acceleration_bias_x_mm_s2", -0.01)
AGAIN = dataclasses.replace(PITCH, name="pitch again")


def test_a_twin_is_fitted_by_how_far_each_number_is_off() -> None:
    base = Physics(gyro_noise_deg_s=0.0, motor_1_scale=1.1)
    twin = {NOISY.name: 0.02, SPEED.name: 880.0, PITCH.name: 0.3, AGAIN.name: 0.3}
    robot = {NOISY.name: 0.12, SPEED.name: 800.0, PITCH.name: 0.8, AGAIN.name: 0.0, "other": 9.0}
    found = Comparison((NOISY, SPEED, PITCH, AGAIN), robot, twin, base)
    fitted = found.fitted()
    assert fitted.gyro_noise_deg_s == pytest.approx(0.1)
    # A speed is in proportion to its parameter.
    assert fitted.motor_1_scale == pytest.approx(1.0)
    # What two numbers say is averaged: -50 and 30 mm/s2.
    assert fitted.acceleration_bias_x_mm_s2 == pytest.approx(-10.0)
    # A number as it would be with another parameter, and of the twins that are drawn.
    assert found.at(SPEED, 1.0) == pytest.approx(800.0)
    low, nominal, high = found.scale(PITCH)
    ends = PARAMETERS[PITCH.parameter].random_range
    assert (low, high) == pytest.approx((0.3 - 0.01 * ends[1], 0.3 - 0.01 * ends[0]))
    assert low < nominal < high
    # What a twin cannot be, it is as nearly as it can.
    faulty = dataclasses.replace(found, robot={SPEED.name: 1e6})
    assert faulty.fitted().motor_1_scale == PARAMETERS["motor_1_scale"].allowed_range[1]
    assert faulty.fitted().gyro_noise_deg_s == Physics().gyro_noise_deg_s


def test_a_bias_of_the_accelerometer_tilts_as_much_as_its_share_of_gravity() -> None:
    known = {quantity.name: quantity for quantity in quantities(TWO_WHEELER)}
    # A tenth of gravity, for small angles.
    tilt_deg = math.degrees(0.1)
    assert known["pitch at rest"].factor * 981.0 == pytest.approx(-tilt_deg, rel=1e-3)
    assert known["roll at rest"].factor * 981.0 == pytest.approx(tilt_deg, rel=1e-3)
    # A round trip is two intervals of the link; a share is told in percent.
    assert known["link, median"].factor == 2.0
    assert known["distance, failed readings"].factor == 100.0
    speeds = [quantity.parameter for name, quantity in known.items() if name.startswith("speed")]
    assert speeds == ["motor_1_scale", "motor_2_scale"]
