"""Which motors the bench takes for wheels when a program turns by the gyroscope without a drive
base."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.virtual.run import run_file

HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import DCMotor, Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
hub = PrimeHub()
"""
PAIR = "left, right = Motor(Port.C, Direction.COUNTERCLOCKWISE), Motor(Port.D)\n"
WHEELS = "takes the motors on ports C and D for wheels"


def run(folder: Path, source: str) -> tuple[list[str], str]:
    program, out, err = folder / "main.py", io.BytesIO(), io.StringIO()
    program.write_text(HEAD + source, encoding="utf-8")
    assert run_file(program, stdout=out, stderr=err, time_limit_s=20) == 0, err.getvalue()
    return out.getvalue().decode().splitlines(), err.getvalue()


@pytest.mark.parametrize(
    "start",
    ["left.run(300)\nright.run(-300)", "left.dc(40)\nright.dc(-40)", "left.run(200)\nright.hold()"],
)
def test_turn_by_gyroscope_ends(tmp_path: Path, start: str) -> None:
    turn = (
        "while hub.imu.heading() < 90:\n    wait(10)\nleft.hold()\nright.hold()\n"
        "print(90 <= hub.imu.heading() < 110)\n"
    )
    printed, told = run(tmp_path, f"{PAIR}{start}\n{turn}")
    assert printed == ["True"]
    assert told.count("\n") == 1
    assert WHEELS in told


def test_turn_to_the_left_by_summed_turn_rate_ends(tmp_path: Path) -> None:
    source = """
left.run(-300)
right.run(300)
angle = 0
while angle < 90:
    angle += hub.imu.angular_velocity(Axis.Z) / 100
    wait(10)
print(-100 < hub.imu.heading() < -80, round(hub.imu.rotation(Axis.Z), -1))
"""
    printed, _ = run(tmp_path, PAIR + source)
    assert printed == ["True 90.0"]


def test_heading_counts_what_the_wheels_turned_before_it_was_read(tmp_path: Path) -> None:
    source = (
        "left.run_angle(500, 180, wait=False)\nright.run_angle(500, -180)\n"
        "print(round(hub.imu.heading(), -1))"
    )
    printed, _ = run(tmp_path, PAIR + source)
    assert printed == ["90.0"]


def test_straight_drive_keeps_heading(tmp_path: Path) -> None:
    printed, told = run(
        tmp_path,
        PAIR + "left.run(400)\nright.run(400)\nwait(1000)\nprint(round(hub.imu.heading(), 1) == 0)",
    )
    assert (printed, WHEELS in told) == (["True"], True)


def test_attachments_are_no_wheels(tmp_path: Path) -> None:
    source = PAIR + (
        "arm = Motor(Port.A, Direction.COUNTERCLOCKWISE)\nhub.imu.reset_heading(0)\n"
        "arm.run_angle(500, 360)\n"
    )
    assert run(tmp_path, source + "print(hub.imu.heading())") == (["0.0"], "")


@pytest.mark.parametrize(
    "motors",
    [
        "a, b = Motor(Port.C), Motor(Port.D)",
        "a, b = Motor(Port.C), DCMotor(Port.D, Direction.COUNTERCLOCKWISE)",
        (
            "a, b, left, right = Motor(Port.C), Motor(Port.D), Motor(Port.E, "
            "Direction.COUNTERCLOCKWISE), Motor(Port.F)"
        ),
    ],
)
def test_hub_lies_still_if_the_first_two_motors_are_no_pair_and_says_so_once(
    tmp_path: Path, motors: str
) -> None:
    source = (
        "hub.imu.heading()\na.dc(50)\nb.dc(50)\nwait(500)\nhub.imu.rotation(Axis.Z)\n"
        "print(hub.imu.heading())"
    )
    printed, told = run(tmp_path, f"{motors}\n{source}")
    assert printed == ["0.0"]
    assert told.count("lies still") == told.count("\n") == 1


@pytest.mark.parametrize(
    "source",
    [
        (
            "hub.imu.reset_heading(0)\nbase = DriveBase(left, right, 56, 112)\nbase.turn(90)\n"
            "print(round(hub.imu.heading(), -1))"
        ),
        "left.run(300)\nright.run(-300)\nwait(500)\nprint(90.0)",
        (
            "left.run(300)\nright.run(-300)\nwait(500)\n"
            "print(90.0 + round(hub.imu.acceleration(Axis.X)), *hub.imu.tilt()[2:])"
        ),
    ],
)
def test_nothing_is_assumed_without_need(tmp_path: Path, source: str) -> None:
    assert run(tmp_path, PAIR + source) == (["90.0"], "")
