"""Report of a measuring session: a page with each number of a robot beside its twin's, and
plots."""

from __future__ import annotations

import html
import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.files import write_durably
from bricktwin.drawing import import_matplotlib
from bricktwin.measure.results import Comparison
from bricktwin.measure.session import SessionLog
from bricktwin.report_page import plain_number, report_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROBOT = "#d55e00"
_TWIN = "#0b5cad"
_OUTSIDE = -0.3, 1.3
"""Where numbers are drawn that are far outside of the range."""
HEAD = ("", "robot", "twin", "drawn twins", "")


def lines(comparison: Comparison) -> Iterator[tuple[str, str, str, str, str]]:
    """For each number: name with unit, the robot, the twin, the range of twins that are drawn, and
    a remark."""
    for one in comparison.quantities:
        if one.name not in comparison.robot:
            continue
        name = f"{one.name}, {one.unit}"
        value = comparison.robot[one.name]
        if one.name not in comparison.twin:
            yield name, plain_number(value), "", "", ""
        elif not one.parameter:
            yield name, plain_number(value), plain_number(comparison.twin[one.name]), "", ""
        else:
            low, nominal, high = comparison.scale(one)
            remark = (
                ""
                if low <= value <= high
                else f"outside of what --randomize draws ({one.parameter})"
            )
            yield (
                name,
                plain_number(value),
                plain_number(nominal),
                f"{plain_number(low)} to {plain_number(high)}",
                remark,
            )


def write_report(path: Path, log: SessionLog, comparison: Comparison) -> None:
    """Write the page. Raises WriteError if that is impossible."""
    about = ", ".join(f"{name} {value}" for name, value in log.about.items())
    body = [
        f"<h1>{html.escape(log.robot)}, measured</h1>",
        f"<p class=who>{html.escape(about)}</p>",
        "<h2>Its numbers beside its twin's</h2>",
        _table(comparison),
        "<h2>Where they lie</h2>",
        _plots(log, comparison),
    ]
    page = report_page(f"{log.robot}, measured", "\n".join(body))
    write_durably(path, page.encode())


def _table(comparison: Comparison) -> str:
    """The numbers, as HTML."""
    rows = [_row("th", HEAD), *(_row("td", cells) for cells in lines(comparison))]
    return f"<table class=numbers>{''.join(rows)}</table>"


def _row(tag: str, cells: Iterable[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _plots(log: SessionLog, comparison: Comparison) -> str:
    """The plots, as SVG."""
    import_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_ranges(left, comparison)
    right.hist([row.delay_ms for row in log.rows], bins=60, color=_ROBOT, log=True)
    right.set(title="time of an exchange", xlabel="ms", ylabel="exchanges")
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    return "".join(buffer.getvalue().partition("<svg")[1:])


def _draw_ranges(axes: Axes, comparison: Comparison) -> None:
    """The robot's numbers on scales from the lowest to the highest of the twins that are drawn."""
    shown = [
        one
        for one in comparison.quantities
        if one.parameter and {one.name} <= comparison.robot.keys() & comparison.twin.keys()
    ]
    for place, one in enumerate(shown):
        low, nominal, high = comparison.scale(one)
        axes.plot(
            [0, 1], [place, place], color=_TWIN, linewidth=6, alpha=0.3, solid_capstyle="butt"
        )
        axes.plot([(nominal - low) / (high - low)], [place], "|", color=_TWIN, markersize=14)
        share = (comparison.robot[one.name] - low) / (high - low)
        axes.plot([min(max(share, _OUTSIDE[0]), _OUTSIDE[1])], [place], "o", color=_ROBOT)
        axes.text(0.0, place + 0.2, plain_number(low, 3), fontsize=7, va="top")
        axes.text(
            1.0,
            place + 0.2,
            f"{plain_number(high, 3)} {one.unit}",
            fontsize=7,
            va="top",
            ha="right",
        )
    axes.set_yticks(range(len(shown)), [one.name for one in shown])
    axes.set_xlim(-0.35, 1.35)
    axes.set_xticks([])
    axes.invert_yaxis()
    axes.set_title("robot (dot), twin (line), drawn twins (bar)")
