"""State of one robot of a fleet, as callbacks see it."""

from __future__ import annotations

from enum import StrEnum


class RobotState(StrEnum):
    """State of one robot of a fleet."""

    STARTING = "starting"
    PLACED = "placed"
    """Waits to be placed by hand at the start position."""
    ACTING = "acting"
    LEFT = "left"
    """Its link broke or its process ended; it is retried."""
    GIVEN_UP = "given up"
    """Its process ended again and again; it is not retried."""
    DONE = "done"
    """No episodes are left."""
