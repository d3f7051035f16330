"""Datasets that are corrected: episodes kept and removed, and CSV."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from toy_data import record

from bricksrl.cli import main
from bricksrl.data import load
from bricksrl.data.csv_files import export_csv
from bricksrl.data.dataset import read_dataset
from bricksrl.data.edit import select
from bricksrl.data.integrity import check
from bricksrl.data.selection import Selection
from bricksrl.errors import DataError

LENGTHS = (3, 5, 2, 7, 4)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("toy") / "set", LENGTHS)


@pytest.mark.parametrize(
    ("selection", "kept"),
    [
        (Selection(episodes="1-2, 4"), [5, 2, 4]),
        (Selection(success=True), [3, 2, 4]),
        (Selection(success=False), [5, 7]),
        (Selection(steps_min=4), [5, 7, 4]),
        (Selection(steps_min=3, steps_max=5), [3, 5, 4]),
        (Selection(episodes="0-3", success=False, steps_max=6), [5]),
        (Selection(whole=True), list(LENGTHS)),
    ],
)
def test_what_is_kept_and_what_is_removed(
    selection: Selection, kept: list[int], source: Path, tmp_path: Path
) -> None:
    new = select(source, tmp_path / "kept", selection)
    assert [row.length for row in new.rows] == kept and not check(tmp_path / "kept")
    others = [length for length in LENGTHS if length not in kept]
    if not others:
        with pytest.raises(DataError, match="none of 5 episodes would be left"):
            select(source, tmp_path / "others", selection, keep=False)
        return
    new = select(source, tmp_path / "others", selection, keep=False)
    assert [row.length for row in new.rows] == others and not check(tmp_path / "others")
    assert [row.episode for row in new.rows] == list(range(len(others))), "numbered anew"


def test_returns_are_bounds(source: Path, tmp_path: Path) -> None:
    returns = [row.return_ for row in read_dataset(source).rows]
    bound = sorted(returns)[2]
    better = select(source, tmp_path / "better", Selection(return_min=bound))
    assert [row.return_ for row in better.rows] == [value for value in returns if value >= bound]
    assert len(better.rows) == 3, "a bound is included"
    worse = select(source, tmp_path / "worse", Selection(return_max=bound))
    assert [row.return_ for row in worse.rows] == [value for value in returns if value <= bound]


def test_steps_are_those_of_the_source(source: Path, tmp_path: Path) -> None:
    select(source, tmp_path / "kept", Selection(episodes="3,1"))
    before, after = load(source), load(tmp_path / "kept")
    order = np.isin(before.episode.numpy(), (1, 3))
    assert np.array_equal(after.action, before.action[order]), "in the order of the source"


@pytest.mark.parametrize(
    ("selection", "says"),
    [
        (Selection(), "no condition is given"),
        (Selection(episodes="7"), "there is no episode 7 among 5 episodes, which begin at 0"),
        (Selection(episodes="1;2"), "'1;2' is no episode; write numbers and ranges: 0-9,12"),
        (Selection(episodes="1,,2"), "'' is no episode"),
        (Selection(episodes="4-2"), "4-2 runs backwards; write 2-4"),
        (Selection(episodes="99999999999"), "is no episode"),
        (Selection(steps_min=100), "none of 5 episodes would be left"),
    ],
)
def test_what_selects_nothing_is_refused(
    selection: Selection, says: str, source: Path, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=says):
        select(source, tmp_path / "new", selection)
    assert not (tmp_path / "new").exists()


def test_csv_has_a_row_a_step_and_what_was_observed_last(source: Path, tmp_path: Path) -> None:
    export_csv(source, tmp_path / "all.csv")
    with (tmp_path / "all.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == sum(LENGTHS) + len(LENGTHS)
    episodes = load(source)
    second = [line for line in lines if line["episode"] == "1"]
    at = episodes.episode == 1
    observed = [
        [float(line[f"observation.{name}"]) for name in ("angle", "distance")] for line in second
    ]
    assert np.allclose(observed[:-1], episodes.observation[at], rtol=1e-6)
    assert np.allclose(observed[-1], episodes.next_observation[at][-1], rtol=1e-6)
    assert np.allclose(
        [float(line["action.motor"]) for line in second[:-1]], episodes.action[at][:, 0], rtol=1e-6
    )
    assert np.allclose([float(line["reward"]) for line in second[:-1]], episodes.reward[at])
    assert [line["seconds"] for line in second] == ["0", "0.25", "0.5", "0.75", "1", "1.25"]
    assert [line["truncated"] for line in second] == ["0", "0", "0", "0", "1", ""]
    assert second[-1]["reward"] == second[-1]["action.motor"] == ""


def test_csv_has_a_file_an_episode(source: Path, tmp_path: Path) -> None:
    export_csv(source, tmp_path / "files")
    written = sorted((tmp_path / "files").iterdir())
    assert [path.name for path in written] == [f"episode-{number:03}.csv" for number in range(5)]
    assert [len(path.read_text().splitlines()) - 2 for path in written] == list(LENGTHS)
    with pytest.raises(DataError, match="exists"):
        export_csv(source, tmp_path / "files")


def test_commands_correct_and_export(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--out", str(tmp_path / "good"), "--episodes", "0-3", "--success", "yes"]
    assert main(["data", "keep", str(source), *words]) == 0
    assert capsys.readouterr().out == f"2 episodes, 5 steps, of 5 episodes: {tmp_path / 'good'}\n"
    words = ["--out", str(tmp_path / "rest"), "--steps-max", "3"]
    assert main(["data", "remove", str(source), *words]) == 0
    assert [row.length for row in read_dataset(tmp_path / "rest").rows] == [5, 7, 4]
    out = tmp_path / "table.csv"
    assert main(["data", "export", str(source), "--format", "csv", "--out", str(out)]) == 0
    assert out.is_file()
    assert main(["data", "keep", str(source), "--out", str(tmp_path / "none")]) == 2
    assert "no condition is given" in capsys.readouterr().err


def test_ending_of_the_name_says_the_format(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "table.CSV"
    assert main(["data", "export", str(source), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"csv     {out}\n"
    assert out.read_text().startswith("episode,step,")


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("table.csv", ["--format", "minari"], "leave out --format, or the ending"),
        (".csv", [], "has an ending and no name; give table.csv"),
        (".csv", ["--format", "csv"], "has an ending and no name; give table.csv"),
    ],
)
def test_name_that_is_no_table_is_refused(
    name: str,
    options: list[str],
    says: str,
    source: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["data", "export", str(source), "--out", str(tmp_path / name), *options]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
