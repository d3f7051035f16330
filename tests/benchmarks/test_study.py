"""Studies: tables of trainings with several seeds, resumable."""

from __future__ import annotations

import json
import pickle
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from killed import assert_runs_end_with

from benchmarks.study import name_of, robot_seconds, run_study, summary
from benchmarks.study_page import page
from benchmarks.study_tables import OUTSIDE, STUDIES, Cell, Condition, Study, drawn_twins
from bricksrl.agents.sac import SACSettings
from bricksrl.errors import RunError
from bricksrl.evaluation.statistics import (
    interquartile_mean,
    seeds_interval,
)
from bricksrl.training import Episode, RunFolder, TrainConfig, train
from bricktwin.twin.physics import Physics

HEADS, MACHINE = ["row", "column"], {"processor": "P", "cores": 2}
SMALL = SACSettings(hidden=(8,), batch_size=8, updates_per_step=0.1)
SHORT = {"max_steps": 20}
AFTER = (
    Condition("same", episodes=2),
    Condition("twin", "Walker-v0", {"physics": Physics(friction_scale=0.8), "options": SHORT}, 1),
)


def cells(quick: bool) -> tuple[Cell, ...]:
    agents = {"sac": (SMALL, AFTER), "random": (None, AFTER[:1])}
    return tuple(
        Cell(
            agent,
            "WalkerSim-v0",
            {
                "env": "WalkerSim-v0",
                "agent": agent,
                "episodes": 2,
                "settings": settings,
                "options": SHORT,
            },
            after,
        )
        for agent, (settings, after) in agents.items()
    )


def simulated(quick: bool) -> tuple[Cell, ...]:
    return tuple(replace(cell, conditions=AFTER[:1]) for cell in cells(quick))


TOY = Study("toy", "A toy", 6, 6, seeds=5, cells=simulated)


def test_study_writes_tables_and_reuses_runs(tmp_path: Path) -> None:
    toy = replace(TOY, cells=cells)
    page = run_study(toy, tmp_path / "toy", quick=True, jobs=1)
    result = json.loads((tmp_path / "toy" / "study.json").read_text())
    assert [cell["row"] for cell in result["cells"]] == ["sac", "random"]
    found = result["cells"][0]["conditions"]
    assert found["same"]["episodes"] == 4 and found["twin"]["episodes"] == 2
    assert (
        found["same"]["return_95"] is None and result["improvements"][0]["probability_95"] is None
    )
    assert {"processor", "cores", "system"} == set(result["machine"]) and "torch" in result[
        "versions"
    ]
    text = page.read_text()
    assert (
        "| agent | environment | settings | seeds | return, same | return, twin |" in text
        and "| sac | WalkerSim-v0 | default | 2 | -" in text
    )
    folder = tmp_path / "toy" / name_of(cells(True)[0]) / "seed-0"
    untouched = folder.with_name("seed-1") / "outcome.json"
    before = untouched.stat().st_mtime_ns
    (folder / "outcome.json").unlink()  # as if it was killed before it had evaluated
    run_study(toy, tmp_path / "toy", quick=True, jobs=1)
    times_s = result["cells"][0]["cpu_s"]
    assert all(0.0 < time_s < 600.0 for time_s in times_s)
    times_s[0] = None  # of a resumed run, only the last part is known
    assert json.loads((tmp_path / "toy" / "study.json").read_text())["cells"] == result["cells"]
    assert untouched.stat().st_mtime_ns == before
    assert len((folder / "metrics.csv").read_text().splitlines()) == 3, (
        "the run was not made again, only evaluated"
    )


@pytest.mark.parametrize("damaged", ['{"seed": 0, ', "[1]", '{"seed": 0}'])
def test_seed_with_a_damaged_outcome_is_evaluated_again(tmp_path: Path, damaged: str) -> None:
    for _ in range(2):
        text = run_study(TOY, tmp_path, quick=True, seeds=1, jobs=1, only=("random-*",)).read_text()
        assert (
            "Command: `python -m benchmarks toy --quick`." in text
            and "| random | WalkerSim-v0 | default | 1 | -" in text
        )
        (tmp_path / "random-WalkerSim-v0" / "seed-0" / "outcome.json").write_text(damaged)


def test_folder_of_another_study_raises(tmp_path: Path) -> None:
    run_study(TOY, tmp_path, quick=True, seeds=1, jobs=1, only=("random-*",))
    with pytest.raises(
        RunError, match=r"has the study 'toy' in quick form; choose another folder$"
    ):
        run_study(TOY, tmp_path, seeds=1, jobs=1, only=("random-*",))
    with pytest.raises(RunError, match="has the study 'toy'"):
        run_study(
            replace(TOY, name="other"), tmp_path, quick=True, seeds=1, jobs=1, only=("random-*",)
        )


def test_study_that_cannot_run_makes_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RunError, match="no 'slurm' to run on"):
        run_study(TOY, tmp_path / "study", quick=True, on="slurm")
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RunError, match="Ray is not installed"):
        run_study(TOY, tmp_path / "study", quick=True, on="ray")
    assert not list(tmp_path.iterdir())


def test_each_seed_is_evaluated_on_episodes_of_its_own(tmp_path: Path) -> None:
    run_study(TOY, tmp_path, quick=True, jobs=1, only=("random-*",))
    one, other = json.loads((tmp_path / "study.json").read_text())["cells"][0]["conditions"][
        "same"
    ]["returns"]
    assert one != other


def test_only_chosen_cells_are_run(tmp_path: Path) -> None:
    page = run_study(TOY, tmp_path, quick=True, jobs=1, only=("random-*",))
    assert "| random |" in page.read_text() and "Not run: sac-WalkerSim-v0." in page.read_text()
    assert (
        "| random |"
        in run_study(TOY, tmp_path, quick=True, seeds=1, jobs=1, only=("sac-*",)).read_text()
    ), "kept"
    assert "Not run" not in page.read_text()
    with pytest.raises(
        RunError,
        match="no cell of 'toy' matches ppo-\\*; choose from sac-WalkerSim-v0, random-WalkerSim-v0",
    ):
        run_study(TOY, tmp_path, quick=True, only=("ppo-*",))


@pytest.mark.slow
def test_workers_end_with_a_study_that_is_killed(tmp_path: Path) -> None:
    study = ["strategies", "--only", "sac-*", "--jobs", "2", "--folder", str(tmp_path)]
    assert_runs_end_with(study, tmp_path, "benchmarks")


def test_training_that_ctrl_c_ends_has_no_outcome_and_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = {"env": "WalkerSim-v0", "episodes": 4, "settings": SMALL, "options": SHORT}
    study = Study(
        "i",
        "I",
        6,
        6,
        seeds=5,
        cells=lambda _: (Cell("sac", "c", config, (Condition("same", episodes=1),)),),
    )
    append = RunFolder.append

    def interrupt(folder: RunFolder, episode: Episode) -> None:
        append(folder, episode)
        if episode.episode == 2:
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "append", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run_study(study, tmp_path, seeds=1, jobs=1)
    with pytest.raises(RunError, match="has the study 'i' in full"):
        run_study(study, tmp_path, quick=True, seeds=1, jobs=1)
    run = tmp_path / "sac-c" / "seed-0"
    assert len(RunFolder(run).read_episodes()) == 2 and not (run / "outcome.json").exists()
    run_study(study, tmp_path, seeds=1, jobs=1)
    assert json.loads((run / "outcome.json").read_text())["outcome"]["steps"] == 80


def test_page_shows_all_seeds_of_the_folder(tmp_path: Path) -> None:
    run_study(TOY, tmp_path, quick=True, seeds=3, jobs=1, only=("random-*",))
    run_study(TOY, tmp_path, quick=True, seeds=1, jobs=1, only=("random-*",))
    assert json.loads((tmp_path / "study.json").read_text())["cells"][0]["seeds"] == 3


def test_failed_seed_is_reported_others_kept(tmp_path: Path) -> None:
    def broken(quick: bool) -> tuple[Cell, ...]:
        return (
            simulated(quick)[1],
            Cell("none", "Nowhere-v0", {"env": "Nowhere-v0", "settings": SMALL}, AFTER),
        )

    with pytest.raises(
        RunError,
        match="2 of 4 runs failed; the first: none-Nowhere-v0 seed 0: there is no environment",
    ):
        run_study(Study("b", "B", 6, 6, seeds=2, cells=broken), tmp_path / "b", jobs=1)
    assert len(json.loads((tmp_path / "b" / "study.json").read_text())["cells"]) == 1


def outcome(seed: int, returns: list[float], successes: int | None) -> dict:
    judged = {
        "condition": "same",
        "returns": returns,
        "successes": successes,
        "metrics": {"x_m": seed},
    }
    return {
        "seed": seed,
        "judged": [judged],
        "steps": 10,
        "wall_s": 1.0,
        "robot_s": 120.0,
        "reached": True,
    }


def test_study_intervals_need_five_seeds() -> None:
    cell = Cell("r", "c", {}, (Condition("same"),))
    few = summary(cell, [outcome(seed, [seed, seed + 1], 1) for seed in range(4)])["conditions"][
        "same"
    ]
    assert few["return_95"] is None and "success_95" not in few and few["success_rate"] == 0.5
    many = summary(cell, [outcome(seed, [seed, seed + 1], 1) for seed in range(5)])["conditions"][
        "same"
    ]
    assert many["return_iqm"] == 2.5 and many["return_95"][0] < 2.5 < many["return_95"][1]
    assert many["success_95"] == pytest.approx([0.237, 0.763], abs=1e-3)
    assert many["metrics"] == {"x_m": 2.0}


def test_no_study_interval_below_five_seeds() -> None:
    assert seeds_interval([1.0, 2.0, 3.0, 4.0]) is None
    interval = seeds_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert (
        interval is not None
        and interval.low < interquartile_mean(np.arange(1.0, 6.0)) < interval.high
    )


def test_study_page_compares_with_paper() -> None:
    cell = Cell(
        "sac",
        "Robot-v0",
        {},
        (Condition("same"),),
        {"return": (1.0, 0.5), "success": 0.7, "minutes": 15},
    )
    result = {
        "title": "T",
        "study": "t",
        "quick": False,
        "heads": HEADS,
        "metrics": ["x_m"],
        "machine": MACHINE,
    }
    found = {
        **result,
        "versions": {},
        "cells": [summary(cell, [outcome(seed, [2.0], 1) for seed in range(5)])],
    }
    lines = page(found).splitlines()
    names = [name.strip() for name in lines[5].strip("|").split("|")]
    row = dict(zip(names, (value.strip() for value in lines[7].strip("|").split("|")), strict=True))
    assert (
        row["return"] == "2 [2, 2]"
        and row["the paper's return"] == "1 ± 0.5"
        and row["the paper's success"] == "70 %"
    )
    assert row["success"] == "100 % [57, 100]" and row["x m"] == "2" and row["reached"] == "5 of 5"
    assert row["robot minutes"] == "2.0" and row["the paper's minutes"] == "15"
    assert "robot minutes" not in page(
        {**found, "cells": [{**found["cells"][0], "robot_s": [None] * 5}]}
    )


def test_study_page_has_a_table_for_each_measure_of_many_conditions() -> None:
    names = ("same", "slope", "carpet")
    outcomes = [
        {
            **outcome(seed, [], 0),
            "judged": [
                {**outcome(seed, [k, k], 2 - k % 2)["judged"][0], "condition": name}
                for k, name in enumerate(names)
            ],
        }
        for seed in range(5)
    ]
    cells = [
        summary(Cell("sac", column, {}, tuple(map(Condition, names))), outcomes)
        for column in ("A-v0", "B-v0")
    ]
    about = {
        "title": "T",
        "study": "t",
        "quick": False,
        "heads": ["agent", "environment"],
        "metrics": ["speed_m_s"],
    }
    text = page({**about, "machine": MACHINE, "versions": {}, "cells": cells})
    assert (
        "| agent | environment | settings | seeds |" in text
        and "| sac | B-v0 | default | 5 |" in text
    )
    assert (
        "Return:\n\n| condition | A-v0 | B-v0 |" in text
        and "| carpet | 2 [2, 2] | 2 [2, 2] |" in text
    )
    assert (
        "| slope | 50 % [24, 76] |" in text
        and "| carpet | 100 %" not in text
        and "Success, which is 100 %" in text
    )
    without_failures = {
        **cells[0],
        "conditions": {name: {**cells[0]["conditions"]["same"]} for name in names},
    }
    text = page({**about, "machine": MACHINE, "versions": {}, "cells": [without_failures]})
    assert "Success: 100 % under all conditions." in text


def test_study_page_joins_cells_and_names_units() -> None:
    cell = Cell("bc", "A-v0", {}, (Condition("same"),))
    paper, default = (
        summary(cell, [outcome(seed, [value], None) for seed in range(5)]) for value in (1.0, 2.0)
    )
    default["conditions"] = {
        "other": {**default["conditions"]["same"], "metrics": {"pitch_deg": 3.0}}
    }
    about = {
        "title": "T",
        "study": "t",
        "quick": False,
        "heads": HEADS,
        "metrics": ["pitch_deg"],
        "machine": MACHINE,
    }
    lines = page({**about, "versions": {}, "cells": [paper, default]}).splitlines()
    assert lines[5].startswith(
        "| row | column | settings | seeds | return, same | return, other | pitch, degrees |"
    )
    assert (
        lines[7].startswith("| bc | A-v0 | default | 5 | 1 [1, 1] | 2 [2, 2] | 3 |")
        and not lines[8]
    )


def test_study_page_shows_cpu_time_where_all_seeds_have_it() -> None:
    cell = Cell("sac", "Robot-v0", {}, (Condition("same"),))
    # of a study before CPU times were measured
    earlier = [outcome(seed, [2.0], 1) for seed in range(5)]
    later = [{**one, "cpu_s": 90.0} for one in earlier]
    result = {
        "title": "T",
        "study": "t",
        "quick": False,
        "heads": HEADS,
        "machine": MACHINE,
        "versions": {},
    }
    heads = []
    for outcomes in (earlier, later, [*earlier[:4], later[4]]):
        text = page({**result, "cells": [summary(cell, outcomes)]})
        heads.append([head for head in ("CPU minutes", "wall minutes") if head in text])
    assert heads == [["wall minutes"], ["CPU minutes"], ["wall minutes"]]


def test_fine_tuning_leaves_original_run(tmp_path: Path) -> None:
    later = Condition(
        "later", "RunAway-v0", {"physics": Physics(friction_scale=0.8)}, 1, learn_episodes=2
    )
    config = {"env": "RunAway-v0", "agent": "sac", "episodes": 2, "settings": SMALL, "stop_at": 1e6}
    study = Study(
        "l",
        "L",
        6,
        6,
        seeds=5,
        cells=lambda _: (Cell("sac", "c", config, (Condition("same", episodes=1), later)),),
    )
    run_study(study, tmp_path, seeds=1, jobs=1)
    cell = json.loads((tmp_path / "study.json").read_text())["cells"][0]
    assert set(cell["conditions"]) == {"same", "later"} and cell["reached"] == [False]
    assert {"action_size", "episode_steps", "largest_pitch_deg"} <= set(
        cell["conditions"]["later"]["metrics"]
    )
    folders = tmp_path / "sac-c"
    lines = [
        len((folders / name / "metrics.csv").read_text().splitlines())
        for name in ("seed-0", "seed-0-condition-1")
    ]
    assert lines == [3, 3]


def test_robot_time_is_hub_time(tmp_path: Path) -> None:
    config = {"agent": "random", "episodes": 2, "settings": None}
    run = train(TrainConfig("Walker-v0", run_dir=tmp_path / "walk", link="mac", **config))
    steps = run.episodes[-1].steps
    assert robot_seconds(tmp_path / "walk") == pytest.approx(0.25 * steps, rel=0.2)
    train(TrainConfig("WalkerSim-v0", run_dir=tmp_path / "sim", **config))
    assert robot_seconds(tmp_path / "sim") is None


def test_studies_match_descriptions() -> None:
    for study in STUDIES:
        whole, quick = study.cells(False), study.cells(True)
        assert study.seeds >= 5 and len(quick) <= len(whole)
        assert len({name_of(cell) for cell in whole}) == len(whole)
        assert all(cell.conditions for cell in (*whole, *quick))
        assert pickle.loads(pickle.dumps(whole)) == whole, "they go to other processes"  # noqa: S301
    assert len(drawn_twins()) == 20 and drawn_twins() == drawn_twins()
    assert Physics() not in OUTSIDE.values()
