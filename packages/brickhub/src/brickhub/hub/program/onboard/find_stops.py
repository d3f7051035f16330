"""MicroPython: turns each joint slowly to both of its stops and back to the middle."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def find_stop(motor, speed):
    """Turn until the motor is blocked, and say where that is; None when that does not happen."""
    start = motor.angle()
    watch = StopWatch()
    motor.run(speed)
    while not motor.stalled():
        wait(10)
        if watch.time() > LIMIT_MS or abs(motor.angle() - start) > LIMIT_DEG:
            motor.stop()
            return None
    angle = motor.angle()
    motor.stop()
    return angle


def find_stops(name, port, direction, gears):
    motor = Motor(port, direction, gears)
    motor.control.limits(torque=TORQUE_MNM)
    low = find_stop(motor, -SPEED_DEG_S)
    high = find_stop(motor, SPEED_DEG_S)
    if low is None or high is None:
        print("free", name)
        return
    print("stops", name, low, high)
    motor.run_target(SPEED_DEG_S, (low + high) // 2, wait=False)
    watch = StopWatch()
    while not motor.done() and watch.time() < LIMIT_MS:
        wait(10)


for joint in MOTORS:
    find_stops(*joint)
print("end")
