"""Intervals and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bricksrl.evaluation.statistics import FEWEST_SEEDS
from bricksrl.evaluation.study_page import markdown_table, number


def within(value: float, interval: Iterable[float], seeds: int = FEWEST_SEEDS) -> str:
    """A mean and its interval, which fewer seeds than `FEWEST_SEEDS` do not have."""
    if seeds < FEWEST_SEEDS:
        return number(value)
    low, high = interval
    return f"{number(value)} [{number(low)}, {number(high)}]"


def table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; ``head`` are the names of its columns."""
    return "\n".join(markdown_table(head, rows)) + "\n"
