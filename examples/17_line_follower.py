"""Pybricks program: the scout follows the left edge of a line. It runs on a LEGO hub and does not
need BricksRL.

    bricktwin run examples/17_line_follower.py --scene line-simple --time-limit-s 30
    bricktwin run examples/17_line_follower.py --scene line-simple --video follow.mp4
"""

from pybricks.parameters import Direction, Port
from pybricks.pupdevices import ColorSensor, Motor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

SPEED = 150  # mm/s; a line with sharp bends needs 50
GAIN = 3.5  # turn rate (deg/s) for each percent that the sensor sees more or less than the edge
EDGE = 40  # half of the line, half of the floor
TIME = 28_000  # ms

base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
light = ColorSensor(Port.B)
watch = StopWatch()
while watch.time() < TIME:
    # Brighter: the robot is left of the edge, and turns to the right.
    base.drive(SPEED, GAIN * (light.reflection() - EDGE))
    wait(10)
base.stop()
