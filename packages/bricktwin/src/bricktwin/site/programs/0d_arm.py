# Wave with an arm
# Robot: robo-arm
from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait

hub = PrimeHub()
rotation = Motor(Port.B, gears=[20, 60])
low = Motor(Port.D)
high = Motor(Port.A)

for side in (60, -60, 60, -60, 0):
    rotation.run_target(200, side, wait=False)
    high.run_target(150, -60)
    high.run_target(150, 0)
    print("The arm is turned by", rotation.angle(), "degrees.")
wait(500)
