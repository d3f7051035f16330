# A device of your own: a thermometer
# Port: C=thermometer_device.py:THERMOMETER
from pybricks.hubs import PrimeHub
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Color, Port
from pybricks.tools import wait

hub = PrimeHub()
# The line above says which device is on the port. Look at it among your programs.
thermometer = PUPDevice(Port.C)
print(thermometer.info())

for _ in range(20):
    (tenths,) = thermometer.read(0)
    print(tenths / 10, "degrees")
    hub.display.number(tenths // 10)
    hub.light.on(Color.RED if tenths > 250 else Color.GREEN)
    wait(500)
