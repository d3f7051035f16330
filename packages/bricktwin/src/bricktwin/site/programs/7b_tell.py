# Two hubs: one tells what it does
# Robot: two-wheeler
# With: hear.py
from pybricks.hubs import PrimeHub
from pybricks.messaging import BLERadio
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait

hub = PrimeHub()
radio = BLERadio(broadcast_channel=1)
left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right = Motor(Port.A)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=130)

for number in range(4):
    hub.display.number(number + 1)
    # The other hub hears it after a tenth of a second or two.
    radio.broadcast((number, 200, 90))
    wait(300)
    robot.straight(200)
    robot.turn(90)

radio.broadcast("done")
wait(500)
