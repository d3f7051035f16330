"""What a check finds."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Outcome(enum.Enum):
    """Of one finding."""

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
