"""Studies made of the repository's benchmarks: existing results are read, missing ones are measured."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bricksrl.errors import RunError
from bricksrl.evaluation import paper
from bricksrl.evaluation.study import over_seeds, write_study

Numbers = dict[str, Any]


@dataclass(frozen=True)
class Script:
    """Benchmark script and its arguments.

    Attributes:
        name: name of the script, and by default of its result.
        result: name of its result, if it differs from the script's.
        quick: arguments of its quick form; ``None`` if it is not part of the quick study.
    """

    name: str
    arguments: tuple[str, ...] = ()
    quick: tuple[str, ...] | None = None
    result: str = ""

    @property
    def written(self) -> str:
        """Name of its result."""
        return self.result or self.name


@dataclass(frozen=True)
class BenchmarkStudy:
    """Study whose tables are made of benchmark results.

    Attributes:
        hours, quick_minutes: approximate duration of all measurements on two cores.
        scripts: benchmarks, each after those that it depends on.
        tables: maps the results by name to ``cells``, ``tables`` and ``notes`` of a study.
    """

    name: str
    title: str
    hours: float
    quick_minutes: float
    scripts: tuple[Script, ...]
    tables: Callable[[dict[str, Numbers]], Numbers]


def take_study(study: BenchmarkStudy, folder: Path, benchmarks: Path, *, quick: bool = False) -> Path:
    """Write the numbers and the page of a study from benchmark results; returns the path of the page. Raises RunError if there
    are no benchmarks in the folder, or one of them failed.

    Args:
        benchmarks: the repository's folder of benchmark scripts, with its subfolder ``results``. Missing results are measured;
            the quick form measures everything, and writes it to the study's folder.
    """
    if not (benchmarks / "machine.py").exists():
        raise RunError(f"the study '{study.name}' needs the repository's benchmarks, and {benchmarks} has none; run it there")
    results = folder / "results" if quick else benchmarks / "results"
    for script in study.scripts:
        path = results / f"{script.written}.json"
        if quick and script.quick is None:
            continue
        if quick or not path.exists():
            _measure(benchmarks / f"{script.name}.py", (script.quick or ()) if quick else script.arguments, folder, results)
    return write_study(folder, result_of(study, results, quick=quick))


def result_of(study: BenchmarkStudy, results: Path, *, quick: bool = False) -> Numbers:
    """Numbers of a study from the results in a folder; missing results are skipped."""
    paths = {script.written: results / f"{script.written}.json" for script in study.scripts}
    found = {name: json.loads(path.read_bytes()) for name, path in paths.items() if path.exists()}
    measured_with = {name: {what: one[what] for what in ("machine", "versions")} for name, one in found.items()}
    about = {"study": study.name, "title": study.title, "quick": quick, "results": measured_with}
    tables = study.tables(found)
    tables["notes"] = [*tables.get("notes", ()), *(f"{name}: {one['note']}" for name, one in found.items() if "note" in one)]
    return {**about, **measured_with[next(iter(found))], **tables}


def _measure(script: Path, arguments: tuple[str, ...], folder: Path, results: Path) -> None:
    """Run a benchmark in the study's folder, which keeps its runs and datasets, so that it can resume."""
    for one in (folder, results):
        one.mkdir(parents=True, exist_ok=True)
    variables = {**os.environ, "BRICKSRL_RESULTS": str(results.absolute())}
    command = [sys.executable, str(script.absolute()), *arguments]
    done = subprocess.run(command, cwd=folder, env=variables, check=False, capture_output=True, text=True)  # noqa: S603  ours
    if done.returncode:
        why = done.stderr.strip().splitlines()[-1:] or [f"it ended with code {done.returncode}"]
        raise RunError(f"{script.name} failed: {why[0]}")


def _cell(row: str, column: str, condition: str, returns: list[float], theirs: Numbers, **more: Any) -> Numbers:
    return {
        "row": row,
        "column": column,
        "seeds": len(returns),
        "conditions": {condition: {**over_seeds(returns), **more}},
        "paper": theirs,
    }


def _offline(found: dict[str, Numbers]) -> Numbers:
    """Cells of agents by dataset, with the paper's and with the default settings."""
    cells = []
    for result in found.values():
        if "preset" not in result:
            continue
        for data, agents in result["datasets"].items():
            env, kind = data.rsplit(" ", 1)
            for agent, one in agents.items():
                value = paper.OFFLINE[env, kind].get(agent)
                theirs = {} if value is None else {"return": value}
                cells.append(_cell(agent, data, f"{result['preset']} settings", one["seeds"], theirs))
    return {"cells": cells}


def _datasets(found: dict[str, Numbers]) -> Numbers:
    cells = []
    for env, kinds in found["datasets"]["tasks"].items():
        theirs = paper.DATASETS[env]
        for kind in ("expert", "random"):
            one = kinds[kind]
            returns = {"return": theirs["mean_reward"]} if kind == "expert" else {}
            metrics = {"transitions": one["transitions"], "the paper's transitions": theirs[f"{kind}_transitions"]}
            cells.append(_cell(kind, env, f"{one['episodes']} episodes", [one["mean_reward"]], returns, metrics=metrics))
    notes = ["One dataset of each kind: no interval over seeds."]
    return {"cells": cells, "metrics": ["transitions", "the paper's transitions"], "notes": notes}


def _ablation(found: dict[str, Numbers]) -> Numbers:
    cells = []
    for env, agents in found["ablation"]["environments"].items():
        for agent, result in agents.items():
            for name, one in result["variants"].items():
                label = name if name in ("default", "paper") else f"{name} = {one['setting'][name]}"
                after = f"{result['steps']} steps"
                more = {} if one["success_mean"] is None or env.startswith("Walker") else {"success_rate": one["success_mean"]}
                cells.append(_cell(f"{agent}, {label}", env, after, one["returns"], {}, **more))
    tables = [_costs(found["updates"])] if "updates" in found else []
    if "race" in found:
        tables.append(_race(found["race"]))
    missing = (
        [] if "race" in found else ["CPU seconds to a goal against Stable-Baselines3 and SBX: `benchmarks/race.py` was not run."]
    )
    return {"cells": cells, "tables": tables, "notes": missing}


def _costs(result: Numbers) -> Numbers:
    """Table of the CPU time of an update, by agent and library."""
    peers = list(dict.fromkeys(peer for one in result["agents"].values() for peer in one))
    rows = [
        [agent, *(f"{one[peer]['cpu_ms']:.2f}" if peer in one else "" for peer in peers)]
        for agent, one in result["agents"].items()
    ]
    return {"title": "CPU milliseconds per update", "head": ["agent", *peers], "rows": rows}


def _race(result: Numbers) -> Numbers:
    """Table of robot steps and CPU time to a goal: medians over the seeds."""
    rows = [
        [name, f"{one['there']} of {len(one['runs'])}", f"{one['steps']:.0f}", f"{one['cpu_s']:.0f}"]
        for name, one in result["contestants"].items()
    ]
    return {"title": "To the goal on WalkerSim-v0, medians", "head": ["contestant", "reached", "steps", "CPU s"], "rows": rows}


_FEW = ("--tasks", "RunAway-v0", "--episodes", "2", "--trained", "2", "--processes", "1")
_DATASETS = Script("datasets", (), _FEW)
_LITTLE = ("--envs", "RunAway-v0", "--agents", "bc", "iql", "--share", "0.01", "--seeds", "2", "--processes", "1")
_ONE_VARIANT = ("--envs", "RoboArmSim-v0", "--only", "default", "--steps", "100", "--seeds", "2", "--processes", "1")
BENCHMARK_STUDIES = {
    one.name: one
    for one in (
        BenchmarkStudy(
            "offline",
            "Agents that learn from datasets alone",
            40.0,
            2.0,
            (
                _DATASETS,
                Script("offline", (), _LITTLE),
                Script("offline", ("--preset", "default"), result="offline_default"),
            ),
            _offline,
        ),
        BenchmarkStudy("datasets", "Datasets of 100 episodes", 1.0, 1.0, (_DATASETS,), _datasets),
        BenchmarkStudy(
            "ablation",
            "Ablation of the default settings, and the cost of an update",
            3.0,
            3.0,
            (
                Script("ablation", (), _ONE_VARIANT),
                Script("updates", (), ("--agents", "sac", "--rounds", "1", "--contestants", "torchrl")),
                Script("race", (), ("--contestants", "ours_sac", "--seeds", "1", "--limit", "200")),
            ),
            _ablation,
        ),
    )
}
"""By name."""
