"""Runner of studies: trains each cell of a table with several seeds, evaluates, and writes the results.

A study's folder holds a run folder for each cell and seed, so that the same command resumes an interrupted study and repeats no
finished run. ``study.json`` has the numbers, the processor and the versions; ``study.md`` the tables.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from importlib import metadata
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bricksrl.errors import BricksError, RunError
from bricksrl.evaluation.cluster import connected, parse_on
from bricksrl.evaluation.statistics import (
    interquartile_mean,
    mean,
    probability_of_improvement,
    seeds_interval,
    wilson_interval,
)
from bricksrl.evaluation.study_tables import Cell, Study
from bricksrl.files import write_durably

if TYPE_CHECKING:
    from bricksrl.evaluation.evaluator import EvaluationResult
    from bricksrl.training.callbacks import Episode

_PACKAGES = ("bricksrl", "torch", "torchrl", "tensordict", "mujoco", "numpy")
SOLVED_WINDOW = 5

OnSeed = Callable[[str, int, str | None], None]
"""Called with the name of a cell, a seed, and its error or ``None``, when the seed is done."""


@dataclass(frozen=True)
class Judgement:
    """Evaluation of one seed under a condition."""

    condition: str
    returns: tuple[float, ...]
    successes: int | None
    metrics: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """Result of one seed of a cell.

    Attributes:
        steps, wall_s: robot steps and wall time of the training.
        solved_s, solved_episode: time and episode at which the mean of the last five returns first reached 90 % of the way from
            that of the first five to the best one; ``None`` for fewer than ten episodes.
    """

    seed: int
    judged: tuple[Judgement, ...]
    steps: int
    wall_s: float
    solved_s: float | None
    solved_episode: int | None


def name_of(cell: Cell) -> str:
    """Name of a cell's folder."""
    return "".join(char if char.isalnum() or char in "-." else "_" for char in f"{cell.row}-{cell.column}")


def run_seed(cell: Cell, seed: int, folder: str) -> dict[str, Any] | str:
    """Train, or resume, and evaluate one seed; returns its outcome as a dict, or the error as text."""
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training import RunFolder, TrainConfig, resume, train

    path = Path(folder) / f"seed-{seed}"
    done = path / "outcome.json"
    if done.exists():
        found: dict[str, Any] = json.loads(done.read_bytes())
        return found
    try:
        if RunFolder(path).checkpoint_path.exists():
            resume(path)
        else:
            train(TrainConfig(**{**cell.config, "seed": seed, "run_dir": path, "asynchronous": False}))
        judged = [
            _judgement(one.name, evaluate(path, one.env, episodes=one.episodes, save=False, **one.named))
            for one in cell.conditions
        ]
        episodes = RunFolder(path).read_episodes()
        at = solved(episodes)
        outcome = Outcome(
            seed,
            tuple(judged),
            episodes[-1].steps,
            episodes[-1].seconds,
            None if at is None else at.seconds,
            None if at is None else at.episode,
        )
    except BricksError as error:
        return str(error)
    write_durably(done, (json.dumps(asdict(outcome), indent=2) + "\n").encode())
    result: dict[str, Any] = json.loads(done.read_bytes())
    return result


def _judgement(name: str, result: EvaluationResult) -> Judgement:
    successes = None if result.success_rate is None else round(result.success_rate * result.episodes)
    return Judgement(name, result.returns, successes, result.metrics)


def solved(episodes: Sequence[Episode]) -> Episode | None:
    """Episode at which a run reached 90 % of its improvement, as in `Outcome`; ``None`` for fewer than ten episodes."""
    if len(episodes) < 2 * SOLVED_WINDOW:
        return None
    returns = np.array([episode.return_ for episode in episodes])
    means = np.convolve(returns, np.ones(SOLVED_WINDOW) / SOLVED_WINDOW, "valid")
    wanted = means[0] + 0.9 * (means.max() - means[0])
    return episodes[int(np.argmax(means >= wanted)) + SOLVED_WINDOW - 1]


def run_study(
    study: Study,
    folder: Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    jobs: int | None = None,
    on: str | None = None,
    on_seed: OnSeed = lambda *_: None,
) -> Path:
    """Run the missing parts of a study, and write ``study.json`` and ``study.md``; returns the path of the latter.

    Args:
        quick: run the quick form, a smoke test of the study.
        seeds: seeds per cell; by default the study's number, 2 in the quick form.
        jobs: concurrent processes; by default the number of cores.
        on: "ray", or "ray:ADDRESS", with a folder shared by all computers.

    Raises:
        RunError: a seed failed; the others are kept, and the same command resumes.
    """
    cells = study.cells(quick)
    count = seeds or (2 if quick else study.seeds)
    orders = [(cell, seed, str((folder / name_of(cell)).absolute())) for cell in cells for seed in range(count)]
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[dict[str, Any]]] = {name_of(cell): [] for cell in cells}
    errors = []
    for (cell, seed, _), outcome in zip(orders, _made(orders, jobs, on), strict=True):
        error = outcome if isinstance(outcome, str) else None
        on_seed(name_of(cell), seed, error)
        if isinstance(outcome, str):
            errors.append(f"{name_of(cell)} seed {seed}: {outcome}")
        else:
            found[name_of(cell)].append(outcome)
    result = {"study": study.name, "title": study.title, "quick": quick, **_machine(), "cells": []}
    result["cells"] = [summary(cell, found[name_of(cell)]) for cell in cells if found[name_of(cell)]]
    result["improvements"] = improvements(cells, found)
    write_durably(folder / "study.json", (json.dumps(result, indent=2) + "\n").encode())
    write_durably(folder / "study.md", page(result).encode())
    if errors:
        raise RunError(f"{len(errors)} of {len(orders)} runs failed; the first: {errors[0]}")
    return folder / "study.md"


def _made(orders: Sequence[tuple[Cell, int, str]], jobs: int | None, on: str | None) -> Iterable[dict[str, Any] | str]:
    """Outcomes of the orders, in order, each as soon as it is ready."""
    if on is not None:
        with connected(parse_on(on), jobs) as ray:
            remote = ray.remote(run_seed).options(num_cpus=1, max_retries=3)  # single-threaded, by its environment variables
            for job in [remote.remote(*order) for order in orders]:
                yield ray.get(job)
        return
    workers = min(jobs or os.cpu_count() or 1, len(orders))
    if workers == 1:
        yield from (run_seed(*order) for order in orders)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_on_one_thread) as pool:
        yield from pool.map(run_seed, *zip(*orders, strict=True))


def _on_one_thread() -> None:
    import torch

    torch.set_num_threads(1)


def summary(cell: Cell, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of a cell's seeds; conditions of the same name are pooled."""
    names = list(dict.fromkeys(one.name for one in cell.conditions))
    return {
        "row": cell.row,
        "column": cell.column,
        "seeds": len(outcomes),
        "steps": [one["steps"] for one in outcomes],
        "wall_s": [round(one["wall_s"], 1) for one in outcomes],
        "solved_s": [one["solved_s"] for one in outcomes],
        "solved_episode": [one["solved_episode"] for one in outcomes],
        "conditions": {name: _under(name, outcomes) for name in names},
    }


def _under(name: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of one condition: a mean return per seed, and the successes of all episodes."""
    by_seed = [[one for one in outcome["judged"] if one["condition"] == name] for outcome in outcomes]
    returns = [float(np.mean([value for one in judged for value in one["returns"]])) for judged in by_seed]
    interval = seeds_interval(returns)
    found: dict[str, Any] = {
        "returns": returns,
        "return_iqm": float(interquartile_mean(np.array(returns))),
        "return_95": None if interval is None else [interval.low, interval.high],
        "episodes": sum(len(one["returns"]) for judged in by_seed for one in judged),
    }
    successes = [one["successes"] for judged in by_seed for one in judged]
    if all(value is not None for value in successes):
        found |= {"successes": sum(successes), "success_rate": sum(successes) / found["episodes"]}
        if len(outcomes) >= 5:
            rate = wilson_interval(sum(successes), found["episodes"])
            found["success_95"] = [rate.low, rate.high]
    metrics = {name for judged in by_seed for one in judged for name in one["metrics"]}
    found["metrics"] = {
        metric: float(
            mean(np.array([one["metrics"][metric] for judged in by_seed for one in judged if metric in one["metrics"]]))
        )
        for metric in sorted(metrics)
    }
    return found


def improvements(cells: Sequence[Cell], found: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Per column, the probability that a seed of the first row scores more than one of each other row, in the last
    condition."""
    columns: dict[str, list[Cell]] = {}
    for cell in cells:
        columns.setdefault(cell.column, []).append(cell)
    pairs = []
    for column, rows in columns.items():
        scored = {one.row: _under(one.conditions[-1].name, found[name_of(one)])["returns"] for one in rows if found[name_of(one)]}
        for row, scores in list(scored.items())[1:]:
            first, others = next(iter(scored.items()))
            probability, interval = probability_of_improvement(others, scores)
            pairs.append(
                {
                    "column": column,
                    "row": first,
                    "over": row,
                    "probability": probability,
                    "probability_95": None if interval is None else [interval.low, interval.high],
                }
            )
    return pairs


def page(result: dict[str, Any]) -> str:
    """Markdown page with a table row for each cell and condition."""
    quick = " (quick form: it shows that everything works, and says nothing about learning)" if result["quick"] else ""
    lines = [
        f"# {result['title']}{quick}",
        "",
        f"Written by `bricksrl study {result['study']}`. Square brackets are 95 % intervals;",
    ]
    lines += ["nothing of fewer than 5 seeds has one. All robots are virtual.", ""]
    lines += ["| row | column | seeds | condition | return (IQM) | success | minutes | minutes to 90 % |"]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for cell in result["cells"]:
        solved_s = [value for value in cell["solved_s"] if value is not None]
        minutes = f"{float(interquartile_mean(np.array(solved_s))) / 60:.1f}" if len(solved_s) == cell["seeds"] else ""
        wall = f"{float(interquartile_mean(np.array(cell['wall_s']))) / 60:.1f}"
        for name, one in cell["conditions"].items():
            rate = "" if "success_rate" not in one else f"{100 * one['success_rate']:.0f} %{_within(one.get('success_95'), 100)}"
            shown = f"{one['return_iqm']:.4g}{_within(one['return_95'])}"
            lines.append(
                f"| {cell['row']} | {cell['column']} | {cell['seeds']} | {name} | {shown} | {rate} | {wall} | {minutes} |"
            )
    if result["improvements"]:
        lines += ["", "| column | row | over | probability of improvement |", "|---|---|---|---|"]
        for one in result["improvements"]:
            lines.append(
                f"| {one['column']} | {one['row']} | {one['over']} | {one['probability']:.2f}{_within(one['probability_95'])} |"
            )
    machine, versions = result["machine"], result["versions"]
    lines += ["", f"{machine['processor']}, {machine['cores']} cores; " + ", ".join(f"{k} {v}" for k, v in versions.items())]
    return "\n".join(lines) + "\n"


def _within(interval: Sequence[float] | None, factor: float = 1.0) -> str:
    return "" if interval is None else f" [{factor * interval[0]:.3g}, {factor * interval[1]:.3g}]"


def _machine() -> dict[str, Any]:
    versions = {"python": platform.python_version(), **{name: metadata.version(name) for name in _PACKAGES}}
    processor = platform.processor()
    try:
        names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        processor = names[0].partition(":")[2].strip() if names else processor
    except OSError:
        pass
    return {"machine": {"processor": processor, "cores": os.cpu_count(), "system": platform.system()}, "versions": versions}
