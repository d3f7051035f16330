# Drive a square
from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase

hub = PrimeHub()
left = Motor(Port.A, Direction.COUNTERCLOCKWISE)
right = Motor(Port.B)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=112)

for side in range(1, 5):
    hub.display.number(side)
    robot.straight(300)
    robot.turn(90)
    print("Side", side, "is done; the hub's heading is", round(hub.imu.heading()), "degrees.")
