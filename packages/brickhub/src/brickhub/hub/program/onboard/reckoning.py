"""MicroPython: dead reckoning of a place to reach, of a program that acts without a host: where
that is, seen from the robot, follows from how far the wheels have turned since the start.

``START`` and ``PLACE`` (mm, mm, degrees clockwise), ``DEG_PER_MM``, ``TRACK_MM`` and ``wheels``,
the angles of both, are defined before. ``seen_place`` is called once a step.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

import umath

pose = list(START)
turned_before = []


def signed(angle):
    return (angle + 180) % 360 - 180


def seen_place():
    """Where the place is (mm ahead, mm to the left, degrees clockwise), and the last step's way and
    turn."""
    now = wheels()
    before = turned_before or now
    left_mm, right_mm = [signed(now[side] - before[side]) / DEG_PER_MM for side in (0, 1)]
    turned_before[:] = now
    way = (left_mm + right_mm) / 2
    half_turn = (left_mm - right_mm) / TRACK_MM / 2
    heading = umath.radians(pose[2]) + half_turn
    # An arc ends where its chord does.
    chord = way * umath.sin(half_turn) / half_turn if half_turn else way
    turn_deg = umath.degrees(2 * half_turn)
    pose[0] += chord * umath.cos(heading)
    pose[1] -= chord * umath.sin(heading)
    pose[2] += turn_deg
    x = PLACE[0] - pose[0]
    y = PLACE[1] - pose[1]
    heading = umath.radians(pose[2])
    return [
        x * umath.cos(heading) - y * umath.sin(heading),
        x * umath.sin(heading) + y * umath.cos(heading),
        signed(PLACE[2] - pose[2]),
        way,
        turn_deg,
    ]
