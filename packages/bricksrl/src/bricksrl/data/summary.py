"""Summary of a dataset: numbers, as in the paper's table of datasets, and plots."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bricksrl.data.dataset import read_dataset, refuse_within_dataset
from bricksrl.data.reader import read_columns
from bricksrl.data.schema import ACTION, OBSERVATION
from bricksrl.errors import counted, percent
from bricksrl.plotting import DARK, INK, LIGHT, MUTED, STRONG, check_picture, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMNS = 4


@dataclass(frozen=True)
class Summary:
    """Summary of a dataset.

    Attributes:
        return_mean, return_std: mean and deviation of the episodes' returns; the paper calls the
            first one mean reward.
        success_rate: rate of success by the task; ``None`` if it defines none.
        broken_off: number of interrupted episodes.
        interventions: number of steps with a human's action.
        age_mean_s: mean age of an observation when the action was sent.
        policies: number of episodes by policy.
    """

    env: str
    robot: str | None
    episodes: int
    transitions: int
    return_mean: float
    return_std: float
    return_min: float
    return_max: float
    length_mean: float
    success_rate: float | None
    broken_off: int
    interventions: int
    age_mean_s: float
    policies: dict[str, int]
    rate_hz: float
    observation: tuple[str, ...]
    action: tuple[str, ...]
    camera: str | None

    def rows(self) -> Iterator[tuple[str, object]]:
        """Labels and values of its numbers, for readers."""
        yield "environment", self.env
        yield "robot", self.robot or "no robot"
        yield "steps a second", f"{self.rate_hz:g}"
        yield "episodes", f"{self.episodes}, broken off {self.broken_off}"
        yield "transitions", self.transitions
        yield "steps an episode", f"{self.length_mean:.1f}"
        mean = f"{self.return_mean:.4g} ± {self.return_std:.4g}"
        yield "return", f"{mean}  (from {self.return_min:.4g} to {self.return_max:.4g})"
        if self.success_rate is not None:
            yield "success", percent(self.success_rate)
        policies = [f"{name} ({count})" for name, count in self.policies.items()]
        yield "policy", ", ".join(policies)
        yield "steps by hand", self.interventions

    def to_json(self) -> str:
        """One JSON object on one line."""
        return json.dumps(dataclasses.asdict(self))


def summarise(path: Path | str) -> Summary:
    """Summarise a dataset. Raises DataError if there is no dataset, or it is damaged."""
    dataset = read_dataset(path)
    ages = read_columns(dataset, ["age_s"])["age_s"]
    returns = np.array([row.return_ for row in dataset.rows])
    successes = [row.about.success for row in dataset.rows if row.about.success is not None]
    names = [row.about.policy for row in dataset.rows]
    return Summary(
        env=dataset.description.env,
        robot=dataset.description.robot.get("name"),
        episodes=len(returns),
        transitions=dataset.steps,
        return_mean=float(returns.mean()),
        return_std=float(returns.std()),
        return_min=float(returns.min()),
        return_max=float(returns.max()),
        length_mean=dataset.steps / len(returns),
        success_rate=sum(successes) / len(successes) if successes else None,
        broken_off=sum(not row.about.whole for row in dataset.rows),
        interventions=sum(row.interventions for row in dataset.rows),
        age_mean_s=float(ages.mean()),
        policies={name: names.count(name) for name in dict.fromkeys(names)},
        rate_hz=dataset.description.rate_hz,
        observation=tuple(channel.name for channel in dataset.description.observation),
        action=tuple(channel.name for channel in dataset.description.action),
        camera=dataset.description.camera,
    )


def plot(path: Path | str, out: Path | str) -> None:
    """Plot the returns, and every channel and action over the steps of an episode, into an image
    file. Raises DataError if there is no dataset, or it is damaged."""
    out = check_picture(out)
    refuse_within_dataset(out)
    dataset = read_dataset(path)
    description = dataset.description
    columns = read_columns(dataset, [OBSERVATION, ACTION, "next.reward", "frame_index"])
    panels = []
    for channel, values in zip(description.observation, columns[OBSERVATION].T, strict=True):
        unit = f" [{channel.unit}]" if channel.unit else ""
        panels.append((f"{channel.name}{unit}", values))
    for channel, values in zip(description.action, columns[ACTION].T, strict=True):
        panels.append((f"action: {channel.name}", values))
    panels.append(("reward", columns["next.reward"]))
    # The number of panels includes two for the returns.
    rows = math.ceil((len(panels) + 2) / _COLUMNS)
    figure = new_figure(4.0 * _COLUMNS, 2.6 * rows)
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).flatten()
    _plot_returns(axes[0], axes[1], np.array([row.return_ for row in dataset.rows]))
    for panel, (title, values) in zip(axes[2:], panels, strict=False):
        _plot_density(
            panel,
            title,
            columns["frame_index"],
            values,
        )
    for panel in axes:
        panel.tick_params(
            colors=MUTED,
            length=2,
            labelsize=8,
        )
        panel.spines[["top", "right"]].set_visible(False)
    for unused in axes[2 + len(panels) :]:
        unused.set_visible(False)
    size = f"{counted(len(dataset.rows), 'episode')} · {counted(dataset.steps, 'step')}"
    title = f"{description.env} · {size}"
    figure.suptitle(
        title,
        x=0.01,
        ha="left",
        color=INK,
        fontsize=13,
        fontweight="bold",
    )
    save(figure, out, 100)


def _plot_returns(
    left: Axes,
    right: Axes,
    returns: NDArray[np.float64],
) -> None:
    from matplotlib.ticker import MaxNLocator

    # Some three episodes for each bar keep a few episodes from looking like a comb.
    bins = min(30, max(5, len(returns) // 3))
    left.hist(returns, bins=bins, color=LIGHT)
    left.axvline(float(returns.mean()), color=STRONG, linewidth=2)
    left.set_title(
        f"returns: mean {returns.mean():.4g}, deviation {returns.std():.3g}",
        fontsize=10,
        color=INK,
        loc="left",
    )
    left.set_ylabel("episodes", fontsize=8, color=MUTED)
    right.plot(
        np.arange(len(returns)),
        returns,
        ".",
        color=STRONG,
        markersize=4,
    )
    right.set_title(
        "return of each episode",
        fontsize=10,
        color=INK,
        loc="left",
    )
    right.set_xlabel("episode", fontsize=8, color=MUTED)
    for axis in (left.yaxis, right.xaxis):
        axis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def _plot_density(
    axes: Axes,
    title: str,
    step: NDArray[Any],
    values: NDArray[Any],
) -> None:
    """Plot a 2D histogram of the values over the steps of an episode: dark is frequent."""
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    colours = LinearSegmentedColormap.from_list("often", [LIGHT, DARK])
    steps = int(step.max()) + 1
    low = float(values.min())
    high = float(values.max())
    # A histogram needs a width, even where all values are equal.
    if low == high:
        low = low - 0.5
        high = high + 0.5
    axes.hist2d(
        step,
        values,
        bins=(min(steps, 100), 40),
        range=((0, steps), (low, high)),
        cmap=colours,
        cmin=1,
    )
    axes.set_title(
        title,
        fontsize=10,
        color=INK,
        loc="left",
    )
    axes.set_xlabel("step", fontsize=8, color=MUTED)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
