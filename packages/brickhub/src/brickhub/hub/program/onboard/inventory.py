"""MicroPython: reports the connected devices and the state of the hub. Moves nothing."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

found = {"ports": {name: device_id(port) for name, port in PORTS}, "angles_deg": {}}
for name, port, direction, gears in MOTORS:
    try:
        found["angles_deg"][name] = Motor(port, direction, gears).angle()
    except OSError:
        pass  # its port says that it is not there
found.update(battery_mv=hub.battery.voltage(), firmware=version[1], name=hub.system.name())
if HAS_IMU:
    pitch, roll = hub.imu.tilt()
    found.update(
        imu_ready=hub.imu.ready(),
        imu_still=hub.imu.stationary(),
        pitch_deg=round(pitch),
        roll_deg=round(roll),
    )
print(found)
print("end")
