"""Formula of legs that turn endlessly, each held at its phase: see `oscillators.py`."""
# mypy: ignore-errors
# ruff: noqa: B905

import math as umath

# --- the hub's part ---


def turn_legs(legs, size, observed, numbers):
    """Turn all legs at one speed; one that is ahead of its phase waits for the others."""
    errors = []
    for angle, _, sign, _, half_turn, place in legs:
        phase = half_turn + (numbers[place] if place else 0.0)
        errors.append(umath.radians(observed[angle] * sign - phase))
    # What is called an error holds the common rotation too, which is the circular mean.
    sine = sum([umath.sin(error) for error in errors])
    cosine = sum([umath.cos(error) for error in errors])
    mean = umath.atan2(sine, cosine)
    actions = [0.0] * size
    for (_, action, sign, gain, _, _), error in zip(legs, errors):
        # The shorter way round, -180..180.
        ahead = (umath.degrees(error - mean) + 180.0) % 360.0 - 180.0
        actions[action] = sign * max(-1.0, min(1.0, numbers[0] - ahead * gain))
    return actions
