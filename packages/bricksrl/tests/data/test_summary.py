"""Summaries of datasets: counts, rates and what a reader is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from toy_data import SEEING, TOY, record, steps

from bricksrl.cli.data import Info
from bricksrl.data import About, Recorder, load, summary
from bricksrl.data.summary import plot, summarise
from bricksrl.errors import DataError

EPISODES = (
    (3, About(policy="sac", success=True)),
    (2, About(policy="random", success=False, whole=False)),
    (5, About(policy="sac", success=None)),
    (4, About(policy="sac", success=True)),
)


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    root = tmp_path / "set"
    with Recorder(root, TOY) as recorder:
        for seed, (length, about) in enumerate(EPISODES):
            recorder.write(steps(seed, length), about)
    return root


def test_counts_are_those_of_the_episodes(recorded: Path) -> None:
    summary = summarise(recorded)
    returns = [row.return_ for row in load(recorded).rows]
    assert (summary.episodes, summary.transitions, summary.broken_off) == (4, 14, 1)
    assert summary.length_mean == 3.5
    assert summary.success_rate == pytest.approx(2 / 3), "of those that were judged"
    assert summary.policies == {"sac": 3, "random": 1}
    assert (summary.return_min, summary.return_max) == (min(returns), max(returns))
    assert summary.interventions == 1 + 1 + 2 + 2, "every third step is by hand"
    assert json.loads(summary.to_json())["broken_off"] == 1


def test_reader_is_told_what_there_is(recorded: Path) -> None:
    rows = dict(summarise(recorded).rows())
    assert rows["episodes"] == "4, broken off 1"
    assert rows["policy"] == "sac (3), random (1)"
    assert rows["success"] == "67 %"
    assert rows["steps an episode"] == "3.5"
    assert rows["robot"] == "toy" and rows["steps a second"] == "4"


def test_task_without_success_has_no_rate(tmp_path: Path) -> None:
    with Recorder(tmp_path / "set", TOY) as recorder:
        recorder.write(steps(0, 3), About(policy="random"))
    summary = summarise(tmp_path / "set")
    assert summary.success_rate is None
    assert "success" not in dict(summary.rows())


def test_info_has_a_line_for_each_number_and_for_the_channels(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seeing = record(recorded.parent / "seeing", (2,), SEEING)
    Info((recorded, seeing)).execute()
    lines = capsys.readouterr().out.splitlines()
    returns = np.array([row.return_ for row in load(recorded).rows])
    mean = f"{returns.mean():.4g} ± {returns.std():.4g}"
    limits = f"(from {returns.min():.4g} to {returns.max():.4g})"
    assert lines[:13] == [
        f"{recorded}:",
        "  environment       Toy-v0",
        "  robot             toy",
        "  steps a second    4",
        "  episodes          4, broken off 1",
        "  transitions       14",
        "  steps an episode  3.5",
        f"  return            {mean}  {limits}",
        "  success           67 %",
        "  policy            sac (3), random (1)",
        "  steps by hand     6",
        "  observation       angle, distance",
        "  action            motor",
    ]
    assert lines[13] == f"{seeing}:"
    assert "  observation       angle, distance, images of webcam" in lines
    Info((recorded, seeing), json=True).execute()
    written = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["camera"] for one in written] == [None, "webcam"]
    assert written[0]["age_mean_s"] == pytest.approx(0.02)
    with pytest.raises(DataError, match="no dataset is named"):
        Info(()).execute()


def test_a_plot_has_a_panel_for_each_channel_and_the_returns(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved = []
    monkeypatch.setattr(summary, "save", lambda figure, out, dpi: saved.append((figure, out)))
    plot(recorded, recorded.parent / "toy.png")
    ((figure, out),) = saved
    assert out == recorded.parent / "toy.png"
    assert figure.get_suptitle() == "Toy-v0 · 4 episodes · 14 steps"
    panels = [axes for axes in figure.axes if axes.get_visible()]
    returns = np.array([row.return_ for row in load(recorded).rows])
    assert [axes.get_title(loc="left") for axes in panels] == [
        f"returns: mean {returns.mean():.4g}, deviation {returns.std():.3g}",
        "return of each episode",
        "angle [deg]",
        "distance [mm]",
        "action: motor",
        "reward",
    ]
    assert sum(bar.get_height() for bar in panels[0].patches) == 4
    assert np.array_equal(panels[1].lines[0].get_xydata(), list(enumerate(returns)))
    for axes in panels[2:]:
        counts = axes.collections[0].get_array()
        assert counts.sum() == 14, "each step is in a bin"
        assert counts.size == 40 * 5, "a bin for each step, and 40 for the values"
        assert axes.get_xlim() == (0.0, 5.0), "the longest episode has five steps"


def test_channels_that_never_change_are_plotted(tmp_path: Path) -> None:
    axes = summary.new_figure(1.0, 1.0).subplots()
    summary._plot_density(axes, "still", np.arange(3), np.full(3, 7.0))
    assert axes.get_ylim() == (6.5, 7.5)
    assert axes.collections[0].get_array().sum() == 3
