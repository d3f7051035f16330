# A piano of two buttons
from pybricks.hubs import PrimeHub
from pybricks.parameters import Button, Port
from pybricks.pupdevices import ForceSensor
from pybricks.tools import wait

hub = PrimeHub()
pedal = ForceSensor(Port.D)

# Press the hub's buttons below; the harder you press the sensor, the higher the tone.
print("Press the hub's left and right buttons.")
while True:
    pressed = hub.buttons.pressed()
    higher = int(60 * pedal.force())
    if Button.LEFT in pressed:
        hub.display.char("L")
        hub.speaker.beep(330 + higher, 100)
    elif Button.RIGHT in pressed:
        hub.display.char("R")
        hub.speaker.beep(440 + higher, 100)
    else:
        hub.display.off()
    wait(20)
