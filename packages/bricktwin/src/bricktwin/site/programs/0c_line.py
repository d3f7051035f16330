# Follow a line
# Robot: scout line-simple
from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import ColorSensor, Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait

hub = PrimeHub()
left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right = Motor(Port.A)
light = ColorSensor(Port.B)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=130)

# The edge of the line is half bright: the brighter it is, the more the robot turns.
EDGE = 50
while True:
    error = light.reflection() - EDGE
    robot.drive(120, 1.2 * error)
    wait(10)
