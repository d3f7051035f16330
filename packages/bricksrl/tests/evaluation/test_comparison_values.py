"""Values of a comparison, what its commands print, and what its pictures show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.colors import to_hex
from test_comparison import write_run

from bricksrl.cli.evaluate import print_comparison
from bricksrl.errors import RunError
from bricksrl.evaluation import comparison
from bricksrl.evaluation.comparison import Comparison, Group, Improvement, compare, draw
from bricksrl.evaluation.statistics import Interval
from bricksrl.plotting import PALETTE, new_figure
from bricksrl.training import TrainConfig

WALKER = "Walker-v0"


def group(
    env: str,
    agent: str,
    scores: tuple[float, ...],
    **changes: Any,
) -> Group:
    """A group whose runs have two episodes each, the second with their score."""
    made = Group(
        env=env,
        agent=agent,
        seeds=tuple(range(len(scores))),
        scores=scores,
        curves=tuple((0.0, score) for score in scores),
        steps=20,
        lines={},
    )
    return replace(made, **changes)


def test_every_pair_of_an_environment_is_compared_the_better_one_first(tmp_path: Path) -> None:
    """Of 25 pairs of runs 15 are won by TD3 and 4 are even: (15 + 2) / 25."""
    scores = {"sac": range(5), "td3": range(1, 6)}
    paths = []
    for agent, returns in scores.items():
        for seed, score in enumerate(returns):
            config = TrainConfig(WALKER, agent, seed=seed)
            paths.append(write_run(tmp_path / f"{agent}{seed}", config, [float(score)]))
    for seed in range(5):
        config = TrainConfig("RoboArm-v0", "sac", seed=seed)
        paths.append(write_run(tmp_path / f"arm{seed}", config, [-1.0]))
    (one,) = compare(paths).improvements
    assert (one.env, one.agent, one.other) == (WALKER, "td3", "sac")
    assert one.probability == pytest.approx(0.68)
    assert 0.0 < one.interval.low < 0.68 < one.interval.high < 1.0

    four = [path for path in paths if path.name != "td34"]
    assert compare(four).improvements == (), "an interval of four runs says too little"


def test_comparison_as_json_has_scores_and_intervals() -> None:
    five = group(WALKER, "sac", (3.0,) * 5)
    one = group(WALKER, "td3", (4.0,))
    pair = Improvement(WALKER, "td3", "sac", 0.75, Interval(0.5, 1.0))
    data = json.loads(Comparison((five, one), (pair,), "evaluation").to_json())
    assert data == {
        "scored_by": "evaluation",
        "groups": [
            {
                "env": WALKER,
                "agent": "sac",
                "seeds": [0, 1, 2, 3, 4],
                "scores": [3.0] * 5,
                "curves": [[0.0, 3.0]] * 5,
                "steps": 20,
                "lines": {},
                "is_evaluated": False,
                "score": 3.0,
                "interval": [3.0, 3.0],
            },
            {
                "env": WALKER,
                "agent": "td3",
                "seeds": [0],
                "scores": [4.0],
                "curves": [[0.0, 4.0]],
                "steps": 20,
                "lines": {},
                "is_evaluated": False,
                "score": 4.0,
                "interval": None,
            },
        ],
        "improvements": [
            {
                "env": WALKER,
                "agent": "td3",
                "other": "sac",
                "probability": 0.75,
                "interval": [0.5, 1.0],
            }
        ],
    }


def test_curves_are_means_of_five_episodes_and_runs_score_by_the_last(tmp_path: Path) -> None:
    returns = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 1.0]
    run = write_run(tmp_path / "run", TrainConfig(WALKER), returns)
    (found,) = compare(run).groups
    assert found.curves == (pytest.approx((10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 36.2)),)
    assert found.scores == (pytest.approx(36.2),)
    assert found.lines.keys() == {"random", "by hand", "paper's SAC"}


@pytest.mark.parametrize(
    "changes",
    [
        {"episodes": 7},
        {"device": "cuda"},
        {"log": "tensorboard"},
        {"record": False},
        {"name": "Anna"},
    ],
)
def test_what_changes_no_result_does_not_part_a_group(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    first = write_run(tmp_path / "a", TrainConfig(WALKER, seed=0), [1.0])
    second = write_run(tmp_path / "b", TrainConfig(WALKER, seed=1, **changes), [2.0])
    (found,) = compare([first, second]).groups
    assert found.seeds == (0, 1)


def test_only_settings_that_differ_are_in_the_names_of_groups(tmp_path: Path) -> None:
    sac = TrainConfig(WALKER)
    slower = replace(sac, settings=replace(sac.settings, gamma=0.5, tau=0.25))
    td3 = TrainConfig(WALKER, "td3")
    arm = TrainConfig("RoboArm-v0")
    configs = {"sac": sac, "slower": slower, "td3": td3, "arm": arm}
    paths = [write_run(tmp_path / name, config, [1.0]) for name, config in configs.items()]
    agents = {(found.env, found.agent) for found in compare(paths).groups}
    usual = f"gamma={sac.settings.gamma}, tau={sac.settings.tau}"
    assert agents == {
        (WALKER, f"sac, {usual}"),
        (WALKER, "sac, gamma=0.5, tau=0.25"),
        (WALKER, "td3"),
        ("RoboArm-v0", "sac"),
    }


def test_run_that_contains_copies_is_itself(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", TrainConfig(WALKER, seed=5), [1.0])
    write_run(run / "seed-1", TrainConfig(WALKER, seed=1), [2.0])
    (found,) = compare([run]).groups
    assert found.seeds == (5,)


def test_runs_without_episodes_and_no_runs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="^no run is named; give the folders of runs$"):
        compare([])
    empty = write_run(tmp_path / "empty", TrainConfig(WALKER), [])
    with pytest.raises(RunError) as raised:
        compare([empty])
    assert str(raised.value) == f"the run in {empty} has no episode yet; omit it"


def printed(found: Comparison, capsys: pytest.CaptureFixture[str]) -> list[str]:
    print_comparison(found)
    return [line.rstrip() for line in capsys.readouterr().out.splitlines()]


def test_printed_comparison_is_a_table_and_what_it_means(
    capsys: pytest.CaptureFixture[str],
) -> None:
    five = group(WALKER, "sac", (1234.0,) * 5, steps=12_345)
    one = group(WALKER, "td3", (0.5,), curves=((0.0,), (0.0, 1.0, 2.0), (0.0, 1.0)))
    pair = Improvement(WALKER, "sac", "td3", 0.754, Interval(0.5, 0.98))
    lines = printed(Comparison((five, one), (pair,), "evaluation"), capsys)
    rows = [line.split("  ") for line in lines[:3]]
    cells = [[cell.strip() for cell in row if cell.strip()] for row in rows]
    assert cells == [
        ["environment", "agent", "seeds", "episodes", "robot steps", "score", "95 % interval"],
        [WALKER, "sac", "5", "2", "12,345", "1,234", "1,234 to 1,234"],
        [WALKER, "td3", "1", "3", "20", "0.5", "needs 5 seeds"],
    ]
    assert lines[3:] == [
        "",
        "score: return, interquartile mean over the seeds; of each run its evaluation",
        "Walker-v0: sac beats td3 with probability 75 % (95 % interval: 50 % to 98 %)",
    ]


@pytest.mark.parametrize(
    ("found", "is_asked"),
    [
        ([group(WALKER, "sac", (1.0,)), group(WALKER, "td3", (1.0,))], True),
        ([group(WALKER, "sac", (1.0,)), group("RoboArm-v0", "sac", (1.0,))], False),
        ([group(WALKER, "sac", (1.0,))], False),
    ],
)
def test_more_seeds_are_asked_for_where_two_agents_meet(
    capsys: pytest.CaptureFixture[str], found: list[Group], is_asked: bool
) -> None:
    lines = printed(Comparison(tuple(found), (), "evaluation"), capsys)
    advice = (
        "whether one beats the other is chance with so few: train 5 seeds of each (`--seeds 5`)"
    )
    assert (advice in lines) is is_asked


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures that are drawn, and not written."""
    drawn: list[Any] = []
    monkeypatch.setattr(comparison, "save", lambda figure, path: drawn.append(figure))
    return drawn


@pytest.mark.parametrize(
    ("count", "shape", "hidden"), [(1, (1, 1), 0), (2, (1, 2), 0), (3, (2, 2), 1), (4, (2, 2), 0)]
)
def test_each_environment_has_a_panel_two_in_a_row(
    figures: list[Any], count: int, shape: tuple[int, int], hidden: int
) -> None:
    envs = [f"Env-v{number}" for number in range(count)]
    draw("a.png", [group(env, "sac", (1.0,)) for env in envs])
    panels = figures[0].axes
    rows, columns = shape
    assert len(panels) == rows * columns
    assert [panel.get_title("left") for panel in panels if panel.get_visible()] == envs
    assert [panel.get_visible() for panel in panels].count(False) == hidden
    grid = panels[0].get_gridspec()
    assert (grid.nrows, grid.ncols) == shape
    # Each panel is 7 by 3.8 inches, and the rest is for the legend.
    assert tuple(figures[0].get_size_inches()) == pytest.approx((7 * columns + 1, 3.8 * rows + 0.5))


def test_agents_keep_their_colours_and_are_named_once(figures: list[Any]) -> None:
    groups = [
        group(WALKER, "sac", (1.0,)),
        group(WALKER, "td3", (1.0, 2.0)),
        group("RoboArm-v0", "td3", (1.0, 2.0, 3.0), lines={"random": -9.0}),
    ]
    draw("a.png", groups)
    walker, arm = figures[0].axes
    (legend,) = figures[0].legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "sac (1 seed)",
        "td3 (2 or 3 seeds)",
    ]
    assert not walker.get_legend() and not arm.get_legend()
    wide = [line for line in walker.lines if line.get_linewidth() > 2]
    assert [to_hex(line.get_color()) for line in wide] == [PALETTE[0], PALETTE[1]]
    wide = [line for line in arm.lines if line.get_linewidth() > 2]
    assert [to_hex(line.get_color()) for line in wide] == [PALETTE[1]]
    assert walker.get_xlabel() == "episode"
    assert walker.get_ylabel() == "return (mean of 5 episodes)"
    assert [text.get_text() for text in arm.texts] == ["random -9"]
    assert not list(walker.texts)


def test_curve_is_the_interquartile_mean_up_to_the_end_of_the_shortest_run() -> None:
    """Of five values the lowest and the highest are left out."""
    axes = new_figure().subplots()
    curves = (
        (0.0, -100.0, 7.0),
        (1.0, 1.0, 7.0),
        (2.0, 2.0, 7.0),
        (3.0, 3.0),
        (400.0, 4.0, 7.0),
    )
    found = group(WALKER, "sac", (1.0,) * 5, curves=curves, is_evaluated=True)
    comparison._draw_group(axes, found, "red", "sac (5 seeds)")
    mean, mark = axes.lines
    assert list(mean.get_xdata()) == [1, 2]
    assert list(mean.get_ydata()) == [2.0, 2.0]
    assert mean.get_label() == "sac (5 seeds)"
    assert (list(mark.get_xdata()), list(mark.get_ydata())) == ([2], [1.0])
    assert mark.get_marker() == "D" and mark.get_zorder() > mean.get_zorder()
    (band,) = axes.collections
    corners = band.get_paths()[0].vertices
    assert corners[:, 0].min() == 1 and corners[:, 0].max() == 2
    assert corners[:, 1].min() < 0.0 and corners[:, 1].max() > 100.0
    assert band.get_alpha() < 0.5, "the curve is seen through it"


def test_curves_of_few_runs_are_thin_and_behind_their_mean() -> None:
    axes = new_figure().subplots()
    curves = ((0.0, 2.0, 5.0), (4.0, 8.0))
    found = group(WALKER, "sac", (5.0, 8.0), curves=curves)
    comparison._draw_group(axes, found, "red", None)
    first, second, mean = axes.lines
    assert (list(first.get_xdata()), list(first.get_ydata())) == ([1, 2, 3], [0.0, 2.0, 5.0])
    assert (list(second.get_xdata()), list(second.get_ydata())) == ([1, 2], [4.0, 8.0])
    assert list(mean.get_ydata()) == [2.0, 5.0]
    assert first.get_linewidth() < mean.get_linewidth() and first.get_alpha() < 1
    assert first.get_zorder() < mean.get_zorder()
    assert {to_hex(line.get_color()) for line in axes.lines} == {to_hex("red")}
