"""Numbers, intervals and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable

LEAST_SEEDS = 5
"""The fewest seeds with an interval."""


def number(value: float | None) -> str:
    """Three or four significant digits; an empty string for ``None``."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def percent(rate: float | None) -> str:
    """A share in whole percent."""
    return "" if rate is None else f"{100 * rate:.0f} %"


def within(value: float, interval: Iterable[float], seeds: int = LEAST_SEEDS) -> str:
    """A mean and its interval, which fewer seeds than `LEAST_SEEDS` do not have."""
    if seeds < LEAST_SEEDS:
        return number(value)
    low, high = interval
    return f"{number(value)} [{number(low)}, {number(high)}]"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; ``head`` are the names of its columns."""
    columns = list(head)
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
