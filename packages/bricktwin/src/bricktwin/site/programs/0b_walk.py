# Walk on four legs
# Robot: walker
from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.tools import StopWatch, wait

hub = PrimeHub()

# Turns of the legs a second; below 0 they turn backwards. And who steps with whom: try others!
SPEED = -1.0
legs = [
    (Motor(Port.D, Direction.COUNTERCLOCKWISE), 0),
    (Motor(Port.A), 0),
    (Motor(Port.C), 180),
    (Motor(Port.B, Direction.COUNTERCLOCKWISE), 180),
]

for leg, phase in legs:
    leg.run_target(300, phase, wait=False)
wait(1000)

watch = StopWatch()
while watch.time() < 10000:
    angle = 360 * SPEED * watch.time() / 1000
    for leg, phase in legs:
        leg.track_target(phase + angle)
    wait(10)
