"""Numbers, intervals and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bricksrl.evaluation.statistics import FEWEST_SEEDS


def number(value: float | None) -> str:
    """Three or four significant digits; an empty string for ``None``."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def within(value: float, interval: Iterable[float], seeds: int = FEWEST_SEEDS) -> str:
    """A mean and its interval, which fewer seeds than `FEWEST_SEEDS` do not have."""
    if seeds < FEWEST_SEEDS:
        return number(value)
    low, high = interval
    return f"{number(value)} [{number(low)}, {number(high)}]"


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a table; ``head`` are the names of its columns."""
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]


def table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; ``head`` are the names of its columns."""
    return "\n".join(markdown_table(head, rows)) + "\n"
