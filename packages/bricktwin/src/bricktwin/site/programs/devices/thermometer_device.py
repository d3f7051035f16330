# A thermometer, played by a function: what it measures at a time in seconds.
import math

from brickhub.virtual.own_devices import OwnDevice, OwnMode


def temperature(time_s):
    # Tenths of a degree, between 15 and 35 degrees; it gets warm and cold within ten seconds.
    return [round(250 + 100 * math.sin(2 * math.pi * time_s / 10))]


THERMOMETER = OwnDevice(id=200, modes=(OwnMode("CELSIUS", temperature),))
