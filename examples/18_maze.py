"""Pybricks program: the scout finds the red cell of a maze. It runs on a LEGO hub and does not need
BricksRL.

    bricktwin run examples/18_maze.py --scene maze --video maze.mp4

It drives to the next wall, and turns to the left if there is room, otherwise to the right.
"""

from pybricks.parameters import Color, Direction, Port, Stop
from pybricks.pupdevices import ColorSensor, Motor, UltrasonicSensor
from pybricks.robotics import DriveBase

NEAR = 95  # mm from the sensor to a wall
ROOM = 200

base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
base.settings(straight_speed=200, turn_rate=120)
eyes = UltrasonicSensor(Port.C)
light = ColorSensor(Port.B)

while True:
    base.straight(eyes.distance() - NEAR, then=Stop.HOLD)
    if light.color() == Color.RED:
        break
    base.turn(-90)
    if eyes.distance() < ROOM:
        base.turn(180)
print("found it")
