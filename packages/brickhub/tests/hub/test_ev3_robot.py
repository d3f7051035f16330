"""A robot with an EV3 Brick: its program, survey and preflight check in the virtual hub."""

from __future__ import annotations

import pytest

from brickhub.cli import main
from brickhub.errors import DescriptionError
from brickhub.finding import Outcome
from brickhub.hub.diagnostics.preflight import check_ports, check_robot
from brickhub.hub.diagnostics.survey import find_stops, survey
from brickhub.hub.interface import (
    Distance,
    DriveSpeed,
    DriveTurnRate,
    HubButton,
    Interface,
    MotorAngle,
    SensorReading,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.compile import check_program, compile_program, program_blob
from brickhub.hub.program.generate import generate
from brickhub.robot import (
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
)
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

DRIVER = Robot(
    "ev3-driver",
    HubKind.EV3,
    (
        Motor("left", "B", MotorKind.EV3_LARGE, Direction.COUNTERCLOCKWISE),
        Motor("right", "C", MotorKind.EV3_LARGE),
        Motor("arm", "A", MotorKind.EV3_MEDIUM, range_deg=(0, 90)),
    ),
    (
        PoweredUpSensor("bumper", "1", SensorKind.EV3_TOUCH),
        PoweredUpSensor("gyro", "2", SensorKind.EV3_GYRO),
        PoweredUpSensor("light", "3", SensorKind.EV3_COLOR),
        PoweredUpSensor("eyes", "4", SensorKind.EV3_ULTRASONIC),
    ),
    DriveBase("left", "right", 56, 120),
)
ARM = Robot("ev3-arm", HubKind.EV3, (Motor("arm", "A", MotorKind.EV3_MEDIUM, range_deg=(0, 90)),))
INTERFACE = Interface(
    (DriveSpeed(-200, 200), DriveTurnRate(-90, 90)),
    (
        MotorAngle("left"),
        Distance("eyes", 0, 2550),
        SensorReading("light", "reflection", 0, 100),
        SensorReading("light", "rgb", 0, 100, part="green"),
        SensorReading("gyro", "angle", -180, 180, "deg"),
        SensorReading("bumper", "pressed", 0, 1),
        HubButton("up"),
    ),
    Wait(50),
)


def bench() -> BenchBody:
    readings = {"bumper": lambda _: 5.0, "light": lambda _: (120.0, 100.0, 60.0)}
    return BenchBody(DRIVER, readings, {"arm": (-10.0, 100.0)})


def test_program_names_ports_and_classes_of_the_brick() -> None:
    program = generate(DRIVER, INTERFACE)
    devices = "ColorSensor, GyroSensor, Motor, TouchSensor, UltrasonicSensor"
    for line in (
        "from pybricks.hubs import EV3Brick",
        f"from pybricks.ev3devices import {devices}",
        "sensor_gyro = GyroSensor(Port.S2)",
        "hub = EV3Brick()",
    ):
        assert line in program.source.splitlines()
    program_blob(compile_program(program), HubKind.EV3)
    assert check_program(program, HubKind.EV3) < 10_000


def test_the_program_answers() -> None:
    with HubLink(VirtualHub(bench()), DRIVER, INTERFACE) as link:
        first = link.read().values
        assert first[1:] == (2550.0, 0.0, 60.0, 0.0, 1.0, 0.0)
        for _ in range(4):
            angle_deg = link.act((100.0, 0.0)).values[0]
        assert 10 < angle_deg < 180


def test_survey_knows_what_is_plugged_in() -> None:
    found = survey(VirtualHub(bench()), DRIVER)
    assert found.ports == {"A": 87, "B": 86, "C": 86, "D": 0, "1": 85, "2": 32, "3": 29, "4": 30}
    assert set(found.angles_deg) == {"left", "right", "arm"}
    assert all(finding.outcome is Outcome.OK for finding in check_ports(DRIVER, found))


def test_stops_of_a_joint_are_found() -> None:
    low, high = find_stops(VirtualHub(bench()), DRIVER)["arm"] or (0, 0)
    assert low == pytest.approx(-10, abs=4) and high == pytest.approx(100, abs=4)


def test_preflight_check_of_the_whole_robot() -> None:
    findings = list(check_robot(VirtualHub(bench()), DRIVER, INTERFACE, may_move=lambda: True))
    assert {finding.outcome for finding in findings} <= {Outcome.OK, Outcome.SKIPPED}, findings
    assert {f"port {port}" for port in HubKind.EV3.model.ports} <= {one.name for one in findings}


def test_no_zero_is_kept_of_a_motor_that_does_not_know_its_angle(
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot = f"{__file__}:ARM"
    assert main(["calibrate", robot, "--hub", "virtual", "--yes"]) == 2
    assert "the motor 'arm' counts from where it stands" in capsys.readouterr().err


def test_the_button_that_stops_a_program_is_none_of_it() -> None:
    stops = Interface((), (HubButton("left_up"),), Wait(50))
    with pytest.raises(DescriptionError, match="choose center, left, right, up, down"):
        generate(DRIVER, stops)
