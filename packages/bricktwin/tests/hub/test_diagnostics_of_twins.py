"""Survey, calibration and preflight check of robots with bodies."""

from __future__ import annotations

import dataclasses

import pytest
from described import REACHING, SPINNING

from brickhub.finding import Outcome
from brickhub.hub.diagnostics.calibration import Calibration, calibrated, zero_between
from brickhub.hub.diagnostics.preflight import check_robot
from brickhub.hub.diagnostics.survey import find_stops, survey
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import Direction, Robot
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin import robots
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.make_body import make_body


class MisbuiltHub(VirtualHub):
    """A robot with motors mounted at an angle or reversed."""

    def __init__(self, shifts_deg: dict[str, int], mirrored: tuple[str, ...] = (), robot: Robot = ROBO_ARM) -> None:
        super().__init__(make_body(robot))
        body = self.body
        angle, apply = body.angle_mdeg, body.set_voltage
        self.true_angle_mdeg = angle
        sign = {motor.port: -1 if motor.port in mirrored else 1 for motor in robot.motors}
        body.angle_mdeg = lambda port: sign[port] * angle(port) + 1000 * shifts_deg.get(port, 0)
        body.set_voltage = lambda port, mv: apply(port, None if mv is None else sign[port] * mv)


def observe(hub: VirtualHub, calibration: Calibration | None, robot: Robot = ROBO_ARM) -> tuple[float, ...]:
    calibrate = None if calibration is None else lambda described: calibrated(described, calibration)
    with HubLink(hub, robot, REACHING, calibrate=calibrate) as link:
        return link.read().values


SHIFTS = {"D": 35, "A": -120, "E": 150}
"""Shaft angles; the last two cross the wrap of the sensor."""


def test_end_stop_calibration_corrects_observation() -> None:
    right = observe(VirtualHub(make_body(ROBO_ARM)), None)
    hub = MisbuiltHub(SHIFTS)
    wrong = observe(hub, None)
    assert all(abs(shifted - angle) > 30 for shifted, angle in zip(wrong[1:], right[1:], strict=True))
    stops = find_stops(hub, ROBO_ARM)
    zeros = {name: zero_between(found, ROBO_ARM.motor(name)) for name, found in stops.items()}
    turned_deg = {"low": 35, "high": -120, "grab": 150}
    assert zeros.keys() == turned_deg.keys()
    assert all(abs((zeros[name] - turned_deg[name] + 180) % 360 - 180) <= 3 for name in zeros)
    again = MisbuiltHub(SHIFTS)  # at its start, as the right one
    assert observe(again, Calibration(zeros)) == pytest.approx(right, abs=3)


def test_calibrated_targets_stay_in_range() -> None:
    """Without its calibration the arm would drive against its stops."""
    for calibration, low_end in ((None, True), (Calibration({"low": 35}), False)):
        hub = MisbuiltHub({"D": 35})
        calibrate = None if calibration is None else lambda robot: calibrated(robot, Calibration({"low": 35}))
        with HubLink(hub, ROBO_ARM, REACHING, calibrate=calibrate) as link:
            for _ in range(6):
                link.act([0, -30, 0, 0])
            shaft_deg = hub.body.angle_mdeg("D") / 1000 - 35
        assert (shaft_deg < 5) is low_end, "stops at 0; the range begins at 10"


def test_mirrored_motor_direction_is_reversed() -> None:
    hub = MisbuiltHub({}, mirrored=("A",), robot=TWO_WHEELER)
    turned = []
    for calibration in (Calibration(), Calibration({}, frozenset({"right"}))):
        with HubLink(hub, TWO_WHEELER, SPINNING, calibrate=lambda robot, c=calibration: calibrated(robot, c)) as link:
            before = hub.true_angle_mdeg("A")
            for _ in range(5):
                link.act([0, 100])
            turned.append(hub.true_angle_mdeg("A") - before)
    assert turned[0] * turned[1] < 0


@pytest.mark.parametrize("name", [name for name in robots.ROBOTS if robots.get(name).hub.model.runs_programs])
def test_survey_finds_devices_without_motion(name: str) -> None:
    robot = robots.get(name)
    hub = VirtualHub(make_body(robot))
    before = [hub.body.angle_mdeg(port) for port in hub.machine.servos]
    found = survey(hub, robot)
    taken = {port for port, number in found.ports.items() if number}
    assert taken == {device.port for device in (*robot.motors, *robot.sensors)}
    assert set(found.angles_deg) == {motor.name for motor in robot.motors}
    assert found.battery_mv == hub.body.battery_mv
    assert (found.firmware, found.name) == ("4.1.0", "Pybricks Hub")
    assert found.imu_ready and found.imu_still
    assert [hub.body.angle_mdeg(port) for port in hub.machine.servos] == before


def test_survey_angle_has_described_direction() -> None:
    hub = VirtualHub(make_body(ROBO_ARM))
    assert survey(hub, ROBO_ARM).angles_deg["high"] == -70
    turned = dataclasses.replace(ROBO_ARM.motor("high"), direction=Direction.COUNTERCLOCKWISE)
    other = dataclasses.replace(ROBO_ARM, motors=(turned,))
    assert survey(hub, other).angles_deg == {"high": 70}


def test_survey_turns_joints_to_stops_and_back() -> None:
    hub = VirtualHub(make_body(ROBO_ARM))
    found = find_stops(hub, ROBO_ARM)
    assert found == {
        "low": pytest.approx((-5, 85), abs=2),
        "high": pytest.approx((-165, 25), abs=2),
        "grab": pytest.approx((-163, -30), abs=2),
    }
    angles = survey(hub, ROBO_ARM).angles_deg
    assert angles["low"] == pytest.approx(40, abs=8) and angles["grab"] == pytest.approx(-96, abs=8)


class Blocked(VirtualHub):
    """The right wheel is blocked."""

    def __init__(self) -> None:
        super().__init__(make_body(TWO_WHEELER))
        apply = self.body.set_voltage
        self.body.set_voltage = lambda port, mv: apply(port, None if port == "A" else mv)


def test_blocked_motor_is_an_error() -> None:
    findings = check_robot(Blocked(), TWO_WHEELER, SPINNING, may_move=lambda: True)
    told = {finding.name: finding for finding in findings}
    assert told["motor left"].outcome is Outcome.OK
    assert told["motor right"].outcome is Outcome.ERROR and "blocked, or its cable is loose" in told["motor right"].detail
