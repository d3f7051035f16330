"""Findings of checks: of a hub program, a robot, an environment, this computer."""

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
    """One thing that was looked at; ``detail`` says what was found and, where it is not well, what to do."""

    name: str
    outcome: Outcome
    detail: str

    def __str__(self) -> str:
        return f"{self.name}: {self.detail}"

    def to_dict(self) -> dict[str, str]:
        """Plain values, fit for JSON."""
        return {"name": self.name, "outcome": self.outcome.value, "detail": self.detail}
