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
_OUTSIDE = (-0.3, 1.3)
"""Places at which numbers are drawn that are far outside of the range, as shares of it."""
HEAD = ("", "robot", "twin", "drawn twins", "")


def lines(comparison: Comparison) -> Iterator[tuple[str, str, str, str, str]]:
    """For each number: name with unit, the robot, the twin, the range of twins that are drawn, and
    a remark."""
    for quantity in comparison.quantities:
        if quantity.name not in comparison.robot:
            continue
        name = f"{quantity.name}, {quantity.unit}"
        value = comparison.robot[quantity.name]
        if quantity.name not in comparison.twin:
            yield name, plain_number(value), "", "", ""
            continue
        if not quantity.parameter:
            twin = comparison.twin[quantity.name]
            yield name, plain_number(value), plain_number(twin), "", ""
            continue
        # The scale is that of the nominal twin, because the measured one already has the robot's
        # battery.
        low, nominal, high = comparison.scale(quantity)
        remark = ""
        if not low <= value <= high:
            remark = f"outside of what --randomize draws ({quantity.parameter})"
        yield (
            name,
            plain_number(value),
            plain_number(nominal),
            f"{plain_number(low)} to {plain_number(high)}",
            remark,
        )


def write_report(
    path: Path,
    log: SessionLog,
    comparison: Comparison,
) -> None:
    """Write the page. Raises WriteError if that is impossible."""
    facts = [f"{name} {value}" for name, value in log.about.items()]
    about = ", ".join(facts)
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
    rows = [_row("th", HEAD)]
    rows += [_row("td", cells) for cells in lines(comparison)]
    return f"<table class=numbers>{''.join(rows)}</table>"


def _row(tag: str, cells: Iterable[str]) -> str:
    """A row of the table, whose cells have this tag."""
    columns = [f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells]
    return "<tr>" + "".join(columns) + "</tr>"


def _plots(log: SessionLog, comparison: Comparison) -> str:
    """The plots, as SVG."""
    import_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_ranges(left, comparison)
    delays_ms = [row.delay_ms for row in log.rows]
    # Only a logarithmic scale shows the few exchanges that are late.
    right.hist(
        delays_ms,
        bins=60,
        color=_ROBOT,
        log=True,
    )
    right.set(
        title="time of an exchange",
        xlabel="ms",
        ylabel="exchanges",
    )
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    # An SVG within a page has no XML header, so what is before the tag goes.
    _, tag, rest = buffer.getvalue().partition("<svg")
    return tag + rest


def _draw_ranges(axes: Axes, comparison: Comparison) -> None:
    """The robot's numbers on scales from the lowest to the highest of the twins that are drawn."""
    both = comparison.robot.keys() & comparison.twin.keys()
    shown = [
        quantity
        for quantity in comparison.quantities
        if quantity.parameter and quantity.name in both
    ]
    for place, quantity in enumerate(shown):
        low, nominal, high = comparison.scale(quantity)
        # Each number has its own unit and range, so it is drawn as a share: 0 is its lowest twin, 1
        # its highest.
        nominal_share = (nominal - low) / (high - low)
        value = comparison.robot[quantity.name]
        robot_share = (value - low) / (high - low)
        leftmost, rightmost = _OUTSIDE
        robot_share = min(max(robot_share, leftmost), rightmost)
        axes.plot(
            [0, 1],
            [place, place],
            color=_TWIN,
            linewidth=6,
            alpha=0.3,
            solid_capstyle="butt",
        )
        axes.plot(
            [nominal_share],
            [place],
            "|",
            color=_TWIN,
            markersize=14,
        )
        axes.plot(
            [robot_share],
            [place],
            "o",
            color=_ROBOT,
        )
        axes.text(
            0.0,
            place + 0.2,
            plain_number(low, 3),
            fontsize=7,
            va="top",
        )
        axes.text(
            1.0,
            place + 0.2,
            f"{plain_number(high, 3)} {quantity.unit}",
            fontsize=7,
            va="top",
            ha="right",
        )
    axes.set_yticks(range(len(shown)), [quantity.name for quantity in shown])
    # The axis has no numbers, because a share means nothing to a reader; the real ends are written
    # beside it.
    axes.set_xlim(-0.35, 1.35)
    axes.set_xticks([])
    axes.invert_yaxis()
    axes.set_title("robot (dot), twin (line), drawn twins (bar)")
