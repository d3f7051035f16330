"""Studies: a table of trainings with several seeds, which goes on where it was interrupted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bricksrl.agents.sac import SACSettings
from bricksrl.errors import RunError, UnknownNameError
from bricksrl.evaluation.statistics import (
    interquartile_mean,
    seeds_interval,
)
from bricksrl.evaluation.study import name_of, run_study, solved, summary
from bricksrl.evaluation.study_tables import OUTSIDE, STUDIES, Cell, Condition, Study, drawn_twins, get_study
from bricksrl.training import Episode, Phase
from bricksrl.twin.physics import Physics

SMALL = SACSettings(hidden=(8,), batch_size=8, updates_per_step=0.1)
AFTER = (Condition("same", episodes=2), Condition("twin", "Walker-v0", {"physics": Physics(friction_scale=0.8)}, 1))


def cells(quick: bool) -> tuple[Cell, ...]:
    agents = {"sac": SMALL, "random": None}
    return tuple(
        Cell(agent, "WalkerSim-v0", {"env": "WalkerSim-v0", "agent": agent, "episodes": 2, "settings": settings}, AFTER)
        for agent, settings in agents.items()
    )


TOY = Study("toy", "A toy", 0.1, 0.1, 5, cells)


def test_a_study_writes_its_tables_and_makes_nothing_twice(tmp_path: Path) -> None:
    page = run_study(TOY, tmp_path / "toy", quick=True, jobs=1)
    result = json.loads((tmp_path / "toy" / "study.json").read_text())
    assert [cell["row"] for cell in result["cells"]] == ["sac", "random"]
    found = result["cells"][0]["conditions"]
    assert found["same"]["episodes"] == 4 and found["twin"]["episodes"] == 2
    assert found["same"]["return_95"] is None and result["improvements"][0]["probability_95"] is None
    assert {"processor", "cores", "system"} == set(result["machine"]) and "torch" in result["versions"]
    assert "| sac | WalkerSim-v0 | 2 | same |" in page.read_text()
    folder = tmp_path / "toy" / name_of(cells(True)[0]) / "seed-0"
    untouched = folder.with_name("seed-1") / "outcome.json"
    before = untouched.stat().st_mtime_ns
    (folder / "outcome.json").unlink()  # as if it was killed before it had evaluated
    run_study(TOY, tmp_path / "toy", quick=True, jobs=1)
    assert json.loads((tmp_path / "toy" / "study.json").read_text())["cells"] == result["cells"]
    assert untouched.stat().st_mtime_ns == before
    assert len((folder / "metrics.csv").read_text().splitlines()) == 3, "the run was not made again, only evaluated"


def test_a_seed_that_fails_is_told_and_the_others_are_kept(tmp_path: Path) -> None:
    def broken(quick: bool) -> tuple[Cell, ...]:
        return (cells(quick)[1], Cell("none", "Nowhere-v0", {"env": "Nowhere-v0", "settings": SMALL}, AFTER))

    with pytest.raises(RunError, match="2 of 4 runs failed; the first: none-Nowhere-v0 seed 0: there is no environment"):
        run_study(Study("b", "B", 0.1, 0.1, 2, broken), tmp_path / "b", jobs=1)
    assert len(json.loads((tmp_path / "b" / "study.json").read_text())["cells"]) == 1


def outcome(seed: int, returns: list[float], successes: int | None) -> dict:
    judged = {"condition": "same", "returns": returns, "successes": successes, "metrics": {"x_m": seed}}
    return {"seed": seed, "judged": [judged], "steps": 10, "wall_s": 1.0, "solved_s": None, "solved_episode": None}


def test_intervals_are_given_from_five_seeds_on() -> None:
    cell = Cell("r", "c", {}, (Condition("same"),))
    few = summary(cell, [outcome(seed, [seed, seed + 1], 1) for seed in range(4)])["conditions"]["same"]
    assert few["return_95"] is None and "success_95" not in few and few["success_rate"] == 0.5
    many = summary(cell, [outcome(seed, [seed, seed + 1], 1) for seed in range(5)])["conditions"]["same"]
    assert many["return_iqm"] == 2.5 and many["return_95"][0] < 2.5 < many["return_95"][1]
    assert many["success_95"] == pytest.approx([0.237, 0.763], abs=1e-3)
    assert many["metrics"] == {"x_m": 2.0}


def test_no_interval_of_fewer_than_five() -> None:
    assert seeds_interval([1.0, 2.0, 3.0, 4.0]) is None
    interval = seeds_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert interval is not None and interval.low < interquartile_mean(np.arange(1.0, 6.0)) < interval.high


def test_a_run_is_solved_where_it_has_nine_tenths_of_what_it_gains() -> None:
    returns = [0.0] * 5 + [10.0] * 10
    episodes = [Episode(k + 1, Phase.TRAIN, 10 * k, 10, value, None, seconds=float(k)) for k, value in enumerate(returns)]
    found = solved(episodes)
    assert found is not None and found.episode == 10
    assert solved(episodes[:9]) is None


def test_the_studies_are_what_they_say() -> None:
    for study in STUDIES.values():
        whole, quick = study.cells(False), study.cells(True)
        assert study.seeds >= 5 and len(quick) <= len(whole)
        assert len({name_of(cell) for cell in whole}) == len(whole)
        assert all(cell.conditions for cell in (*whole, *quick))
    assert len(drawn_twins()) == 20 and drawn_twins() == drawn_twins()
    assert Physics() not in OUTSIDE.values()
    with pytest.raises(UnknownNameError, match="no study 'x'; choose agents"):
        get_study("x")
