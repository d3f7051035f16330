"""MicroPython: turns each wheel of a drive base forward and back, alone, and reports by how much
the hub turned."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def turn(motor, angle):
    """Turn the motor, for a limited time. Returns its angle and the hub's turn, clockwise."""
    motor_before = motor.angle()
    heading_before = hub.imu.heading()
    motor.run_angle(SPEED_DEG_S, angle, wait=False)
    watch = StopWatch()
    while not motor.done() and watch.time() < LIMIT_MS:
        wait(10)
    wait(SETTLE_MS)
    return motor.angle() - motor_before, round(hub.imu.heading() - heading_before, 1)


wheels = [(name, Motor(port, direction, gears)) for name, port, direction, gears in MOTORS]
for _, motor in wheels:
    motor.hold()
for name, motor in wheels:
    forward = turn(motor, ANGLE_DEG)
    back = turn(motor, -ANGLE_DEG)
    print("wheel", name, forward[0] - back[0], forward[1] - back[1])
for _, motor in wheels:
    motor.stop()
print("end")
