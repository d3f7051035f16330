"""Runner of studies: trains each cell of a table with several seeds, evaluates, and writes the
results.

The folder of a study holds a run folder for each cell and seed, so that the same command resumes an
interrupted study and repeats no finished run. Its ``study.json`` has the numbers, the processor and
the versions; its ``study.md`` the tables. Both are written after every seed, of all that is in the
folder.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.machine import describe
from benchmarks.parts import Failure, kept, outcomes
from benchmarks.session import Session, write_result
from benchmarks.study_page import page
from benchmarks.study_tables import Cell, Condition, Study
from brickhub.files import write_durably
from bricksrl.cli.terminal import load_learning
from bricksrl.errors import DataError, RunError
from bricksrl.evaluation.multi_seed import connected, parse_on
from bricksrl.evaluation.statistics import (
    ends,
    interquartile_mean,
    probability_of_improvement,
    seeds_interval,
    wilson_interval,
)

if TYPE_CHECKING:
    from bricksrl.training import RunResult
    from bricksrl.training.callbacks import Episode

OUTCOME = "outcome.json"
"""File with the outcome of a seed: steps, wall time and CPU time (null if resumed) of its training;
the time of its steps by the hub's clock (null without a hub); whether it reached its ``stop_at``
return (null without one); the results of the conditions."""
_FIRST_EVALUATION = 1000
"""Seed of the evaluation of seed 0. Each seed has episodes of its own, so that intervals over seeds
cover their chance too."""
OnSeed = Callable[[str, int, str | None], None]
"""Called with the name of a cell, a seed, and its error or ``None``, when the seed is done."""


def name_of(cell: Cell) -> str:
    """Name of a cell's folder."""
    return "".join(
        char if char.isalnum() or char in "-." else "_" for char in f"{cell.row}-{cell.column}"
    )


def main(session: Session) -> None:
    """Run a study from the command line."""
    study = session.benchmark
    assert isinstance(study, Study)
    session.parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="seeds per cell (default: the study's, 2 in the quick form)",
    )
    session.parser.add_argument(
        "--on",
        metavar="WHERE",
        help="ray, or ray:ADDRESS for a cluster whose computers share the folder",
    )
    session.parser.add_argument(
        "--only",
        nargs="+",
        default=(),
        metavar="PATTERN",
        help="only cells of these names, e.g. 'td3-*'",
    )
    args = session.parse()
    if args.seeds is not None and args.seeds < 1:
        raise RunError(f"seeds is {args.seeds}; give 1 or more")
    if args.on is not None:
        parse_on(args.on)
    if session.is_again:
        raise RunError(f"a study keeps its runs; remove {session.folder}, or choose another folder")
    load_learning()

    def report(cell: str, seed: int, error: str | None) -> None:
        print(f"{cell}  seed {seed}  {'done' if error is None else f'failed: {error}'}", flush=True)

    options = {"seeds": args.seeds, "jobs": session.jobs, "on": args.on, "only": args.only}
    written = run_study(study, session.folder, quick=session.is_quick, on_seed=report, **options)
    print(f"tables   {written}")
    session.write(json.loads(written.with_suffix(".json").read_text(encoding="utf-8")))


def run_seed(cell: Cell, seed: int, path: Path) -> dict[str, Any]:
    """Train and evaluate one seed in the folder ``path``, or resume it; returns its outcome."""
    from bricksrl.agents import preset
    from bricksrl.training import RunFolder, TrainConfig, resume, train
    from bricksrl.training.callbacks import WINDOW

    config = dict(cell.config)
    if name := config.pop("preset", None):
        config["settings"] = preset(name, config["agent"], images="mixed" in config["env"])
    cpu_s = None
    if RunFolder(path).checkpoint_path.exists():
        _check_whole(resume(path))
    else:
        before_s = _cpu_s()
        _check_whole(
            train(TrainConfig(**{**config, "seed": seed, "run_dir": path, "asynchronous": False}))
        )
        cpu_s = _cpu_s() - before_s
    results = [
        _evaluate_condition(path, seed, number, condition)
        for number, condition in enumerate(cell.conditions)
    ]
    episodes = RunFolder(path).read_episodes()
    goal, last = cell.config.get("stop_at"), [episode.return_ for episode in episodes[-WINDOW:]]
    reached = None if goal is None else len(last) == WINDOW and sum(last) / WINDOW >= goal
    return {
        "seed": seed,
        "judged": results,
        "steps": episodes[-1].steps,
        "wall_s": episodes[-1].seconds,
        "cpu_s": cpu_s,
        "robot_s": robot_seconds(path),
        "reached": reached,
        "curve": _curve(episodes),
    }


def _curve(episodes: Sequence[Episode]) -> dict[str, list[float]]:
    """Return, steps and the task's metrics of each training episode, with four digits; metrics only
    if all have them."""
    named = [episode.measures for episode in episodes if not episode.link_lost]
    names = [name for name in named[0] if all(name in measures for measures in named)]
    rows = [
        {"return": one.return_, "episode_steps": one.length, **one.measures}
        for one in episodes
        if not one.link_lost
    ]
    return {
        name: [float(f"{row[name]:.4g}") for row in rows]
        for name in ("return", "episode_steps", *names)
    }


def _check_whole(result: RunResult) -> None:
    """Raise KeyboardInterrupt after a training that Ctrl-C has ended: it is resumed later, and has
    no outcome yet."""
    if result.interrupted:
        raise KeyboardInterrupt


def _cpu_s() -> float:
    """CPU time of this process, with its threads and its ended children."""
    return sum(os.times()[:4])


def _evaluate_condition(run: Path, seed: int, number: int, condition: Condition) -> dict[str, Any]:
    """Evaluate a run under a condition, after further training there if the condition asks for
    it."""
    from bricksrl.evaluation import evaluate
    from bricksrl.training import RunFolder, TrainConfig, train

    run_dir = run
    if condition.learn_episodes:
        run_dir = run.with_name(f"{run.name}-condition-{number}")
        shutil.rmtree(run_dir, ignore_errors=True)  # left by an interrupted study
        config = RunFolder(run).read_config()
        base = {
            "agent": config.agent,
            "settings": config.settings,
            "start": str(run),
            "seed": seed,
            "run_dir": run_dir,
        }
        options = {
            **base,
            "episodes": condition.learn_episodes,
            "asynchronous": False,
            **condition.named,
        }
        _check_whole(train(TrainConfig(condition.env or config.env, **options)))
    options = {
        "episodes": condition.episodes,
        "seed": _FIRST_EVALUATION + seed,
        "save": False,
        **condition.named,
    }
    result = evaluate(run_dir, condition.env, **options)
    successes = (
        None if result.success_rate is None else round(result.success_rate * result.episodes)
    )
    metrics = {
        **result.metrics,
        "action_size": result.action_size,
        "episode_steps": float(np.mean(result.lengths)),
    }
    return {
        "condition": condition.name,
        "returns": result.returns,
        "successes": successes,
        "metrics": metrics,
    }


def robot_seconds(run: Path) -> float | None:
    """Time of a run's recorded steps by the hub's clock; ``None`` without a hub or a recording."""
    from bricksrl.data.reader import load

    try:
        data = load(run / "data", images=False)
    except DataError:
        return None
    total_s = 0.0
    for number in data.episode.unique():
        times_s = data.hub_time_s[data.episode == number]
        # times start at the end of the first step, whose duration is taken as the mean of the
        # others
        if len(times_s) > 1:
            total_s += float(times_s[-1] - times_s[0]) * len(times_s) / (len(times_s) - 1)
    return total_s if np.isfinite(total_s) else None


def run_study(
    study: Study,
    folder: Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    jobs: int | None = None,
    on: str | None = None,
    only: Sequence[str] = (),
    on_seed: OnSeed = lambda *_: None,
) -> Path:
    """Run the missing parts of a study, and write ``study.json`` and ``study.md``; returns the path
    of the latter. Raises RunError if no cell was chosen, there is no such cluster, the folder is of
    another study, or a seed failed; the others are kept, and the same command resumes.

    Args:
        quick: run the quick form, a smoke test of the study.
        only: shell patterns of names of cells; by default all cells.
        seeds: seeds per cell; by default the study's number, 2 in the quick form.
        jobs: concurrent processes; by default the number of cores.
        on: "ray", or "ray:ADDRESS", with a folder shared by all computers.
    """
    cells = study.cells(quick)
    chosen = [
        cell
        for cell in cells
        if not only or any(fnmatchcase(name_of(cell), pattern) for pattern in only)
    ]
    if not chosen:
        raise RunError(
            f"no cell of '{study.name}' matches {', '.join(only)}; choose from "
            f"{', '.join(map(name_of, cells))}"
        )
    _check_folder(folder, study, quick=quick)
    count = seeds or (2 if quick else study.seeds)
    runs = {
        (folder / name_of(cell) / f"seed-{seed}").absolute(): (cell, seed)
        for cell in chosen
        for seed in range(count)
    }
    parts = {path / OUTCOME: (*run, path) for path, run in runs.items()}
    errors = []
    with nullcontext() if on is None else connected(parse_on(on), jobs) as ray:
        # marks the folder before it has any run
        written = write_study(folder, _result(study, cells, folder, quick=quick))
        for (cell, seed), outcome in zip(
            runs.values(), outcomes(run_seed, parts, jobs, resumable=True, ray=ray), strict=True
        ):
            error = outcome if isinstance(outcome, Failure) else None
            on_seed(name_of(cell), seed, error)
            if error is not None:
                errors.append(f"{name_of(cell)} seed {seed}: {error}")
            written = write_study(folder, _result(study, cells, folder, quick=quick))
    if errors:
        raise RunError(f"{len(errors)} of {len(runs)} runs failed; the first: {errors[0]}")
    return written


def _check_folder(folder: Path, study: Study, *, quick: bool) -> None:
    """Raise RunError if the folder is of another study, or of its other form."""
    try:
        data = json.loads((folder / "study.json").read_bytes())
        existing = (str(data["study"]), bool(data["quick"]))
    except (OSError, ValueError, LookupError, TypeError):
        return  # nothing is there that its runs could be mistaken for
    if existing != (study.name, quick):
        form = "in quick form" if existing[1] else "in full"
        raise RunError(f"{folder} has the study '{existing[0]}' {form}; choose another folder")


def _result(study: Study, cells: Sequence[Cell], folder: Path, *, quick: bool) -> dict[str, Any]:
    """Numbers of a study, of all seeds that are done."""
    paths_of = {name_of(cell): (folder / name_of(cell)).glob(f"seed-*/{OUTCOME}") for cell in cells}
    done = {
        name: [outcome for path in paths if (outcome := kept(path))]
        for name, paths in paths_of.items()
    }
    outcomes_of = {
        name: sorted(found, key=lambda outcome: outcome["seed"]) for name, found in done.items()
    }
    result = {
        "study": study.name,
        "title": study.title,
        "quick": quick,
        "heads": study.heads,
        "metrics": study.metrics,
    }
    result |= describe()
    result["cells"] = [
        summary(cell, outcomes_of[name_of(cell)]) for cell in cells if outcomes_of[name_of(cell)]
    ]
    result["improvements"] = improvements(cells, outcomes_of)
    missing = [name for name, outcomes in outcomes_of.items() if not outcomes]
    missing_note = f"Not run: {', '.join(missing)}." if missing else ""
    result["notes"] = [note for note in (study.note, missing_note) if note]
    return result


def write_study(folder: Path, result: dict[str, Any]) -> Path:
    """Write the numbers of a study and its page; returns the path of the page."""
    write_result(folder / "study.json", result)
    write_durably(folder / "study.md", page(result).encode())
    return folder / "study.md"


def summary(cell: Cell, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of a cell's seeds; conditions of the same name are pooled."""
    names = list(dict.fromkeys(condition.name for condition in cell.conditions))
    return {
        "row": cell.row,
        "column": cell.column,
        "settings": cell.config.get("preset", "default"),
        "seeds": len(outcomes),
        "steps": [outcome["steps"] for outcome in outcomes],
        "wall_s": [round(outcome["wall_s"], 1) for outcome in outcomes],
        "cpu_s": [outcome.get("cpu_s") for outcome in outcomes],
        "robot_s": [outcome["robot_s"] for outcome in outcomes],
        "reached": [outcome["reached"] for outcome in outcomes],
        "curves": [outcome.get("curve", {}) for outcome in outcomes],
        "paper": dict(cell.paper),
        "conditions": {name: _condition_summary(name, outcomes) for name in names},
    }


def _condition_summary(name: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of one condition: a mean return per seed, and the successes of all episodes."""
    by_seed = [
        [item for item in outcome["judged"] if item["condition"] == name] for outcome in outcomes
    ]
    returns = [
        float(np.mean([value for item in results for value in item["returns"]]))
        for results in by_seed
    ]
    result: dict[str, Any] = {
        "returns": returns,
        "return_iqm": float(interquartile_mean(np.array(returns))),
    }
    result["return_95"] = ends(seeds_interval(returns))
    result["episodes"] = sum(len(item["returns"]) for results in by_seed for item in results)
    successes = [item["successes"] for results in by_seed for item in results]
    if all(value is not None for value in successes):
        result |= {"successes": sum(successes), "success_rate": sum(successes) / result["episodes"]}
        if len(outcomes) >= 5:
            result["success_95"] = ends(wilson_interval(sum(successes), result["episodes"]))
    metrics = {name for results in by_seed for item in results for name in item["metrics"]}
    result["metrics"] = {
        metric: float(
            np.mean(
                [
                    item["metrics"][metric]
                    for results in by_seed
                    for item in results
                    if metric in item["metrics"]
                ]
            )
        )
        for metric in sorted(metrics)
    }
    return result


def improvements(
    cells: Sequence[Cell], outcomes_of: dict[str, list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Probability, per column, that a seed of the first row outscores one of each other row in the
    last condition."""
    columns: dict[str, list[Cell]] = {}
    for cell in cells:
        columns.setdefault(cell.column, []).append(cell)
    pairs = []
    for column, rows in columns.items():
        finished = [
            (cell, outcomes_of[name_of(cell)]) for cell in rows if outcomes_of[name_of(cell)]
        ]
        scored = {
            cell.row: _condition_summary(cell.conditions[-1].name, done)["returns"]
            for cell, done in finished
        }
        for row, scores in list(scored.items())[1:]:
            first, others = next(iter(scored.items()))
            probability, interval = probability_of_improvement(others, scores)
            pair = {"column": column, "row": first, "over": row}
            pairs.append({**pair, "probability": probability, "probability_95": ends(interval)})
    return pairs
