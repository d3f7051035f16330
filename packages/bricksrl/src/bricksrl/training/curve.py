"""Learning curve as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from bricksrl.plotting import GREY, LIGHT, PALETTE, STRONG, finish, new_figure, number, save, style
from bricksrl.training.callbacks import WINDOW, Episode, Phase


def moving_mean(values: Sequence[float], window: int) -> list[float]:
    """Mean of each value and up to ``window - 1`` before it; same length as ``values``."""
    means = []
    for end in range(1, len(values) + 1):
        recent = values[max(0, end - window) : end]
        means.append(sum(recent) / len(recent))
    return means


def draw_learning_curve(
    path: Path,
    episodes: Sequence[Episode],
    title: str,
    lines: Mapping[str, float] | None = None,
) -> None:
    """Write a PNG with returns, their moving mean, and labelled reference lines."""
    figure = new_figure()
    axes = figure.add_subplot()
    # Random episodes are drawn apart, because learning is compared with them.
    for is_random, colour, label in ((True, GREY, "random start"), (False, LIGHT, "episode")):
        shown = [episode for episode in episodes if (episode.phase is Phase.PREFILL) is is_random]
        # Without points there is nothing for the legend to name.
        if shown:
            axes.plot(
                [episode.episode for episode in shown],
                [episode.return_ for episode in shown],
                "o",
                color=colour,
                markersize=5,
                label=label,
                zorder=2,
            )
    # A single episode has no trend, so no mean is drawn.
    if len(episodes) > 1:
        window = min(WINDOW, len(episodes))
        means = moving_mean([episode.return_ for episode in episodes], window)
        axes.plot(
            [episode.episode for episode in episodes],
            means,
            color=STRONG,
            linewidth=2.2,
            label=f"mean of the last {window}: {number(means[-1])} at the end",
            zorder=3,
        )
    evaluations = {
        episode.episode: episode.evaluation
        for episode in episodes
        if episode.evaluation is not None
    }
    if evaluations:
        axes.plot(
            list(evaluations),
            list(evaluations.values()),
            "D",
            color=PALETTE[1],
            markersize=6,
            label="evaluation",
            zorder=4,
        )
    style(
        axes,
        title,
        "episode",
        "return (sum of rewards)",
    )
    axes.margins(x=0.04)
    finish(axes, lines)
    save(figure, path)
