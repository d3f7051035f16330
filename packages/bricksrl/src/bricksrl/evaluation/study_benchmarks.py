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

from brickhub.files import writing
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
    def result_name(self) -> str:
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


def run_benchmark_study(study: BenchmarkStudy, folder: Path, benchmarks: Path, *, quick: bool = False) -> Path:
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
        path = results / f"{script.result_name}.json"
        if quick and script.quick is None:
            continue
        if quick or not path.exists():
            _measure(benchmarks / f"{script.name}.py", (script.quick or ()) if quick else script.arguments, folder, results)
    return write_study(folder, result_of(study, results, quick=quick))


def result_of(study: BenchmarkStudy, results: Path, *, quick: bool = False) -> Numbers:
    """Numbers of a study from the results in a folder; missing results are skipped. Raises RunError if one is damaged."""
    paths = {script.result_name: results / f"{script.result_name}.json" for script in study.scripts}
    numbers = {name: _read_result(path) for name, path in paths.items() if path.exists()}
    measured_with = {name: {key: result[key] for key in ("machine", "versions")} for name, result in numbers.items()}
    about = {"study": study.name, "title": study.title, "quick": quick, "results": measured_with}
    tables = study.tables(numbers)
    notes = (f"{name}: {result['note']}" for name, result in numbers.items() if "note" in result)
    tables["notes"] = [*tables.get("notes", ()), *notes]
    return {**about, **measured_with[next(iter(numbers))], **tables}


def _read_result(path: Path) -> Numbers:
    try:
        result = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        result = None
    if not isinstance(result, dict) or not result.keys() >= {"machine", "versions"}:
        raise RunError(f"{path} is not the result of a benchmark; delete it, and the same command measures it again")
    return result


def _measure(script: Path, arguments: tuple[str, ...], folder: Path, results: Path) -> None:
    """Run a benchmark in the study's folder, which keeps its runs and datasets, so that it can resume."""
    for path in (folder, results):
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
    variables = {**os.environ, "BRICKSRL_RESULTS": str(results.absolute())}
    command = [sys.executable, str(script.absolute()), *arguments]
    process = subprocess.run(command, cwd=folder, env=variables, check=False, capture_output=True, text=True)  # noqa: S603  ours
    if process.returncode:
        reason = process.stderr.strip().splitlines()[-1:] or [f"it ended with code {process.returncode}"]
        raise RunError(f"{script.name} failed: {reason[0]}; mend that, and the same command goes on")


def _cell(row: str, column: str, condition: str, returns: list[float], paper_numbers: Numbers, **numbers: Any) -> Numbers:
    return {
        "row": row,
        "column": column,
        "seeds": len(returns),
        "conditions": {condition: {**over_seeds(returns), **numbers}},
        "paper": paper_numbers,
    }


def _offline(results: dict[str, Numbers]) -> Numbers:
    """Cells of agents by dataset, with the paper's and with the default settings."""
    cells = []
    for result in results.values():
        if "preset" not in result:
            continue
        for data, agents in result["datasets"].items():
            env, kind = data.rsplit(" ", 1)
            for agent, outcome in agents.items():
                value = paper.OFFLINE[env, kind].get(agent)
                paper_numbers = {} if value is None else {"return": value}
                cells.append(_cell(agent, data, f"{result['preset']} settings", outcome["seeds"], paper_numbers))
    return {"cells": cells, "heads": ("agent", "dataset")}


def _datasets(results: dict[str, Numbers]) -> Numbers:
    cells = []
    for env, kinds in results["datasets"]["tasks"].items():
        paper_numbers = paper.DATASETS[env]
        for kind in ("expert", "random"):
            dataset = kinds[kind]
            returns = {"return": paper_numbers["mean_reward"]} if kind == "expert" else {}
            metrics = {"transitions": dataset["transitions"], "the paper's transitions": paper_numbers[f"{kind}_transitions"]}
            cells.append(_cell(kind, env, f"{dataset['episodes']} episodes", [dataset["mean_reward"]], returns, metrics=metrics))
    notes = ["One dataset of each kind: no interval over seeds."]
    shown = ["transitions", "the paper's transitions"]
    return {"cells": cells, "heads": ("policy", "environment"), "metrics": shown, "notes": notes}


def _ablation(results: dict[str, Numbers]) -> Numbers:
    cells = []
    for env, agents in results["ablation"]["environments"].items():
        for agent, result in agents.items():
            for name, variant in result["variants"].items():
                label = name if name in ("default", "paper") else f"{name} = {variant['setting'][name]}"
                column = f"{env}, {result['steps']} steps"
                success = variant["success_mean"]
                numbers = {} if success is None or env.startswith("Walker") else {"success_rate": success}
                cells.append(_cell(f"{agent}, {label}", column, "default", variant["returns"], {}, **numbers))
    tables = [_costs(results["updates"])] if "updates" in results else []
    notes: list[str] = []
    if "race" in results:
        tables.append(_race(results["race"]))
    else:
        notes = ["CPU seconds to a goal against Stable-Baselines3 and SBX: `benchmarks/race.py` was not run."]
    return {"cells": cells, "heads": ("settings", "environment"), "tables": tables, "notes": notes}


def _costs(result: Numbers) -> Numbers:
    """Table of the CPU time of an update, by agent and library."""
    peers = list(dict.fromkeys(peer for costs in result["agents"].values() for peer in costs))
    rows = [
        [agent, *(f"{costs[peer]['cpu_ms']:.2f}" if peer in costs else "" for peer in peers)]
        for agent, costs in result["agents"].items()
    ]
    return {"title": "CPU milliseconds per update", "head": ["agent", *peers], "rows": rows}


def _race(result: Numbers) -> Numbers:
    """Table of robot steps and CPU time to a goal: medians over the seeds."""
    rows = [
        [name, f"{contestant['there']} of {len(contestant['runs'])}", f"{contestant['steps']:.0f}", f"{contestant['cpu_s']:.0f}"]
        for name, contestant in result["contestants"].items()
    ]
    return {"title": "To the goal on WalkerSim-v0, medians", "head": ["contestant", "reached", "steps", "CPU s"], "rows": rows}


_QUICK_DATASETS = ("--tasks", "RunAway-v0", "--episodes", "2", "--trained", "2", "--processes", "1")
_DATASETS = Script("datasets", (), _QUICK_DATASETS)
_QUICK_OFFLINE = ("--envs", "RunAway-v0", "--agents", "bc", "iql", "--share", "0.01", "--seeds", "2", "--processes", "1")
_QUICK_ABLATION = ("--envs", "RoboArmSim-v0", "--only", "default", "--steps", "100", "--seeds", "2", "--processes", "1")
BENCHMARK_STUDIES = {
    study.name: study
    for study in (
        BenchmarkStudy(
            "offline",
            "Agents that learn from datasets alone",
            40.0,
            2.0,
            (
                _DATASETS,
                Script("offline", (), _QUICK_OFFLINE),
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
                Script("ablation", (), _QUICK_ABLATION),
                Script("updates", (), ("--agents", "sac", "--rounds", "1", "--contestants", "torchrl")),
                Script("race", (), ("--contestants", "ours_sac", "--seeds", "1", "--limit", "200")),
            ),
            _ablation,
        ),
    )
}
"""By name."""
