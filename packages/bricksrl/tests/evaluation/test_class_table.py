"""The table of a class: which runs are the same, in what others differ, and what may be
compared."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from test_comparison import write_run

from bricksrl.cli.evaluate import print_class
from bricksrl.errors import RunError
from bricksrl.evaluation.class_table import class_table
from bricksrl.training.config import TrainConfig


def pupil(
    folder: Path,
    name: str,
    seed: int,
    returns: list[float],
    evaluation: float | None = 5.0,
    **options: object,
) -> Path:
    config = TrainConfig(env="RunAway-v0", seed=seed, name=name, **options)
    return write_run(folder / (name or "nobody") / "runs" / "one", config, returns, evaluation)


def test_runs_of_the_default_seed_are_named_as_the_same(tmp_path: Path) -> None:
    for name in ("Anna", "Ben", "Cem"):
        pupil(tmp_path, name, 0, [1.0, 2.0])
    table = class_table(tmp_path)
    assert {row.name for row in table.rows} == {"Anna", "Ben", "Cem"} and not any(
        row.differs for row in table.rows
    )
    text = "\n".join(table.sentences)
    assert (
        "Anna (Anna/runs/one), Ben (Ben/runs/one), Cem (Cem/runs/one) are the same run, seed 0"
        in text
    )
    assert "together they tell what one run tells" in text and "interval" not in text


def test_seeds_give_an_interval_and_repeats_count_once(tmp_path: Path) -> None:
    for seed in range(5):
        pupil(tmp_path, f"pupil {seed}", seed, [float(seed)], float(seed))
    pupil(tmp_path, "again", 4, [4.0], 4.0)
    text = "\n".join(class_table(tmp_path).sentences)
    assert (
        "6 runs of the same settings and length: 5 different seeds, interquartile mean 2 (95 % "
        "interval"
    ) in text
    (tmp_path / "pupil 0/runs/one/evaluation.json").unlink()
    assert "some were evaluated and some were not" in "\n".join(class_table(tmp_path).sentences)


def test_returns_of_two_tasks_are_not_compared(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 0, [1.0])
    said = "Returns of different tasks are not comparable"
    assert not any(said in sentence for sentence in class_table(tmp_path).sentences)
    spinning = TrainConfig(env="Spinning-v0", seed=0, name="Ben")
    write_run(tmp_path / "Ben" / "runs" / "one", spinning, [5.0], 5.0)
    assert any(said in sentence for sentence in class_table(tmp_path).sentences)


def test_what_differs_is_said(tmp_path: Path) -> None:
    for seed in (0, 1):
        pupil(tmp_path, f"usual {seed}", seed, [1.0, 2.0])
    pupil(tmp_path, "longer", 2, [1.0, 2.0, 3.0])
    pupil(tmp_path, "td3", 3, [1.0, 2.0], agent="td3")
    settings = TrainConfig(env="RunAway-v0").settings
    pupil(
        tmp_path,
        "faster",
        4,
        [1.0, 2.0],
        settings={**vars(settings)} and type(settings)(learning_rate=0.5),
    )
    rows = {row.name: row.differs for row in class_table(tmp_path).rows}
    assert rows["usual 0"] == () and rows["longer"] == ("episodes 3 instead of 2",)
    assert rows["td3"] == (
        "agent td3 instead of sac",
    ) and "learning_rate 0.5 instead of" in " ".join(rows["faster"])
    text = "\n".join(class_table(tmp_path).sentences)
    assert "2 to 3 episodes by their curves" in text and "an interval needs 5 seeds" in text


def test_run_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    pupil(tmp_path, "", 0, [1.0], None)
    pupil(tmp_path, "empty", 1, [])
    damaged = pupil(tmp_path, "damaged", 2, [1.0]) / "config.json"
    damaged.write_text(damaged.read_text()[:50])
    table = class_table(tmp_path)
    assert [(row.name, row.is_evaluated) for row in table.rows] == [("nobody", False)]
    assert any("empty/runs/one is left out" in text for text in table.sentences)
    assert any("damaged/runs/one is left out" in text for text in table.sentences)
    assert json.loads(table.to_json())["runs"][0]["score"] == 1.0
    with pytest.raises(RunError, match="no run in"):
        class_table(tmp_path / "nothing")


def test_printed_table_has_an_interval_where_there_is_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    pupil(tmp_path, "Anna", 0, [1.0, 2.0])
    pupil(tmp_path, "Ben", 1, [1.0, 2.0], evaluation=None)
    table = class_table(tmp_path)
    anna, ben = sorted(table.rows, key=lambda row: row.name)
    print_class(replace(table, rows=(replace(anna, interval=(1.5, 2.5)), ben)))
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    assert "1.5 to 2.5" in lines["Anna"] and " to " not in lines["Ben"]
    assert "*" in lines["Ben"] and "*" not in lines["Anna"]


def test_a_star_is_explained_only_where_one_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    pupil(tmp_path, "[red]Anna", 3, [1.0, 2.0])
    table = class_table(tmp_path)
    (anna,) = table.rows
    for is_evaluated in (True, False):
        row = replace(anna, is_evaluated=is_evaluated, score=2.5, interval=None, differs=("a", "b"))
        print_class(replace(table, rows=(row,), sentences=("These may be [b]compared.",)))
        lines = capsys.readouterr().out.splitlines()
        cells = lines[1].split()
        assert cells[0] == "[red]Anna"
        score = "2.5" if is_evaluated else "2.5*"
        assert cells[3:] == ["3", str(anna.episodes), score, "a;", "b", anna.folder]
        assert lines[-1] == "These may be [b]compared."
        assert ("* not evaluated: mean of the last" in "\n".join(lines)) is not is_evaluated
