"""MicroPython: what counts on, such as a heading, from where the acting began, as environments let
it count from the start of an episode. ``COUNTING`` is defined before.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---


def relative(observed, first):
    """What a policy reads: the observation, with what counts on since the first one."""
    if not COUNTING:
        return observed
    read = list(observed)
    for place in COUNTING:
        read[place] -= first[place]
    return read
