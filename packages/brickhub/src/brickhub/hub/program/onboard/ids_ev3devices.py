"""MicroPython: the number of the device on a port of an EV3, which is asked in three ways."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def motor_id(port):
    motor = Motor(port)
    speed = motor.control.limits()[0]
    motor.close()
    # The brick knows the kind of a motor, but tells only its limits: 800 or 1200 deg/s.
    return 86 if speed < 1000 else 87


def sensor_id(port):
    number = PUPDevice(port).info()["id"]
    # A port for motors passes for one with any plain motor.
    return number if number < 88 else 0


def touch_id(port):
    TouchSensor(port)
    return 85


def device_id(port):
    for look in (motor_id, touch_id, sensor_id):
        try:
            return look(port)
        except OSError:
            pass  # it is another one, or none
    return 0
