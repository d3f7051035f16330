# Two things at once
from pybricks.hubs import PrimeHub
from pybricks.parameters import Color, Port
from pybricks.pupdevices import Motor
from pybricks.tools import multitask, run_task, wait

hub = PrimeHub()
motor = Motor(Port.A)


async def swing():
    for _ in range(3):
        await motor.run_target(400, 120)
        await motor.run_target(400, -120)


async def blink():
    while True:
        hub.light.on(Color.BLUE)
        await wait(200)
        hub.light.off()
        await wait(200)


async def main():
    # The race is over when the motor is done.
    await multitask(swing(), blink(), race=True)
    print("Done.")


run_task(main())
