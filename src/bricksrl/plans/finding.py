"""Findings of the plan check."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """A mistake in a plan.

    Attributes:
        kind: a word or two, such as ``collision``.
        line: of the file, 0 for the whole plan.
        text: what is wrong, and what to do.
        parts: indices of the parts concerned.
    """

    kind: str
    line: int
    text: str
    parts: tuple[int, ...] = ()
