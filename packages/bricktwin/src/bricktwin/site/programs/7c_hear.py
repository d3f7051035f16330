# Two hubs: one does what it hears
# Robot: two-wheeler
# With: tell.py
from pybricks.hubs import PrimeHub
from pybricks.messaging import BLERadio
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

hub = PrimeHub()
radio = BLERadio(observe_channels=[1])
left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right = Motor(Port.A)
robot = DriveBase(left, right, wheel_diameter=56, axle_track=130)
watch = StopWatch()
last = None

while watch.time() < 20000:
    heard = radio.observe(1)
    if heard == "done":
        break
    if heard is not None and heard != last:
        last = heard
        number, distance, angle = heard
        print("number", number, "at", radio.signal_strength(1), "dBm")
        hub.display.number(number + 1)
        robot.straight(distance)
        robot.turn(angle)
    wait(10)
