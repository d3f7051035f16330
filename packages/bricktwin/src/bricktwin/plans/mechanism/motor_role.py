"""Role of a motor: what it moves. Importing it imports nothing else."""

import enum


class Role(enum.StrEnum):
    """What a motor moves."""

    WHEEL = "wheel"
    """A wheel that rolls on the floor."""
    STEERING = "steering"
    """What carries a wheel, about an upright axis."""
    LEG = "leg"
    """Something without wheels that reaches the floor when it turns."""
    JOINT = "joint"
    """Something else: an arm, a gripper, a head."""
