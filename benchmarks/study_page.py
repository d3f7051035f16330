"""Page of a study: its tables in Markdown, next to the paper's numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.formatting import markdown_table, number
from bricksrl.errors import percent
from bricksrl.evaluation.statistics import interquartile_mean

Numbers = dict[str, Any]
Column = Callable[[Numbers], str]
"""Text of a cell of the study in a column of its table."""
WIDE = 2
"""Most conditions that are shown side by side, a cell of the study in a row; more of them are the
rows of tables of their own."""
_UNITS = {"_m_s": ", m/s", "_mm": ", mm", "_deg": ", degrees"}


def page(result: Numbers) -> str:
    """Tables in Markdown, without empty columns: a row for each cell; if it has many conditions, a
    table for each measure."""
    quick = (
        " (quick form: it checks that everything works and says nothing about learning)"
        if result["quick"]
        else ""
    )
    command = f"python -m benchmarks {result['study']}{' --quick' if result['quick'] else ''}"
    lines = [f"# {result['title']}{quick}", ""]
    lines += [
        f"Command: `{command}`. Numbers are interquartile means over seeds. Square brackets are"
    ]
    lines += [
        (
            "95 % intervals; fewer than 5 seeds have none. All robots here are virtual; the paper "
            "used real LEGO robots."
        ),
        "",
    ]
    cells = _joined(result["cells"])
    conditions = list(dict.fromkeys(name for cell in cells for name in cell["conditions"]))
    measures = _measures(result)
    is_wide = len(conditions) <= WIDE
    columns = (
        _labels(result)
        | (_side_by_side(measures, conditions) if is_wide else {})
        | _about_training()
    )
    shown = {
        head: texts
        for head, text in columns.items()
        if any(texts := [text(cell) for cell in cells])
    }
    lines += markdown_table(list(shown), zip(*shown.values(), strict=True))
    if not is_wide:
        for name, text in measures.items():
            lines += _by_condition(name, text, cells, conditions)
    if result.get("improvements"):
        pairs = [
            (
                pair["column"],
                pair["row"],
                pair["over"],
                f"{pair['probability']:.2f}{_within(pair['probability_95'])}",
            )
            for pair in result["improvements"]
        ]
        head = (*reversed(result["heads"]), "over", "probability of improvement")
        lines += ["", *markdown_table(head, pairs)]
    for note in result.get("notes", ()):
        lines += ["", note]
    machine, versions = result["machine"], result["versions"]
    lines += [
        "",
        f"{machine['processor']}, {machine['cores']} cores; "
        + ", ".join(f"{k} {v}" for k, v in versions.items()),
    ]
    return "\n".join(lines) + "\n"


def _joined(cells: Iterable[Numbers]) -> list[Numbers]:
    """Cells of the same row and column as one, with the conditions of all."""
    joined: dict[tuple[str, str], Numbers] = {}
    for cell in cells:
        earlier = joined.setdefault((cell["row"], cell["column"]), cell)
        if earlier is not cell:
            joined[cell["row"], cell["column"]] = {
                **cell,
                "conditions": {**earlier["conditions"], **cell["conditions"]},
            }
    return list(joined.values())


def _labels(result: Numbers) -> dict[str, Column]:
    row, column = result["heads"]
    return {
        row: lambda cell: cell["row"],
        column: lambda cell: cell["column"],
        "settings": lambda cell: cell.get("settings", ""),
        "seeds": lambda cell: str(cell["seeds"]),
    }


def _measures(result: Numbers) -> dict[str, Column]:
    """Measures by heading, each a function of the results under one condition."""
    return {
        "return": lambda values: f"{number(values['return_iqm'])}{_within(values['return_95'])}",
        "success": lambda values: (
            percent(values.get("success_rate")) + _within_percent(values.get("success_95"))
        ),
        **{_readable(name): _metric(name) for name in result.get("metrics", ())},
    }


def _readable(metric: str) -> str:
    """Heading of a metric, with its unit behind a comma."""
    for ending, unit in _UNITS.items():
        if metric.endswith(ending):
            metric = metric.removesuffix(ending) + unit
            break
    return metric.replace("_", " ")


def _metric(name: str) -> Column:
    return lambda values: number(values.get("metrics", {}).get(name))


def _side_by_side(measures: Mapping[str, Column], conditions: Sequence[str]) -> dict[str, Column]:
    """Columns for return and success under each condition, beside the paper's, and for other
    metrics under the last one."""
    columns: dict[str, Column] = {}
    for name, text in measures.items():
        with_paper = name in ("return", "success")
        for condition in conditions if with_paper else conditions[-1:]:
            head = name if len(conditions) == 1 or not with_paper else f"{name}, {condition}"
            columns[head] = _under(condition, text)
        if with_paper:
            columns[f"the paper's {name}"] = _paper(name)
    return columns


def _under(condition: str, text: Column) -> Column:
    return lambda cell: (
        text(cell["conditions"][condition]) if condition in cell["conditions"] else ""
    )


def _paper(name: str) -> Column:
    show = percent if name == "success" else _spread
    return lambda cell: show(cell.get("paper", {}).get(name))


def _about_training() -> dict[str, Column]:
    return {
        "steps": lambda cell: _over_seeds(cell.get("steps", ()), 1.0, ".0f"),
        "CPU minutes": lambda cell: _minutes(cell, "cpu_s"),
        "wall minutes": lambda cell: "" if _minutes(cell, "cpu_s") else _minutes(cell, "wall_s"),
        "robot minutes": lambda cell: _minutes(cell, "robot_s"),
        "reached": lambda cell: _count(cell.get("reached", ())),
        "the paper's minutes": lambda cell: number(cell.get("paper", {}).get("minutes")),
    }


def _by_condition(
    name: str, text: Column, cells: Sequence[Numbers], conditions: Sequence[str]
) -> list[str]:
    """Table of one measure: a row for each condition, a column for each cell that has it. Of
    success only the conditions under which some failed."""
    title = f"{name[0].upper()}{name[1:]}:"
    if name == "success":
        results = [
            (condition, values)
            for cell in cells
            for condition, values in cell["conditions"].items()
        ]
        failing = {
            condition for condition, values in results if values.get("success_rate", 1.0) < 1.0
        }
        if not failing and any("success_rate" in values for _, values in results):
            return ["", "Success: 100 % under all conditions."]
        title = "Success, which is 100 % under all other conditions:"
        conditions = [condition for condition in conditions if condition in failing]
    several_rows = len({cell["row"] for cell in cells}) > 1
    columns = {}
    for cell in cells:
        texts = [_under(condition, text)(cell) for condition in conditions]
        if any(texts):
            columns[f"{cell['row']}, {cell['column']}" if several_rows else cell["column"]] = texts
    rows = [row for row in zip(conditions, *columns.values(), strict=True) if any(row[1:])]
    return ["", title, "", *markdown_table(("condition", *columns), rows)] if rows else []


def _within(interval: Sequence[float] | None) -> str:
    return "" if interval is None else f" [{number(interval[0])}, {number(interval[1])}]"


def _within_percent(interval: Sequence[float] | None) -> str:
    return "" if interval is None else f" [{100 * interval[0]:.0f}, {100 * interval[1]:.0f}]"


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
    return (
        f"{float(interquartile_mean(np.array(known))) / unit:{form}}"
        if known and len(known) == len(values)
        else ""
    )
