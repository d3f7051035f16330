"""MicroPython: goals that the hub draws itself, of a program that acts without a host.
``generate.py`` puts it before ``observe``, which is called once a step.

``GOALS`` and ``GOAL_STEPS`` are defined before.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

from urandom import randint, uniform

drawn = []
steps = 0


def goals():
    """The goals of this step."""
    global drawn, steps
    if steps % GOAL_STEPS == 0:
        drawn = [
            randint(low, high) if isinstance(low, int) else uniform(low, high)
            for low, high in GOALS
        ]
    steps += 1
    return drawn
