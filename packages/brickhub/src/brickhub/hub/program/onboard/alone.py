"""MicroPython: the loop of a program that acts by itself, without a host. ``generate.py`` appends
it to what it needs.

The names in capitals, ``observe``, ``act`` and ``start_moves`` are defined before; ``stop_motors``
in ``moves.py``, ``relative`` in ``relative.py``. The center button ends the program, as it does by
default, and then the motors stop. Each step prints a line: how long the program has computed (ms),
the observation, and the commands times their scales.
"""
# mypy: ignore-errors
# ruff: noqa: F821, B905
# --- the hub's part ---

from pybricks.tools import StopWatch, wait

CLOCK = StopWatch()
COMMANDED = [0] * len(SPANS)  # the last commands, times their scales


def settle(started_ms):
    """Wait for the end of a step. A move that is still blocked then is stopped."""
    left_ms = SETTLE_MS
    while left_ms > 0 and not (UNTIL_DONE and all(mover.done() for mover in MOVERS)):
        wait(min(LOOK_MS, left_ms))
        left_ms = started_ms + SETTLE_MS - CLOCK.time()
    if UNTIL_DONE:
        for mover in MOVERS:
            if not mover.done():
                mover.stop()


def live():
    """Observe, act and wait, step by step."""
    first = None
    try:
        while True:
            observed = observe()
            if first is None:
                first = observed
            observed = relative(observed, first)
            seen_ms = CLOCK.time()
            commands = [
                round(middle + half * action)
                for (middle, half), action in zip(SPANS, act(observed))
            ]
            COMMANDED[:] = commands
            computed_ms = CLOCK.time() - seen_ms
            wait(max(0, AGE_MS - computed_ms))
            started_ms = CLOCK.time()
            start_moves(commands)
            print(computed_ms, *observed, *commands)
            settle(started_ms)
    finally:
        stop_motors()


live()
