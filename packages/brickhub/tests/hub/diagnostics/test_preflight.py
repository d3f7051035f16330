"""Findings of the preflight check."""

from __future__ import annotations

from dataclasses import replace

import pytest
from described import REACHING, ROBO_ARM, SPINNING, TWO_WHEELER, WALKER, WALKING
from hypothesis import given
from hypothesis import strategies as st

from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.preflight import (
    advice,
    check_angles,
    check_battery,
    check_imu,
    check_latency,
    check_ports,
    check_robot,
    check_wheels,
    device_name,
    latency,
    small_move,
)
from brickhub.hub.diagnostics.survey import Survey, WheelTurn
from brickhub.hub.interface import RunAngle, UntilDone, Wait
from brickhub.robot import HubKind, MotorKind, SensorKind
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

GOOD = Survey(
    {"A": 48, "B": 0, "C": 62, "D": 0, "E": 48, "F": 0},
    {"left": 0, "right": 0},
    8000,
    "4.0.1",
    "hub",
    True,
    True,
    0,
    0,
)


def ports(**changed: int) -> dict[str, Finding]:
    found = replace(GOOD, ports=GOOD.ports | changed)
    return {finding.name[-1]: finding for finding in check_ports(TWO_WHEELER, found)}


def test_preflight_names_every_port() -> None:
    findings = ports()
    assert list(findings) == list("ABCDEF")
    assert all(finding.outcome is Outcome.OK for finding in findings.values())
    assert (
        ports(B=61)["B"].outcome is Outcome.OK
        and "color sensor is there" in ports(B=61)["B"].detail
    )


def test_missing_device_is_an_error_with_remedy() -> None:
    assert (
        ports(A=0)["A"].outcome is Outcome.ERROR
        and "plug it into port A until it clicks" in ports(A=0)["A"].detail
    )
    assert "move it from port F to C" in ports(C=0, F=62)["C"].detail
    assert ports(A=62, C=48)["A"].outcome is Outcome.ERROR, "swapped"
    assert "device 99 is there" in ports(A=99)["A"].detail


def test_other_motor_kind_is_a_warning() -> None:
    finding = ports(A=MotorKind.TECHNIC_M_ANGULAR.model.device_id)["A"]
    assert (
        finding.outcome is Outcome.WARNING
        and "technic-m-angular is there; it works" in finding.detail
    )


def test_every_described_device_has_a_number_and_a_name() -> None:
    for kind in MotorKind:
        # An EV3 Brick takes an NXT motor for its own large one.
        known = MotorKind.EV3_LARGE if kind is MotorKind.NXT else kind
        assert device_name(kind.model.device_id) == f"motor {known.value}"
    assert {device_name(kind.model.device_id) for kind in SensorKind} == {
        "color sensor",
        "color distance sensor",
        "force sensor",
        "infrared sensor",
        "tilt sensor",
        "light",
        "color light matrix",
        "ultrasonic sensor",
        *(f"ev3 {name} sensor" for name in ("touch", "color", "ultrasonic", "gyro", "infrared")),
    }
    numbers = [
        device.kind.model.device_id
        for robot in (TWO_WHEELER, WALKER, ROBO_ARM)
        for device in (*robot.motors, *robot.sensors)
    ]
    assert set(numbers) == {48, 62}


@pytest.mark.parametrize(
    ("hub", "battery_mv", "outcome"),
    [
        (HubKind.PRIME, 8000, Outcome.OK),
        (HubKind.PRIME, 6700, Outcome.WARNING),
        (HubKind.PRIME, 5900, Outcome.ERROR),
        (HubKind.TECHNIC, 6700, Outcome.OK),
        (HubKind.TECHNIC, 5300, Outcome.WARNING),
        (HubKind.CITY, 4700, Outcome.ERROR),
    ],
)
def test_batteries(hub: HubKind, battery_mv: int, outcome: Outcome) -> None:
    finding = check_battery(hub, battery_mv)
    assert finding.outcome is outcome
    assert (";" in finding.detail) is (outcome is not Outcome.OK)


def test_imu() -> None:
    assert [f.outcome for f in check_imu(TWO_WHEELER, GOOD)] == [Outcome.OK]
    assert [f.outcome for f in check_imu(TWO_WHEELER, replace(GOOD, imu_ready=False))] == [
        Outcome.WARNING
    ]
    assert [f.outcome for f in check_imu(TWO_WHEELER, replace(GOOD, imu_ready=None))] == [
        Outcome.ERROR
    ]
    assert not list(check_imu(ROBO_ARM, GOOD)), "it does not need one"


def test_joints_out_of_range_are_errors() -> None:
    interface = REACHING
    values = [0.0, 40.0, -70.0, -95.0]
    assert [f.outcome for f in check_angles(ROBO_ARM, interface, values)] == [Outcome.OK] * 3
    values[1] = 100
    error = next(iter(check_angles(ROBO_ARM, interface, values)))
    assert error.outcome is Outcome.ERROR and "100 deg, range 10 to 70" in error.detail


def test_latency_follows_from_round_trips() -> None:
    interface = WALKING
    found = latency([0.09] * 99 + [0.2], interface)
    assert found.interval_ms == pytest.approx(45.0) and found.is_slow
    assert found.link_share == pytest.approx(90 / 340)
    over_cable = check_latency(found, has_radio=False)
    assert over_cable.outcome is Outcome.OK and "interval" not in over_cable.detail
    finding = check_latency(found)
    assert finding.outcome is Outcome.WARNING and advice() in finding.detail
    quick = latency([0.0301] * 10, replace(interface, settle=UntilDone()))
    assert quick.interval_ms == 15.0 and quick.link_share is None and not quick.is_slow
    assert check_latency(quick).outcome is Outcome.OK
    assert replace(interface, settle=Wait(100)).settle.time_ms == 100


def test_there_is_advice_for_every_system() -> None:
    assert (
        "conn_min_interval" in advice("linux")
        and "macOS" in advice("darwin")
        and "Windows 11" in advice("win32")
    )
    assert advice("plan9")


@given(st.floats(-200, 0), st.floats(0, 200), st.none() | st.floats(-150, 10))
def test_test_move_is_small_and_in_range(low: float, high: float, angle: float | None) -> None:
    value = small_move(RunAngle("high", low, high, 100), (-150, 10), angle)
    assert low <= value <= high and abs(value) <= 30
    assert abs(value) == min(30, max(-low, high)) or (abs(value) >= min(30, -low, high))


def test_a_joint_moves_to_the_middle_of_its_range() -> None:
    command = RunAngle("high", -60, 60, 100)
    assert small_move(command, (-150, 10), 0.0) == -30
    assert small_move(command, (-150, 10), -140.0) == 30
    assert small_move(RunAngle("leg", -100, 0, 100), None, None) == -30


class Blocked(VirtualHub):
    """The right wheel is blocked."""

    def __init__(self) -> None:
        super().__init__(BenchBody(TWO_WHEELER))
        apply = self.body.set_voltage
        self.body.set_voltage = lambda port, mv: apply(port, None if port == "A" else mv)


def test_blocked_motor_is_an_error() -> None:
    findings = check_robot(Blocked(), TWO_WHEELER, SPINNING, may_move=lambda: True)
    told = {finding.name: finding for finding in findings}
    assert told["motor left"].outcome is Outcome.OK
    assert (
        told["motor right"].outcome is Outcome.ERROR
        and "blocked, or its cable is loose" in told["motor right"].detail
    )


def test_failing_program_is_a_finding() -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    described = replace(
        TWO_WHEELER, motors=(replace(TWO_WHEELER.motors[0], port="D"), *TWO_WHEELER.motors[1:])
    )
    hub.machine.robot = described  # it says that it is there, and cannot be used
    interface = SPINNING
    *_, last = check_robot(hub, described, interface, may_move=lambda: True)
    assert last.outcome is Outcome.ERROR and "ENODEV" in last.detail
    assert not any(servo.is_open for servo in hub.machine.servos.values())


@pytest.mark.parametrize(
    ("shares", "outcomes"),
    [
        ((1.0, 0.97), ("OK", "OK")),
        ((1.0, 0.7), ("OK", "WARNING")),
        ((0.05, 1.0), ("WARNING", "OK")),  # the other wheel turned it: it stands on the floor
        ((-0.05, 1.0), ("WARNING", "OK")),
        ((0.05, -0.05), ("SKIPPED", "SKIPPED")),
        ((1.0, -1.0), ("OK", "ERROR")),
    ],
)
def test_wheel_that_rolls_less_than_its_motor_slips(
    shares: tuple[float, float], outcomes: tuple[str, str]
) -> None:
    base = TWO_WHEELER.drive_base
    assert base is not None
    deg = 90.0 * base.wheel_diameter_mm / (2 * base.axle_track_mm)
    turns = [
        WheelTurn(base.left, 90.0, shares[0] * deg),
        WheelTurn(base.right, 90.0, -shares[1] * deg),
    ]
    found = check_wheels(TWO_WHEELER, turns, lambda names: "calibrate")
    assert tuple(finding.outcome.name for finding in found) == outcomes
