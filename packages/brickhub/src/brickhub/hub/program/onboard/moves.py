"""MicroPython: limits and ends of moves, for every program that is generated."""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

LOOK_MS = 5  # between two looks at motors, whose moves end in a control loop of 5 ms


def whole(value, low, high, scale):
    """Clamp a wire value to its range; in whole degrees or millimetres, as the motors take them."""
    return (max(low, min(high, value)) + scale // 2) // scale


def stop_motors():
    for mover in MOVERS:
        try:
            mover.stop()
        except OSError:
            pass  # unplugged; go on with the others
