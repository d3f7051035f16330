"""Plots: colours, style and saving, the same for all pictures. Matplotlib is imported when
something is drawn."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from brickhub.files import write_durably
from bricksrl.errors import DescriptionError
from bricktwin.drawing import import_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1f2430"
"""Colour of text."""
MUTED = "#6b7280"
"""Colour of axes and of reference lines."""
GRID = "#e5e7eb"
LIGHT = "#9fb8dc"
"""Colour of single values and intervals."""
STRONG = "#0b5cad"
"""Colour of means."""
DARK = "#08306b"
"""Colour of frequent values."""
GREY = "#c9ccd3"
"""Colour of values that do not count."""
PALETTE = ("#0b5cad", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#4b5563", "#8c564b")
"""Colours of several agents, distinguishable with most kinds of colour blindness (after Okabe and
Ito)."""
_LABEL_GAP = 0.06


def new_figure(width_in: float = 8.0, height_in: float = 4.5) -> Figure:
    """Figure without a window."""
    import_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


PICTURES = (".png", ".svg", ".pdf")
"""Suffixes of pictures; of the last two a paper can use any size."""


def check_picture(path: Path | str) -> Path:
    """The path, if it names a picture that `save` writes. Raises DescriptionError if it has another
    suffix."""
    path = Path(path)
    if path.suffix.lower() not in PICTURES:
        raise DescriptionError(
            f"'{path}' is not a name of a picture; end it in {', '.join(PICTURES)}"
        )
    return path


def style(
    axes: Axes,
    title: str = "",
    x: str = "",
    y: str = "",
) -> None:
    """Title and labels, a light grid, no frame."""
    axes.set_title(
        title,
        loc="left",
        color=INK,
        fontsize=12,
        fontweight="bold",
    )
    axes.set_xlabel(x, color=INK)
    axes.set_ylabel(y, color=INK)
    axes.grid(
        axis="y",
        color=GRID,
        zorder=0,
    )
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(MUTED)
    axes.tick_params(colors=MUTED, length=0)


def save(
    figure: Figure,
    path: Path,
    dots_per_inch: int = 150,
) -> None:
    """Write a figure to a file of one of `PICTURES`, completely or not at all."""
    data = io.BytesIO()
    figure.savefig(data, format=path.suffix[1:].lower(), dpi=dots_per_inch)
    write_durably(path, data.getvalue())


def save_image(path: Path | str, image: NDArray[np.uint8]) -> None:
    """Write an image, uint8 [height, width, 3], to a PNG file, completely or not at all."""
    import_matplotlib()
    from matplotlib.image import imsave

    png = io.BytesIO()
    imsave(png, image, format="png")
    write_durably(Path(path), png.getvalue())


def number(value: float) -> str:
    """Text of a value in pictures and tables: three digits, thousands with commas, no exponent
    below a billion."""
    if abs(value) >= 1e9:
        return f"{value:.2e}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def finish(
    axes: Axes,
    lines: Mapping[str, float] | None = None,
    *,
    legend: bool = True,
) -> None:
    """Finish a plot: plain numbers, whole episodes, lone points, named reference lines at the right
    edge, the legend below.

    Args:
        lines: values of reference lines by their labels.
        legend: whether to draw a legend; not if the figure gets one for all its axes.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    for line in axes.lines:
        # A line of one point is not drawn, unless it is a mark already.
        is_invisible = np.size(line.get_xdata()) == 1 and line.get_marker() == "None"
        if is_invisible:
            line.set_marker("o")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}"))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: number(y) if y else "0"))
    _reference_lines(axes, lines or {})
    handles, labels = axes.get_legend_handles_labels()
    if handles and legend:
        axes.figure.legend(
            handles,
            labels,
            loc="outside lower left",
            ncols=4,
            frameon=False,
            labelcolor=INK,
            fontsize=9,
        )


def _reference_lines(axes: Axes, lines: Mapping[str, float]) -> None:
    """A dashed line for each value, and its label outside of the axes; labels of close values are
    spread."""
    for value in lines.values():
        axes.axhline(
            value,
            color=MUTED,
            linewidth=1,
            linestyle=(0, (4, 3)),
            zorder=1,
        )
    low, high = axes.get_ylim()
    ordered = sorted(lines.items(), key=lambda item: item[1])
    # From the lowest up, each as high as its line, or as its predecessor's text allows.
    position = -math.inf
    for label, value in ordered:
        position = max((value - low) / (high - low), position + _LABEL_GAP)
        axes.annotate(
            f"{label} {number(value)}",
            (1.0, position),
            xycoords="axes fraction",
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            color=MUTED,
            fontsize=9,
            annotation_clip=False,
        )
