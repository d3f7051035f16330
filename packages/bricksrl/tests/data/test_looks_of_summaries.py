"""Cards and plots of a dataset."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_data import TOY, record

from brickhub.entry import Entry
from bricksrl.data import share, summary
from bricksrl.data.summary import Summary, plot
from bricksrl.plotting import INK, MUTED

SUMMARY = Summary(
    env="Toy-v0",
    robot=None,
    episodes=3,
    transitions=12,
    return_mean=1.23456,
    return_std=0.5,
    return_min=-2.0,
    return_max=1000.04,
    length_mean=4.0,
    success_rate=0.5,
    broken_off=1,
    interventions=6,
    age_mean_s=0.02,
    policies={"sac": 2, "random": 1},
    rate_hz=2.5,
    observation=("angle", "distance"),
    action=("motor",),
    camera="webcam",
)


def test_card_of_a_dataset_says_what_is_in_it() -> None:
    card = share._card(
        title="Toy-v0 on no robot",
        about="Recorded.",
        rows=SUMMARY.rows(),
        tags=("LeRobot", "BricksRL"),
        files="data/*/*.parquet",
        licence="mit",
    )
    assert card == (
        "---\nlicense: mit\ntask_categories:\n- robotics\ntags:\n- LeRobot\n- BricksRL\n"
        "configs:\n- config_name: default\n  data_files: data/*/*.parquet\n---\n\n"
        "# Toy-v0 on no robot\n\nRecorded.\n\n| | |\n|---|---|\n"
        "| environment | Toy-v0 |\n| robot | no robot |\n| steps a second | 2.5 |\n"
        "| episodes | 3, broken off 1 |\n| transitions | 12 |\n| steps an episode | 4.0 |\n"
        "| return | 1.235 \u00b1 0.5  (from -2 to 1000) |\n| success | 50 % |\n"
        "| policy | sac (2), random (1) |\n| steps by hand | 6 |\n"
    )
    columns = share._about_columns(SUMMARY)
    assert columns.startswith(
        "\n- `observation.state`: angle, distance\n- `action`, in -1..1: motor\n"
    )
    camera = "\nImages of the camera `webcam` are in `videos`, without loss.\n"
    assert camera in columns
    without = share._about_columns(replace(SUMMARY, camera=None))
    assert columns.replace(camera, "") == without


@pytest.mark.parametrize(
    ("episodes", "bars"), [(1, 5), (15, 5), (18, 6), (90, 30), (93, 30), (200, 30)]
)
def test_returns_are_in_some_bars_of_three_episodes(episodes: int, bars: int) -> None:
    left, right = summary.new_figure(4.0, 2.0).subplots(1, 2)
    returns = np.linspace(-5.0, 7.0, episodes)
    summary._plot_returns(left, right, returns)
    assert len(left.patches) == bars
    (mean,) = left.lines
    assert mean.get_xdata() == pytest.approx([returns.mean()] * 2)
    assert (left.get_ylabel(), right.get_xlabel()) == ("episodes", "episode")


@pytest.mark.parametrize(("steps", "bins"), [(7, 7), (100, 100), (250, 100)])
def test_densities_have_a_hundred_bins_of_steps_at_most(steps: int, bins: int) -> None:
    axes = summary.new_figure(4.0, 2.0).subplots()
    summary._plot_density(axes, "angle", np.arange(steps), np.linspace(-3.0, 9.0, steps))
    counts = axes.collections[0].get_array()
    assert counts.size == bins * 40 and counts.sum() == steps
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, float(steps)), (-3.0, 9.0))
    assert axes.get_xlabel() == "step"
    # What never occurs has no colour.
    assert np.ma.getmaskarray(counts).any() and counts.min() >= 1


@pytest.mark.parametrize(("observed", "rows", "empty"), [(2, 2, 2), (4, 2, 0), (5, 3, 3)])
def test_plots_are_in_rows_of_four(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, observed: int, rows: int, empty: int
) -> None:
    entries = tuple(Entry(f"entry_{number}", 0.0, 1.0) for number in range(observed))
    root = record(tmp_path / "set", (2, 1), replace(TOY, observation=entries))
    figures: list[Any] = []
    monkeypatch.setattr(summary, "save", lambda figure, _out, dpi: figures.append((figure, dpi)))
    plot(root, tmp_path / "toy.png")
    ((figure, dpi),) = figures
    assert figure.get_size_inches().tolist() == pytest.approx([16.0, 2.6 * rows])
    assert dpi == 100 and len(figure.axes) == 4 * rows
    visible = [axes.get_visible() for axes in figure.axes]
    assert visible == [True] * (4 * rows - empty) + [False] * empty
    title = figure._suptitle
    assert (title.get_position()[0], title.get_ha()) == (0.01, "left")
    assert (title.get_fontsize(), title.get_fontweight(), title.get_color()) == (13, "bold", INK)
    for axes in figure.axes[: 4 * rows - empty]:
        (name,) = [one for one in (axes._left_title, axes.title) if one.get_text()]
        assert (name.get_fontsize(), name.get_color()) == (10, INK)
        (label, *_) = axes.get_xticklabels()
        assert (label.get_fontsize(), label.get_color()) == (8, MUTED)
    for label in (figure.axes[0].yaxis.label, *(one.xaxis.label for one in figure.axes[1:3])):
        assert (label.get_fontsize(), label.get_color()) == (8, MUTED)
    assert figure.axes[2].get_title(loc="left") == "entry_0", "without a unit"
    for axes in figure.axes:
        assert not axes.spines["top"].get_visible() and not axes.spines["right"].get_visible()
