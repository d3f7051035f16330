# Hello: light, display and sound
from pybricks.hubs import PrimeHub
from pybricks.parameters import Color, Icon
from pybricks.tools import wait

hub = PrimeHub()

print("Hello! This is a LEGO hub, in your browser.")

for color in (Color.RED, Color.YELLOW, Color.GREEN, Color.BLUE):
    hub.light.on(color)
    print(color)
    hub.speaker.beep(400 + 2 * color.h, 150)
    wait(350)

hub.display.icon(Icon.HAPPY)
wait(2000)
