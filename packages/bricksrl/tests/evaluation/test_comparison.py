"""Comparison of runs: groups, intervals, probabilities, plots."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist

import pytest

from bricksrl.cli import main
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.errors import DescriptionError, RunError
from bricksrl.evaluation import comparison
from bricksrl.evaluation.comparison import compare, draw
from bricksrl.evaluation.statistics import probability_of_improvement
from bricksrl.plotting import finish, new_figure, number
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig
from bricksrl.training.curve import draw_learning_curve

RESULTS = Path(__file__).parents[4] / "benchmarks/results"


def write_run(
    path: Path, config: TrainConfig, returns: list[float], evaluation: float | None = None
) -> Path:
    """A run folder for comparisons."""
    path.mkdir(parents=True)
    folder = RunFolder(path)
    folder.write_config(config)
    episodes = [
        Episode(k, Phase.TRAIN, 10 * k, 10, value, None) for k, value in enumerate(returns, 1)
    ]
    folder.write_episodes(episodes)
    if evaluation is not None:
        scores = {"return_mean": evaluation, "return_std": 0.0, "episodes": 5}
        data = {"as_trained": True, "trained_episodes": len(returns), **scores}
        folder.evaluation_path.write_text(json.dumps(data))
    return path


@pytest.mark.parametrize(
    "damaged",
    [b"", b"\xff", b"[]", b"[" * 100_000, b"{}", b'{"return_mean": 1' + b"0" * 400 + b"}"],
    ids=["empty", "no text", "list", "deep", "without scores", "beyond floats"],
)
def test_damaged_evaluation_is_none(tmp_path: Path, damaged: bytes) -> None:
    path = write_run(tmp_path / "run", TrainConfig("Walker-v0"), [-1.0], -9.0)
    folder = RunFolder(path)
    assert folder.read_evaluation() is not None
    folder.evaluation_path.write_bytes(damaged)
    assert folder.read_evaluation() is None


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Five seeds of one agent, two of another, and one in another environment."""
    sac = TrainConfig("Walker-v0", "sac")
    made = [
        write_run(
            tmp_path / f"sac{s}", replace(sac, seed=s), [-200.0 + s, -50.0 + s, -10.0], -9.0 - s
        )
        for s in range(5)
    ]
    td3 = TrainConfig("Walker-v0", "td3")
    made += [
        write_run(tmp_path / f"td3{s}", replace(td3, seed=s), [-150.0, -60.0], -50.0 - s)
        for s in range(2)
    ]
    return [*made, write_run(tmp_path / "arm", TrainConfig("RoboArm-v0"), [-100.0, -1.0], -1.5)]


def test_intervals_need_five_seeds(runs: list[Path]) -> None:
    found = compare(runs)
    arm, sac, td3 = found.groups
    assert [(one.env, one.agent, len(one.seeds)) for one in found.groups] == [
        ("RoboArm-v0", "sac", 1),
        ("Walker-v0", "sac", 5),
        ("Walker-v0", "td3", 2),
    ]
    assert found.scored_by == "evaluation" and arm.is_evaluated
    assert (arm.interval, td3.interval) == (None, None)
    assert (
        sac.score == pytest.approx(-11.0)
        and sac.interval is not None
        and sac.interval.low < -11.0 < sac.interval.high
    )
    assert found.improvements == (), "two seeds tell no probability"


def test_missing_evaluation_scores_all_by_training(runs: list[Path]) -> None:
    (runs[0] / "evaluation.json").unlink()
    found = compare(runs)
    assert "last 5 episodes" in found.scored_by and not found.groups[0].is_evaluated
    assert found.groups[2].scores == (-105.0, -105.0)


@pytest.mark.parametrize("change", [{"trained_episodes": 1}, {"as_trained": False}])
def test_evaluation_of_fewer_episodes_or_other_conditions_is_ignored(
    runs: list[Path], change: dict[str, object]
) -> None:
    path = runs[0] / "evaluation.json"
    assert compare(runs[:1]).scored_by == "evaluation"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    assert compare(runs[:1]).scored_by != "evaluation"


def test_settings_that_differ_are_named(tmp_path: Path) -> None:
    config = TrainConfig("Walker-v0", "sac")
    other = replace(config, settings=replace(config.settings, gamma=0.5))
    paths = [write_run(tmp_path / "a", config, [1.0]), write_run(tmp_path / "b", other, [2.0])]
    assert {group.agent for group in compare(paths).groups} == {"sac, gamma=0.95", "sac, gamma=0.5"}


def test_seed_folder_expands_without_duplicates(tmp_path: Path) -> None:
    config = TrainConfig("Walker-v0")
    for seed in range(2):
        write_run(tmp_path / f"all/seed-{seed}", replace(config, seed=seed), [1.0, 2.0])
    assert compare([str(tmp_path / "all")]).groups[0].seeds == (0, 1)
    with pytest.raises(RunError, match="named twice"):
        compare([tmp_path / "all", tmp_path / "all/seed-1"])
    copy = write_run(tmp_path / "copy", config, [1.0])
    with pytest.raises(RunError, match="same seed"):
        compare([tmp_path / "all", copy])
    with pytest.raises(RunError, match="no episode yet"):
        compare([write_run(tmp_path / "empty", config, [])])
    with pytest.raises(RunError, match="no run"):
        compare([tmp_path])


def test_probability_of_improvement_counts_pairs() -> None:
    assert probability_of_improvement([2.0, 3.0], [1.0, 2.0]) == (0.875, None)
    standard = [NormalDist().inv_cdf((place + 0.5) / 40) for place in range(40)]
    probability, interval = probability_of_improvement([one + 1.0 for one in standard], standard)
    # of normal variables: the distribution function at 1 / sqrt(2)
    assert probability == pytest.approx(0.76, abs=0.02)
    assert interval is not None and interval.low < probability < interval.high
    with pytest.raises(DescriptionError):
        probability_of_improvement([], [1.0])


def test_the_commands_print_and_draw(runs: list[Path], tmp_path: Path, capfd) -> None:
    picture = tmp_path / "all.png"
    assert main(["compare", *map(str, runs), "--out", str(picture)]) == 0
    told = capfd.readouterr().out
    assert "needs 5 seeds" in told and "train 5 seeds of each" in told and "probability" not in told
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["compare", *map(str, runs), "--json"]) == 0
    assert len(json.loads(capfd.readouterr().out)["groups"]) == 3
    assert main(["compare", "--class", str(tmp_path), "--json"]) == 0
    rows = json.loads(capfd.readouterr().out)["runs"]
    assert {row["env"] for row in rows} == {"Walker-v0", "RoboArm-v0"} and len(rows) == len(runs)
    assert main(["plot", str(runs[0]), "--out", str(tmp_path / "one.png")]) == 0
    assert main(["plot", str(runs[0]), "--out", str(tmp_path / "one.gif")]) == 2
    for name in ("one.pdf", "one.svg"):
        assert main(["plot", str(runs[0]), "--out", str(tmp_path / name)]) == 0
        assert (tmp_path / name).read_bytes()[:5] in (b"%PDF-", b"<?xml")
    assert main(["compare"]) == 2


def test_reference_lines_equal_results() -> None:
    baselines = json.loads((RESULTS / "baselines.json").read_text(encoding="utf-8"))["environments"]
    papers = json.loads((RESULTS / "robots.json").read_text(encoding="utf-8"))["environments"]
    assert REFERENCES.keys() == baselines.keys()
    for env, reference in REFERENCES.items():
        measured = baselines[env]
        wanted = {
            "random": measured["random"]["return_mean"],
            "by hand": measured["scripted"]["return_mean"],
        }
        paper = (papers.get(env) or {}).get("paper")
        assert reference == wanted | ({"paper's SAC": paper["sac"][0]} if paper else {}), env


@pytest.mark.parametrize(
    ("value", "text"),
    [(8280.4, "8,280"), (-52.04, "-52"), (0.123456, "0.123"), (12.345, "12.3"), (3e9, "3.00e+09")],
)
def test_numbers_are_plain(value: float, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize("count", [0, 1, 3])
def test_curves_of_few_episodes(count: int, tmp_path: Path) -> None:
    episodes = [Episode(k, Phase.TRAIN, k, 1, 8280.0 * k, None) for k in range(1, count + 1)]
    draw_learning_curve(
        tmp_path / "a.png", episodes, "Spinning-v0", {"random": 75.0, "by hand": 8529.0}
    )
    assert (tmp_path / "a.png").exists()


def test_paths_may_be_texts(runs: list[Path], tmp_path: Path) -> None:
    (only,) = compare(str(runs[0])).groups
    assert only == compare(runs[:1]).groups[0]
    draw(str(tmp_path / "a.png"), [only])
    assert (tmp_path / "a.png").stat().st_size > 1_000


@pytest.mark.parametrize("is_evaluated", [False, True])
def test_legend_names_the_mark_only_where_it_is_drawn(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_evaluated: bool
) -> None:
    figures = []
    monkeypatch.setattr(comparison, "save", lambda figure, path: figures.append(figure))
    (group,) = compare(runs[:1]).groups
    draw(tmp_path / "a.png", [replace(group, is_evaluated=is_evaluated)])
    (axes,) = [each for each in figures[0].axes if each.get_visible()]
    assert any(line.get_marker() == "D" for line in axes.lines) is is_evaluated
    assert ("evaluation" in axes.get_ylabel()) is is_evaluated


def test_curve_of_one_episode_is_visible() -> None:
    axes = new_figure().subplots()
    [line] = axes.plot([1], [5.0])
    finish(axes)
    low, high = axes.get_xlim()
    assert [tick for tick in axes.get_xticks() if low <= tick <= high] == [
        1.0
    ] and line.get_marker() == "o"


def test_steps_of_a_group_are_those_of_its_longest_run(tmp_path: Path) -> None:
    config = TrainConfig("Walker-v0")
    for seed, count in enumerate((3, 5, 2)):
        write_run(tmp_path / f"{seed}", replace(config, seed=seed), [-1.0] * count)
    (group,) = compare([tmp_path / f"{seed}" for seed in range(3)]).groups
    assert group.steps == 50 and [len(curve) for curve in group.curves] == [3, 5, 2]


@pytest.mark.parametrize(
    ("seeds", "has_band", "lines"), [(1, False, 1), (4, False, 5), (5, True, 1)]
)
def test_five_seeds_have_a_band_and_fewer_each_their_curve(
    tmp_path: Path, seeds: int, has_band: bool, lines: int
) -> None:
    config = TrainConfig("Walker-v0")
    for seed in range(seeds):
        write_run(tmp_path / f"{seed}", replace(config, seed=seed), [-2.0, -1.0 - seed])
    (group,) = compare([tmp_path / f"{seed}" for seed in range(seeds)]).groups
    axes = new_figure().subplots()
    comparison._draw_group(axes, group, "red", "sac")
    assert bool(axes.collections) == has_band and len(axes.lines) == lines


def test_axes_have_plain_numbers() -> None:
    axes = new_figure().subplots()
    axes.plot([1, 2], [0.0, 2000.5], label="return")
    finish(axes)
    along, up = axes.xaxis.get_major_formatter(), axes.yaxis.get_major_formatter()
    assert (along(1200.0, 0), up(0.0, 0), up(2000.5, 0)) == ("1,200", "0", number(2000.5))
    assert axes.figure.legends
    finish(other := new_figure().subplots(), legend=False)
    assert not other.figure.legends
