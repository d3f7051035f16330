"""Findings of checks of a hub program, a building plan, a robot, an environment or this
computer."""

import enum
from dataclasses import dataclass


class Outcome(enum.Enum):
    """Outcome of one finding."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Attributes:
        name: a word or two, such as ``battery`` or ``collision``.
        detail: what was found and, unless it is ok, what to do.
        line: line of a plan's file; 0 for the whole plan.
    """

    name: str
    outcome: Outcome
    detail: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.name}: {self.detail}"

    def to_dict(self) -> dict[str, str]:
        """The finding as a dict for JSON."""
        return {"name": self.name, "outcome": self.outcome.value, "detail": self.detail}
