# The light follows the color sensor
from pybricks.hubs import PrimeHub
from pybricks.parameters import Color, Port
from pybricks.pupdevices import ColorSensor
from pybricks.tools import wait

hub = PrimeHub()
sensor = ColorSensor(Port.C)
seen = None

# Choose a color beside the program while it runs.
while True:
    color = sensor.color()
    if color != seen:
        seen = color
        print("I see", color, "and", sensor.reflection(), "% of my light.")
        if color == Color.NONE:
            hub.light.off()
        else:
            hub.light.on(color)
    wait(50)
