"""Estimates of what LEGO publishes nowhere about its kits of 2026: one table, for the code, its tests and the documentation."""

from __future__ import annotations

FULL_SPEED_DEG_S = 1000
"""Speed of 100 %."""
DEFAULT_SPEED_PCT = 50
ACCELERATION_DEG_S2_PER_PCT = 100
FULL_LEVER_DEG = 45
SUPERVISION_S = 24.0
"""Silence after which a device takes its link for lost: a comment in LEGO's package names it, for the device's side."""
NOTIFICATION_GAP_S = 1.0
"""Silence after which this computer takes a device for lost, whose notifications come at least that often."""

ESTIMATES = (
    ("motors", "are medium motors of SPIKE, and control them as Pybricks does", "nothing"),
    ("100 % of speed", f"is {FULL_SPEED_DEG_S} degrees/s", "the firmware's limit of a medium motor"),
    ("speed of a command without one", f"is {DEFAULT_SPEED_PCT} %", "the default in `movement_move_tank_for_degrees`"),
    ("a new speed during a move", "acts at once on an endless move, and on the next one otherwise", "LEGO's text on `movement`"),
    ("1 % of acceleration", f"is {ACCELERATION_DEG_S2_PER_PCT} degrees/s²; else as in Pybricks", "SPIKE App 3: up to 10000"),
    ("end state DEFAULT", "is SMART_BRAKE", "SPIKE App 3"),
    ("move that stalls", "ends as interrupted", "the state `STALLED`"),
    ("`power`, and the command of a duty cycle", "are in 0.01 %", "the package sends 100 for 1 %"),
    ("forward", "turns the left motor counterclockwise, the right one clockwise", "how a motor is mirrored"),
    ("steering", "100 turns on the spot, 50 around the inner wheel, 0 drives straight", "nothing"),
    ("turn by the IMU", "slows down so that it ends at its angle", "nothing"),
    ("yaw", "degrees, clockwise positive, 0 at the connection", "SPIKE App 2"),
    ("pitch, roll", "degrees, nose down and left side up positive, as in Pybricks", "nothing"),
    ("gyroscope, accelerometer", "degrees/s and thousandths of g: ahead, left, up", "SPIKE App 3"),
    ("gestures", "never occur", "nothing"),
    ("Color Sensor", "sees as that of SPIKE; raw values up to 255", "LEGO's example: red is over 128"),
    ("levers", f"turn by {FULL_LEVER_DEG} degrees at 100 %", "nothing"),
    ("first notification", "comes with the answer to its request", "LEGO's comment: within 0.2 s"),
    ("Bluetooth", "carries packets at connection events, as that of a hub; none gets lost", "the twin's physics"),
    ("lost link", f"the last command goes on to its end; after {SUPERVISION_S:g} s the motors coast", "LEGO's comment"),
    ("connection card", "a virtual device has the card that a program asks for", "so that programs run unchanged"),
)
"""Rows: what, what a virtual device does, after what."""


def markdown() -> str:
    """The table in Markdown, for the documentation."""
    rows = [f"| {what} | {does} | {after} |" for what, does, after in ESTIMATES]
    return "\n".join(["| of a device | estimated: it | after |", "|---|---|---|", *rows]) + "\n"
