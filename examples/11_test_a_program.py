"""Test of a Pybricks program without a hub: on the virtual hub, in a robot whose sensor sees a wall
80 cm ahead.

pytest examples/11_test_a_program.py   # brickhub alone is enough: it has the fixture `pybricks_hub`
"""

from math import pi

from brickhub.robot import Direction, HubKind, Motor, Robot, UltrasonicSensor

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
"""  # noqa: E501
ROVER = Robot(
    "rover",
    HubKind.PRIME,
    motors=(Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B")),
    sensors=(UltrasonicSensor("eyes", "C"),),
)


def distance_mm(angles):
    """Reading of the ultrasonic sensor for these wheel angles."""
    return 800 - pi * 56 * (angles["left"] + angles["right"]) / 2 / 360


def test_it_stops_before_the_wall(pybricks_hub):
    run = pybricks_hub.run(PROGRAM, robot=ROVER, readings={"eyes": distance_mm}, time_limit_s=30)
    words = run.output.split()
    assert words[0] == "stopped" and 120 <= int(words[1]) <= 150
    assert max(row["A_speed_deg_s"] for row in run.log) > 400  # it drove: 200 mm/s are 409 deg/s
