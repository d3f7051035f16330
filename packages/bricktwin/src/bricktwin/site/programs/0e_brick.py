# An EV3 drives to the wall, and writes on its screen
# Robot: ev3-driver wall
from pybricks.ev3devices import GyroSensor, Motor, TouchSensor, UltrasonicSensor
from pybricks.hubs import EV3Brick
from pybricks.parameters import Button, Color, Port
from pybricks.robotics import DriveBase
from pybricks.tools import wait

ev3 = EV3Brick()
left = Motor(Port.B)
right = Motor(Port.C)
eyes = UltrasonicSensor(Port.S4)
gyro = GyroSensor(Port.S2)
touch = TouchSensor(Port.S1)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=120)

ev3.light.on(Color.GREEN)
ev3.screen.print("I look for a wall.")
robot.drive(200, 0)
while eyes.distance() > 250 and not touch.pressed():
    wait(10)
robot.stop()

ev3.light.on(Color.ORANGE)
ev3.screen.print("There it is:")
ev3.screen.print(eyes.distance(), "mm away.")
print("The wall is", eyes.distance(), "mm away. I turn round.")
robot.turn(180)
print("The gyro sensor says", gyro.angle(), "degrees.")
robot.straight(400)
ev3.speaker.beep()
ev3.light.on(Color.GREEN)
ev3.screen.print("Press a button.")
for _ in range(40):
    if Button.CENTER in ev3.buttons.pressed():
        ev3.screen.print("Thank you!")
        break
    wait(100)
