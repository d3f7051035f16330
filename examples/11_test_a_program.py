"""Test of a Pybricks program without a hub: on the virtual hub, in a robot whose sensor sees a wall 80 cm ahead.

pytest examples/11_test_a_program.py   # works with any test runner; needs neither MuJoCo nor torch
"""

import io
from math import pi
from pathlib import Path

from bricksrl.robots import Direction, HubKind, Motor, Robot, UltrasonicSensor
from bricksrl.virtual_hub import BenchBody, run_file

ROVER = Robot(
    "rover",
    HubKind.PRIME,
    motors=(Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B")),
    sensors=(UltrasonicSensor("eyes", "C"),),
)
PROGRAM = """
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase

base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), wheel_diameter=56, axle_track=112)
eyes = UltrasonicSensor(Port.C)
base.drive(speed=200, turn_rate=0)
while eyes.distance() > 150:
    pass
base.brake()
print("stopped", eyes.distance(), "mm before the wall")
"""


def distance_mm(angles: dict[str, float]) -> float:
    """Reading of the ultrasonic sensor for these wheel angles."""
    return 800 - pi * 56 * (angles["left"] + angles["right"]) / 2 / 360


def test_it_stops_before_the_wall(tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text(PROGRAM)
    output = io.BytesIO()
    assert run_file(tmp_path / "main.py", BenchBody(ROVER, {"eyes": distance_mm}), stdout=output, time_limit_s=30) == 0
    words = output.getvalue().decode().split()
    assert words[0] == "stopped" and 120 <= int(words[1]) <= 150
