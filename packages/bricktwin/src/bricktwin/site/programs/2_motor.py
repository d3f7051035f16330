# A motor that turns to an angle
from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait

hub = PrimeHub()
motor = Motor(Port.A)

for angle in (90, 180, 360, 0):
    motor.run_target(500, angle)
    print("The motor is at", motor.angle(), "degrees.")
    hub.display.number(angle // 10)
    wait(500)
