"""Two minutes with a robot: what its hub sends says what it is."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import BENCH, HubKind, Motor, Robot
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.measure import session
from bricktwin.measure.hands import Deed, SimulatedPerson
from bricktwin.measure.report import lines
from bricktwin.measure.results import Comparison, compare, measured, virtual
from bricktwin.measure.session import Row, SessionLog, measure, read_log, write_log
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics

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
