"""A finding of the check of a plan."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a plan.

    Attributes:
        kind: a word or two, such as ``collision``.
        line: of the file, 0 where it is about the whole.
        text: what is wrong, and what to do.
        parts: indices of the parts that it is about.
    """

    kind: str
    line: int
    text: str
    parts: tuple[int, ...] = ()
