"""Formula of the features: what an observation in physical units becomes before a network reads it.

It is written once for torch, which learns, and for NumPy, which plays a trained policy without
waiting for torch: what the two spell differently is handed in as `Operations`. Importing this loads
neither.
"""

from collections.abc import Sequence
from typing import Any, Protocol

FULL_TURN_DEG = 360.0


class Constants(Protocol):
    """What the formula knows of an observation ``[n]``: arrays of either kind.

    Attributes:
        linear, scale, offset: indices, factors and offsets of the scaled entries.
        angle_matrix: ``[n, angles]``, from observations to the angles, in rad, whose sine and
            cosine are features.
        goal, reached, period, goal_scale: indices of the goals and of what is to reach them; their
            period (infinite for what does not wrap) and factor.
    """

    @property
    def linear(self) -> Any: ...
    @property
    def scale(self) -> Any: ...
    @property
    def offset(self) -> Any: ...
    @property
    def angle_matrix(self) -> Any: ...
    @property
    def goal(self) -> Any: ...
    @property
    def reached(self) -> Any: ...
    @property
    def period(self) -> Any: ...
    @property
    def goal_scale(self) -> Any: ...


class Operations(Protocol):
    """What torch and NumPy spell differently; all act on the last dimension."""

    def take(self, values: Any, indices: Any) -> Any:
        """The values at indices."""

    def scaled(self, values: Any, scale: Any, offset: Any) -> Any:
        """Values times a factor, plus an offset."""

    def sin(self, values: Any) -> Any:
        """Sine of radians."""

    def cos(self, values: Any) -> Any:
        """Cosine of radians."""

    def joined(self, parts: Sequence[Any]) -> Any:
        """One part after the other."""


def scaled_entries(
    observation: Any,
    constants: Constants,
    operations: Operations,
) -> Any:
    """Entries ``[*batch, entries]`` that are no angles, within -1..1 where they have a range."""
    selected = operations.take(observation, constants.linear)
    return operations.scaled(selected, constants.scale, constants.offset)


def with_circles_and_goals(
    linear: Any,
    observation: Any,
    constants: Constants,
    operations: Operations,
) -> Any:
    """Features ``[*batch, f]``: ``linear`` entries, then all sines, all cosines, and all
    differences of an observation to its goals."""
    parts = [linear]
    if constants.angle_matrix.shape[1]:
        angle_rad = observation @ constants.angle_matrix
        parts += [operations.sin(angle_rad), operations.cos(angle_rad)]
    if len(constants.goal):
        goal = operations.take(observation, constants.goal)
        reached = operations.take(observation, constants.reached)
        difference = goal - reached
        # the shorter way round; what does not wrap has an infinite period, and no turns
        whole_turns = (difference / constants.period).round()
        shorter = difference - whole_turns * FULL_TURN_DEG
        parts.append(shorter * constants.goal_scale)
    return operations.joined(parts)
