"""What the table of a class says, to the letter."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from test_class_table import pupil
from test_comparison import write_run

from bricksrl.errors import RunError
from bricksrl.evaluation.class_table import class_table
from bricksrl.training.config import TrainConfig

FEW = "runs that differ in settings are compared as groups of five seeds, not one by one"


def test_three_seeds_tell_their_middle_and_five_an_interval(tmp_path: Path) -> None:
    for seed in range(3):
        pupil(tmp_path, f"pupil {seed}", seed, [1.0], float(seed))
    assert class_table(tmp_path).sentences == (
        (
            "RunAway-v0: 3 runs of the same settings and length: 3 different seeds, interquartile "
            "mean 1; an interval needs 5 seeds."
        ),
    )
    for seed in range(5):
        pupil(tmp_path / "five", f"pupil {seed}", seed, [1.0], 2.5)
    assert class_table(tmp_path / "five").sentences == (
        (
            "RunAway-v0: 5 runs of the same settings and length: 5 different seeds, interquartile "
            "mean 2.5 (95 % interval 2.5 to 2.5)."
        ),
    )


def test_single_run_needs_no_sentence(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 0, [1.0])
    assert class_table(tmp_path).sentences == ()


@pytest.mark.parametrize(
    ("returns", "what"), [([1.0, 2.0], "the same run"), ([1.0, 3.0], "runs of the same seed")]
)
def test_same_seed_counts_once(tmp_path: Path, returns: list[float], what: str) -> None:
    """A copy has the same curve to the last digit, a repetition elsewhere nearly the same."""
    pupil(tmp_path, "Anna", 7, [1.0, 2.0])
    pupil(tmp_path, "Ben", 7, returns)
    anna = Path("Anna/runs/one")
    ben = Path("Ben/runs/one")
    assert class_table(tmp_path).sentences == (
        (
            f"RunAway-v0: Anna ({anna}), Ben ({ben}) are {what}, seed 7 with the same settings: "
            "they count once."
        ),
        (
            "RunAway-v0: 2 runs of the same settings and length: together they tell what one run "
            "tells; train with `--seed 1`, `--seed 2`, ... for more."
        ),
    )


@pytest.mark.parametrize("options", [{"asynchronous": True}, {"hub": "ble", "asynchronous": False}])
def test_runs_that_a_seed_does_not_repeat_count_each(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    for name in ("Anna", "Ben"):
        pupil(tmp_path, name, 7, [1.0, 2.0], **options)
    assert class_table(tmp_path).sentences == (
        (
            "RunAway-v0: 2 runs of the same settings and length: 2 different seeds, interquartile "
            "mean 5; an interval needs 5 seeds."
        ),
    )


def test_groups_of_other_settings_come_after_the_largest(tmp_path: Path) -> None:
    for seed in (0, 1):
        pupil(tmp_path, f"long {seed}", seed, [1.0, 2.0, 3.0], 9.0)
    for seed in (0, 1, 2):
        pupil(tmp_path, f"usual {seed}", seed, [1.0, 2.0], 5.0)
    assert class_table(tmp_path).sentences == (
        (
            "RunAway-v0: 3 runs of the same settings and length: 3 different seeds, interquartile "
            "mean 5; an interval needs 5 seeds."
        ),
        (
            "RunAway-v0: 2 runs of other settings, equal among themselves: 2 different seeds, "
            "interquartile mean 9; an interval needs 5 seeds."
        ),
        f"RunAway-v0: {FEW}; runs of 2 to 3 episodes by their curves, up to the shorter one's end.",
    )


def test_runs_of_one_length_are_not_compared_by_their_curves(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 0, [1.0])
    pupil(tmp_path, "Ben", 0, [1.0], agent="td3")
    assert class_table(tmp_path).sentences == (f"RunAway-v0: {FEW}.",)


def test_three_differences_are_shown_and_the_others_counted(tmp_path: Path) -> None:
    usual = TrainConfig(env="RunAway-v0").settings
    for seed in (0, 1):
        pupil(tmp_path, f"usual {seed}", seed, [1.0])
    three = replace(usual, gamma=0.5, tau=0.25, batch_size=3)
    pupil(tmp_path, "three", 0, [1.0], settings=three)
    pupil(tmp_path, "five", 0, [1.0], settings=replace(three, learning_rate=0.5, n_step=2))
    differs = {row.name: row.differs for row in class_table(tmp_path).rows}
    assert differs["usual 0"] == ()
    texts = {
        f"gamma 0.5 instead of {usual.gamma}",
        f"tau 0.25 instead of {usual.tau}",
        f"batch_size 3 instead of {usual.batch_size}",
    }
    assert len(differs["three"]) == 3 and set(differs["three"]) == texts
    assert len(differs["five"]) == 4 and differs["five"][3] == "2 more"


def test_best_run_comes_first_within_each_task(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 0, [1.0], 1.0)
    pupil(tmp_path, "Ben", 1, [1.0], 3.0)
    pupil(tmp_path, "Cem", 2, [1.0], 2.0)
    walker = TrainConfig("Walker-v0", name="Zoe")
    write_run(tmp_path / "Aa", walker, [50.0], 50.0)
    rows = class_table(tmp_path).rows
    assert [row.name for row in rows] == ["Zoe", "Ben", "Cem", "Anna"]
    assert [row.score for row in rows] == [50.0, 3.0, 2.0, 1.0]


def test_run_without_evaluation_scores_by_its_last_five_episodes(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 4, [100.0, 1.0, 2.0, 3.0, 4.0, 6.0], evaluation=None)
    (row,) = class_table(tmp_path).rows
    assert row.score == pytest.approx(3.2)
    assert (row.is_evaluated, row.episodes, row.seed, row.interval) == (False, 6, 4, None)
    assert (row.env, row.agent, row.folder) == ("RunAway-v0", "sac", str(Path("Anna/runs/one")))


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ({"low": 1, "high": 2.5}, (1.0, 2.5)),
        ([1.5, 3], (1.5, 3.0)),
        (None, None),
        ("wide", None),
        ({"low": 1.0}, None),
    ],
)
def test_interval_of_an_evaluation_is_shown(tmp_path: Path, written: Any, read: Any) -> None:
    path = pupil(tmp_path, "Anna", 0, [1.0], 2.0) / "evaluation.json"
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | {"return_interval": written}))
    (row,) = class_table(tmp_path).rows
    assert row.interval == read and row.score == 2.0


def test_unnamed_run_is_called_by_the_uppermost_folder(tmp_path: Path) -> None:
    config = TrainConfig(env="RunAway-v0")
    write_run(tmp_path / "runs" / "mine", config, [1.0])
    write_run(tmp_path / "team" / "Ben" / "runs" / "one", config, [1.0])
    assert {row.name for row in class_table(tmp_path).rows} == {"mine", "team"}


def test_class_without_a_run_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(RunError) as raised:
        class_table(tmp_path)
    assert str(raised.value) == (
        f"there is no run in {tmp_path} that can be compared; put the folders of the runs into it"
    )
    pupil(tmp_path, "Anna", 0, [])
    with pytest.raises(RunError) as raised:
        class_table(tmp_path)
    assert str(raised.value) == (
        f"there is no run in {tmp_path} that can be compared; {Path('Anna/runs/one')} is left "
        "out: it has no episode yet."
    )


def test_table_as_json_has_every_field(tmp_path: Path) -> None:
    pupil(tmp_path, "Anna", 3, [1.0], 2.0)
    assert json.loads(class_table(tmp_path).to_json()) == {
        "runs": [
            {
                "name": "Anna",
                "folder": str(Path("Anna/runs/one")),
                "env": "RunAway-v0",
                "agent": "sac",
                "seed": 3,
                "episodes": 1,
                "score": 2.0,
                "is_evaluated": True,
                "interval": None,
                "differs": [],
            }
        ],
        "sentences": [],
    }
