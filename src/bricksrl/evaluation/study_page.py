"""Page of a study: its tables in Markdown, next to the paper's numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from bricksrl.evaluation.statistics import interquartile_mean

Numbers = dict[str, Any]


def page(result: Numbers) -> str:
    """Tables in Markdown: a row for each cell and condition, without empty columns."""
    quick = " (quick form: it checks that everything works and says nothing about learning)" if result["quick"] else ""
    lines = [f"# {result['title']}{quick}", ""]
    lines += [f"Command: `bricksrl study {result['study']}`. Numbers are interquartile means over seeds. Square brackets are"]
    lines += ["95 % intervals; fewer than 5 seeds have none. All robots here are virtual; the paper used real LEGO robots.", ""]
    rows = [(cell, name, values) for cell in result["cells"] for name, values in cell["conditions"].items()]
    columns = [(head, [text_of(*row) for row in rows]) for head, text_of in _columns(result).items()]
    shown = [(head, cells) for head, cells in columns if any(cells)]
    lines += markdown_table([head for head, _ in shown], list(zip(*(cells for _, cells in shown), strict=True)))
    if result.get("improvements"):
        pairs = [
            (pair["column"], pair["row"], pair["over"], f"{pair['probability']:.2f}{_within(pair['probability_95'])}")
            for pair in result["improvements"]
        ]
        lines += ["", *markdown_table(("column", "row", "over", "probability of improvement"), pairs)]
    for table in result.get("tables", ()):
        lines += ["", f"## {table['title']}", "", *markdown_table(table["head"], table["rows"])]
    for note in result.get("notes", ()):
        lines += ["", note]
    machine, versions = result["machine"], result["versions"]
    lines += ["", f"{machine['processor']}, {machine['cores']} cores; " + ", ".join(f"{k} {v}" for k, v in versions.items())]
    return "\n".join(lines) + "\n"


def _columns(result: Numbers) -> dict[str, Callable[[Numbers, str, Numbers], str]]:
    """Columns by heading, each a function of a cell, a condition's name and its results."""
    metrics = {name: _metric(name) for name in result.get("metrics", ())}
    return {
        "row": lambda cell, name, values: cell["row"],
        "column": lambda cell, name, values: cell["column"],
        "seeds": lambda cell, name, values: str(cell["seeds"]),
        "condition": lambda cell, name, values: name,
        "return": lambda cell, name, values: f"{values['return_iqm']:.4g}{_within(values['return_95'])}",
        "the paper's return": lambda cell, name, values: _spread(cell.get("paper", {}).get("return")),
        "success": lambda cell, name, values: percent(values.get("success_rate")) + _within(values.get("success_95"), 100),
        "the paper's success": lambda cell, name, values: percent(cell.get("paper", {}).get("success")),
        **metrics,
        "steps": lambda cell, name, values: _over_seeds(cell.get("steps", ()), 1.0, ".0f"),
        "CPU minutes": lambda cell, name, values: _minutes(cell, "cpu_s"),
        "wall minutes": lambda cell, name, values: "" if _minutes(cell, "cpu_s") else _minutes(cell, "wall_s"),
        "robot minutes": lambda cell, name, values: _minutes(cell, "robot_s"),
        "reached": lambda cell, name, values: _count(cell.get("reached", ())),
        "the paper's minutes": lambda cell, name, values: number(cell.get("paper", {}).get("minutes")),
    }


def _metric(name: str) -> Callable[[Numbers, str, Numbers], str]:
    return lambda cell, condition, values: number(values.get("metrics", {}).get(name))


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a table; ``head`` are the names of its columns."""
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]


def _within(interval: Sequence[float] | None, factor: float = 1.0) -> str:
    return "" if interval is None else f" [{factor * interval[0]:.4g}, {factor * interval[1]:.4g}]"


def number(value: float | None) -> str:
    """Three or four significant digits; an empty string for ``None``."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def percent(rate: float | None) -> str:
    """A share in whole percent; an empty string for ``None``."""
    return "" if rate is None else f"{100 * rate:.0f} %"


def _spread(value: Sequence[float] | float | None) -> str:
    """A mean, with its standard deviation if known."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, int | float) else f"{value[0]:.4g} ± {value[1]:.3g}"


def _count(reached: Sequence[bool | None]) -> str:
    return "" if None in reached or not reached else f"{sum(map(bool, reached))} of {len(reached)}"


def _minutes(cell: Numbers, name: str) -> str:
    return _over_seeds(cell.get(name, ()), 60.0, ".1f")


def _over_seeds(values: Sequence[float | None], unit: float, form: str) -> str:
    known = [value for value in values if value is not None]
    return f"{float(interquartile_mean(np.array(known))) / unit:{form}}" if known and len(known) == len(values) else ""
