"""The learning curve: one picture that says how the run went."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from bricksrl.data.files import write_durably
from bricksrl.training.observer import Episode, Phase

WINDOW = 5
"""Episodes in the moving mean."""

_INK, _MUTED, _GRID = "#1f2430", "#6b7280", "#e5e7eb"
_POINT, _MEAN, _PREFILL = "#9fb8dc", "#0b5cad", "#c9ccd3"


def moving_mean(values: Sequence[float], window: int) -> list[float]:
    """Mean of each value and up to ``window - 1`` before it; as long as ``values``."""
    return [sum(part) / len(part) for part in (values[max(0, i + 1 - window) : i + 1] for i in range(len(values)))]


def draw_learning_curve(path: Path, episodes: Sequence[Episode], title: str) -> None:
    """Draw the return of each episode and their moving mean into a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for phase, colour, label in ((Phase.PREFILL, _PREFILL, "random start"), (Phase.TRAIN, _POINT, "episode")):
        points = [(episode.episode, episode.return_) for episode in episodes if episode.phase is phase]
        if points:
            axes.plot(*zip(*points, strict=True), "o", color=colour, markersize=5, label=label, zorder=2)
    if episodes:
        means = moving_mean([episode.return_ for episode in episodes], WINDOW)
        axes.plot(
            [episode.episode for episode in episodes],
            means,
            color=_MEAN,
            linewidth=2.2,
            label=f"mean of the last {WINDOW}",
            zorder=3,
        )
        axes.annotate(
            f"{means[-1]:.3g}",
            (episodes[-1].episode, means[-1]),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            color=_MEAN,
            fontweight="bold",
        )
        axes.legend(frameon=False, labelcolor=_INK, loc="best")
    axes.set_title(title, loc="left", color=_INK, fontsize=12, fontweight="bold")
    axes.set_xlabel("episode", color=_INK)
    axes.set_ylabel("return (sum of rewards)", color=_INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.margins(x=0.04)
    axes.grid(axis="y", color=_GRID, zorder=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(_MUTED)
    axes.tick_params(colors=_MUTED, length=0)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=150)
    write_durably(path, png.getvalue())
