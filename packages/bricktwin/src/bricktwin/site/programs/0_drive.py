# Drive up to the wall, and around it
# Robot: two-wheeler wall
from pybricks.hubs import PrimeHub
from pybricks.parameters import Color, Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import wait

hub = PrimeHub()
left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right = Motor(Port.A)
eyes = UltrasonicSensor(Port.C)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=130)

print("I drive until the wall is near.")
hub.light.on(Color.GREEN)
robot.drive(250, 0)
while eyes.distance() > 220:
    wait(10)
robot.stop()

print("The wall is", eyes.distance(), "mm away. I drive around it.")
hub.light.on(Color.ORANGE)
# The wall is three metres wide: half of it, and the robot's own width.
robot.settings(straight_speed=400)
robot.turn(-90)
robot.straight(1700)
robot.turn(90)
robot.straight(600)
robot.turn(90)
robot.straight(1700)

print("Here I am.")
hub.light.on(Color.BLUE)
for _ in range(2):
    robot.turn(360)
