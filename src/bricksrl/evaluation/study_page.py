"""Page of a study: its tables in Markdown, next to the paper's numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    rows = [(cell, name, one) for cell in result["cells"] for name, one in cell["conditions"].items()]
    columns = [(head, [say(*row) for row in rows]) for head, say in _columns(result).items()]
    shown = [(head, values) for head, values in columns if any(values)]
    lines += _table([head for head, _ in shown], list(zip(*(values for _, values in shown), strict=True)))
    if result.get("improvements"):
        of_pairs = [
            (one["column"], one["row"], one["over"], f"{one['probability']:.2f}{_within(one['probability_95'])}")
            for one in result["improvements"]
        ]
        lines += ["", *_table(("column", "row", "over", "probability of improvement"), of_pairs)]
    for table in result.get("tables", ()):
        lines += ["", f"## {table['title']}", "", *_table(table["head"], table["rows"])]
    for note in result.get("notes", ()):
        lines += ["", note]
    machine, versions = result["machine"], result["versions"]
    lines += ["", f"{machine['processor']}, {machine['cores']} cores; " + ", ".join(f"{k} {v}" for k, v in versions.items())]
    return "\n".join(lines) + "\n"


def _columns(result: Numbers) -> dict[str, Callable[[Numbers, str, Numbers], str]]:
    """Columns by heading, each a function of a cell, a condition's name and its results."""
    metrics = {name: _metric(name) for name in result.get("metrics", ())}
    return {
        "row": lambda cell, name, one: cell["row"],
        "column": lambda cell, name, one: cell["column"],
        "seeds": lambda cell, name, one: str(cell["seeds"]),
        "condition": lambda cell, name, one: name,
        "return": lambda cell, name, one: f"{one['return_iqm']:.4g}{_within(one['return_95'])}",
        "the paper's return": lambda cell, name, one: _spread(cell.get("paper", {}).get("return")),
        "success": lambda cell, name, one: _percent(one.get("success_rate")) + _within(one.get("success_95"), 100),
        "the paper's success": lambda cell, name, one: _percent(cell.get("paper", {}).get("success")),
        **metrics,
        "steps": lambda cell, name, one: _over_seeds(cell.get("steps", ()), 1.0, ".0f"),
        "minutes of computing": lambda cell, name, one: _over_seeds(cell.get("wall_s", ()), 60.0, ".1f"),
        "robot minutes": lambda cell, name, one: _over_seeds(cell.get("robot_s", ()), 60.0, ".1f"),
        "reached": lambda cell, name, one: _count(cell.get("reached", ())),
        "the paper's minutes": lambda cell, name, one: _number(cell.get("paper", {}).get("minutes")),
    }


def _metric(name: str) -> Callable[[Numbers, str, Numbers], str]:
    return lambda cell, condition, one: _number(one.get("metrics", {}).get(name))


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]


def _within(interval: Sequence[float] | None, factor: float = 1.0) -> str:
    return "" if interval is None else f" [{factor * interval[0]:.4g}, {factor * interval[1]:.4g}]"


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _percent(rate: float | None) -> str:
    return "" if rate is None else f"{100 * rate:.0f} %"


def _spread(value: Sequence[float] | float | None) -> str:
    """A mean, with its standard deviation if known."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, int | float) else f"{value[0]:.4g} ± {value[1]:.3g}"


def _count(reached: Sequence[bool | None]) -> str:
    return "" if None in reached or not reached else f"{sum(map(bool, reached))} of {len(reached)}"


def _over_seeds(values: Sequence[float | None], unit: float, form: str) -> str:
    known = [value for value in values if value is not None]
    return f"{float(interquartile_mean(np.array(known))) / unit:{form}}" if known and len(known) == len(values) else ""
