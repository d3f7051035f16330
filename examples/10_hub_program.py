"""Pybricks program: a robot backs away from a wall and measures its distance. It runs on a LEGO hub
and does not need BricksRL.

    # a virtual robot, filmed:
    bricksrl hub run examples/10_hub_program.py --robot RunAway-v0 --video away.mp4
    # your own 2Wheeler:
    bricksrl hub run examples/10_hub_program.py --hub ble
"""

from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase

FAR_MM = 800

hub = PrimeHub()
left, right = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A)
base = DriveBase(left, right, wheel_diameter=56, axle_track=130)
eyes = UltrasonicSensor(Port.C)

print("the wall is", eyes.distance(), "mm away")
while eyes.distance() < FAR_MM:
    base.straight(-100)
print(
    "now it is",
    eyes.distance(),
    "mm away, and the hub looks",
    round(hub.imu.heading()),
    "degrees to the right",
)
