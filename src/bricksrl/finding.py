"""Findings of checks: of a hub program, a building plan, a robot, an environment, this computer."""

from __future__ import annotations

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
    """One thing that was checked.

    Attributes:
        name: a word or two, such as ``battery`` or ``collision``.
        detail: what was found, and what to do if it is not well.
        line: of a plan's file; 0 for the whole.
    """

    name: str
    outcome: Outcome
    detail: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.name}: {self.detail}"

    def to_dict(self) -> dict[str, str]:
        """Plain values, fit for JSON."""
        return {"name": self.name, "outcome": self.outcome.value, "detail": self.detail}
