"""MicroPython: watches the ports until the program is stopped. The hub tells an app what is plugged
in; here nobody listens."""

# mypy: ignore-errors
# --- the hub's part ---
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Port
from pybricks.tools import wait

ports = [getattr(Port, letter) for letter in "ABCDEF" if hasattr(Port, letter)]

while True:
    for port in ports:
        try:
            PUPDevice(port).info()
        except OSError:
            pass  # nothing is plugged in, or it was just unplugged
    wait(100)
