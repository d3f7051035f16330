"""Programs from files on robots with bodies."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.errors import TwinError
from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.run import Operation, run_file
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body

DRIVE = """
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.parameters import Port, Direction
from pybricks.robotics import DriveBase
from pybricks.hubs import PrimeHub
hub = PrimeHub()
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
eyes = UltrasonicSensor(Port.C)
base.straight(100)
print(abs(base.distance() - 100) <= 3, 40 <= eyes.distance() <= 2000)
base.turn(90)
print(abs(hub.imu.heading() - 90) < 10)
"""


def test_the_two_wheeler_drives(tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text(DRIVE)
    out, err = io.BytesIO(), io.StringIO()
    assert run_file(tmp_path / "main.py", make_body(TWO_WHEELER), stdout=out, stderr=err) == 0
    assert (out.getvalue(), err.getvalue()) == (b"True True\nTrue\n", "")


def test_readings_are_for_the_bench(tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text("")
    operation = Operation(readings=[parse_reading("A=red")])
    with pytest.raises(TwinError, match="--robot bench"):
        run_file(
            tmp_path / "main.py",
            make_body(WALKER),
            stdout=io.BytesIO(),
            stderr=io.StringIO(),
            operation=operation,
        )
