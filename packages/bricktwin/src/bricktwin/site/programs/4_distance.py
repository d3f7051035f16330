# Stop before a wall
from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import wait

hub = PrimeHub()
left = Motor(Port.A, Direction.COUNTERCLOCKWISE)
right = Motor(Port.B)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=112)
eyes = UltrasonicSensor(Port.F)

# Move the slider of the distance: below 300 mm the wheels stop.
while True:
    distance = eyes.distance()
    if distance < 300:
        robot.stop()
        hub.display.char("X")
    else:
        robot.drive(200, 0)
        hub.display.char("^")
    wait(20)
