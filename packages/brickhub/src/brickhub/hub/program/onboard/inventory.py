"""MicroPython: reports the connected devices and the state of the hub. Moves nothing."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def device_id(port):
    try:
        return PUPDevice(port).info()["id"]
    except OSError:
        return 0


for name, port in PORTS:
    print("port", name, device_id(port))
for name, port, direction, gears in MOTORS:
    try:
        print("angle", name, Motor(port, direction, gears).angle())
    except OSError:
        pass  # its port says that it is not there
print("battery", hub.battery.voltage())
print("firmware", version[1])
if HAS_IMU:
    pitch, roll = hub.imu.tilt()
    print("imu", int(hub.imu.ready()), int(hub.imu.stationary()), round(pitch), round(roll))
print("name", hub.system.name())
print("end")
