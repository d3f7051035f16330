"""Survey and calibration of robots with bodies."""

from __future__ import annotations

import pytest
from described import REACHING

from brickhub.hub.diagnostics.calibration import Calibration, calibrated, zero_between
from brickhub.hub.diagnostics.survey import find_stops, survey
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin import robots
from bricktwin.robots import ROBO_ARM
from bricktwin.twin.make_body import make_body


class MisbuiltHub(VirtualHub):
    """An arm whose motors are mounted at an angle."""

    def __init__(self, shifts_deg: dict[str, int]) -> None:
        super().__init__(make_body(ROBO_ARM))
        angle = self.body.angle_mdeg
        self.body.angle_mdeg = lambda port: angle(port) + 1000 * shifts_deg.get(port, 0)


def observe(hub: VirtualHub, calibration: Calibration | None) -> tuple[float, ...]:
    calibrate = (
        None if calibration is None else lambda described: calibrated(described, calibration)
    )
    with HubLink(hub, ROBO_ARM, REACHING, calibrate=calibrate) as link:
        return link.read().values


SHIFTS = {"D": 35, "A": -120, "E": 150}
"""Shaft angles; the last two cross the wrap of the sensor."""


def test_end_stop_calibration_corrects_observation() -> None:
    right = observe(VirtualHub(make_body(ROBO_ARM)), None)
    hub = MisbuiltHub(SHIFTS)
    wrong = observe(hub, None)
    assert all(
        abs(shifted - angle) > 30 for shifted, angle in zip(wrong[1:], right[1:], strict=True)
    )
    stops = find_stops(hub, ROBO_ARM)
    zeros = {name: zero_between(found, ROBO_ARM.motor(name)) for name, found in stops.items()}
    turned_deg = {"low": 35, "high": -120, "grab": 150}
    assert zeros.keys() == turned_deg.keys()
    assert all(abs((zeros[name] - turned_deg[name] + 180) % 360 - 180) <= 3 for name in zeros)
    again = MisbuiltHub(SHIFTS)  # at its start, as the right one
    assert observe(again, Calibration(zeros)) == pytest.approx(right, abs=3)


@pytest.mark.parametrize(
    "name", [name for name in robots.ROBOTS if robots.get(name).hub.model.runs_programs]
)
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
