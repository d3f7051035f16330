"""MicroPython: a motor whose targets stay within a range. Part of a hub program when its robot has
such a motor."""
# mypy: ignore-errors
# --- the hub's part ---


class Joint:
    """A motor that never gets a target outside of its range."""

    def __init__(self, motor, low, high):
        self.motor = motor
        self.low = low
        self.high = high
        self.target = None
        self.angle = motor.angle
        self.done = motor.done

    def turn(self, speed, angle):
        # Count from the held target: counting from the measured angle, a joint that sags a little
        # under its load would creep down with every step.
        if self.target is None or not self.motor.done():
            self.target = self.motor.angle()
        self.target = max(self.low, min(self.high, self.target + angle))
        self.motor.run_target(speed, self.target, wait=False)

    def stop(self):
        self.target = None
        self.motor.stop()
