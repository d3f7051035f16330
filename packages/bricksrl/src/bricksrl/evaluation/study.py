"""Runner of studies: trains each cell of a table with several seeds, evaluates, and writes the results.

A study's folder holds a run folder for each cell and seed, so that the same command resumes an interrupted study and repeats no
finished run. ``study.json`` has the numbers, the processor and the versions; ``study.md`` the tables. Both are written after
every seed, of all that is in the folder.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from fnmatch import fnmatchcase
from importlib import metadata
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from brickhub.files import write_durably
from bricksrl.errors import BricksError, DataError, RunError
from bricksrl.evaluation.cluster import connected, map_on_cluster, parse_on
from bricksrl.evaluation.statistics import ends, interquartile_mean, probability_of_improvement, seeds_interval, wilson_interval
from bricksrl.evaluation.study_page import page
from bricksrl.evaluation.study_tables import Cell, Condition, Study

if TYPE_CHECKING:
    from bricksrl.training import RunResult

OUTCOME = "outcome.json"
"""File with the outcome of a seed: steps, wall time and CPU time (null if resumed) of its training; the time of its steps by the
hub's clock (null without a hub); whether it reached its ``stop_at`` return (null without one); the results of the conditions."""
_FIRST_EVALUATION = 1000
"""Seed of the evaluation of seed 0. Each seed has episodes of its own, so that intervals over seeds cover their chance too."""
_PACKAGES = ("bricksrl", "torch", "torchrl", "tensordict", "mujoco", "numpy")
OnSeed = Callable[[str, int, str | None], None]
"""Called with the name of a cell, a seed, and its error or ``None``, when the seed is done."""


def name_of(cell: Cell) -> str:
    """Name of a cell's folder."""
    return "".join(char if char.isalnum() or char in "-." else "_" for char in f"{cell.row}-{cell.column}")


def run_seed(cell: Cell, seed: int, folder: str) -> dict[str, Any] | str:
    """Train and evaluate one seed, or resume it; returns its outcome, or the text of an error."""
    from bricksrl.training import RunFolder, TrainConfig, resume, train
    from bricksrl.training.curve import WINDOW

    path = Path(folder) / f"seed-{seed}"
    done = path / OUTCOME
    if (outcome := _read_outcome(done)) is not None:
        return outcome
    try:
        cpu_s = None
        if RunFolder(path).checkpoint_path.exists():
            _check_whole(resume(path))
        else:
            before_s = _cpu_s()
            _check_whole(train(TrainConfig(**{**cell.config, "seed": seed, "run_dir": path, "asynchronous": False})))
            cpu_s = _cpu_s() - before_s
        results = [_evaluate_condition(path, seed, number, condition) for number, condition in enumerate(cell.conditions)]
        episodes = RunFolder(path).read_episodes()
        goal, last = cell.config.get("stop_at"), [episode.return_ for episode in episodes[-WINDOW:]]
        reached = None if goal is None else len(last) == WINDOW and sum(last) / WINDOW >= goal
    except BricksError as error:
        return str(error)
    outcome = {
        "seed": seed,
        "judged": results,
        "steps": episodes[-1].steps,
        "wall_s": episodes[-1].seconds,
        "cpu_s": cpu_s,
        "robot_s": robot_seconds(path),
        "reached": reached,
    }
    write_durably(done, (json.dumps(outcome, indent=2) + "\n").encode())
    return outcome


def _read_outcome(path: Path) -> dict[str, Any] | None:
    """Outcome of a seed; ``None`` if there is none, or the file is damaged, so that the seed is evaluated again."""
    try:
        outcome = dict(json.loads(path.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None
    return outcome if outcome.keys() >= {"seed", "judged", "steps", "wall_s", "robot_s", "reached"} else None


def _check_whole(result: RunResult) -> None:
    """Raise KeyboardInterrupt after a training that Ctrl-C has ended: it is resumed later, and has no outcome yet."""
    if result.interrupted:
        raise KeyboardInterrupt


def _cpu_s() -> float:
    """CPU time of this process, with its threads and its ended children."""
    return sum(os.times()[:4])


def _evaluate_condition(run: Path, seed: int, number: int, condition: Condition) -> dict[str, Any]:
    """Evaluate a run under a condition, after further training there if the condition asks for it."""
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training import RunFolder, TrainConfig, train

    run_dir = run
    if condition.learn_episodes:
        run_dir = run.with_name(f"{run.name}-condition-{number}")
        shutil.rmtree(run_dir, ignore_errors=True)  # left by an interrupted study
        config = RunFolder(run).read_config()
        base = {"agent": config.agent, "settings": config.settings, "start": str(run), "seed": seed, "run_dir": run_dir}
        options = {**base, "episodes": condition.learn_episodes, "asynchronous": False, **condition.named}
        _check_whole(train(TrainConfig(condition.env or config.env, **options)))
    options = {"episodes": condition.episodes, "seed": _FIRST_EVALUATION + seed, "save": False, **condition.named}
    result = evaluate(run_dir, condition.env, **options)
    successes = None if result.success_rate is None else round(result.success_rate * result.episodes)
    metrics = {**result.metrics, "action_size": result.action_size, "episode_steps": float(np.mean(result.lengths))}
    return {"condition": condition.name, "returns": result.returns, "successes": successes, "metrics": metrics}


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
        if len(times_s) > 1:  # times start at the end of the first step, whose duration is taken as the mean of the others
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
    """Run the missing parts of a study, and write ``study.json`` and ``study.md``; returns the path of the latter. Raises
    RunError if no cell was chosen, there is no such cluster, the folder is of another study, or a seed failed; the others are
    kept, and the same command resumes.

    Args:
        quick: run the quick form, a smoke test of the study.
        only: shell patterns of names of cells; by default all cells.
        seeds: seeds per cell; by default the study's number, 2 in the quick form.
        jobs: concurrent processes; by default the number of cores.
        on: "ray", or "ray:ADDRESS", with a folder shared by all computers.
    """
    cells = study.cells(quick)
    chosen = [cell for cell in cells if not only or any(fnmatchcase(name_of(cell), pattern) for pattern in only)]
    if not chosen:
        raise RunError(f"no cell of '{study.name}' matches {', '.join(only)}; choose from {', '.join(map(name_of, cells))}")
    _check_folder(folder, study, quick=quick)
    count = seeds or (2 if quick else study.seeds)
    orders = [(cell, seed, str((folder / name_of(cell)).absolute())) for cell in chosen for seed in range(count)]
    errors = []
    with nullcontext() if on is None else connected(parse_on(on), jobs) as ray:
        written = write_study(folder, _result(study, cells, folder, quick=quick))  # marks the folder before it has any run
        for (cell, seed, _), outcome in zip(orders, _outcomes(orders, jobs, ray), strict=True):
            error = outcome if isinstance(outcome, str) else None
            on_seed(name_of(cell), seed, error)
            if error is not None:
                errors.append(f"{name_of(cell)} seed {seed}: {error}")
            written = write_study(folder, _result(study, cells, folder, quick=quick))
    if errors:
        raise RunError(f"{len(errors)} of {len(orders)} runs failed; the first: {errors[0]}")
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
    done = {name: [outcome for path in paths if (outcome := _read_outcome(path))] for name, paths in paths_of.items()}
    outcomes_of = {name: sorted(outcomes, key=lambda outcome: outcome["seed"]) for name, outcomes in done.items()}
    result = {"study": study.name, "title": study.title, "quick": quick, "heads": study.heads, "metrics": study.metrics}
    result |= _machine()
    result["cells"] = [summary(cell, outcomes_of[name_of(cell)]) for cell in cells if outcomes_of[name_of(cell)]]
    result["improvements"] = improvements(cells, outcomes_of)
    missing = [name for name, outcomes in outcomes_of.items() if not outcomes]
    missing_note = f"Not run: {', '.join(missing)}." if missing else ""
    result["notes"] = [note for note in (study.note, missing_note) if note]
    return result


def write_study(folder: Path, result: dict[str, Any]) -> Path:
    """Write the numbers of a study and its page; returns the path of the page."""
    write_durably(folder / "study.json", (json.dumps(result, indent=2) + "\n").encode())
    write_durably(folder / "study.md", page(result).encode())
    return folder / "study.md"


def _outcomes(orders: Sequence[tuple[Cell, int, str]], jobs: int | None, ray: Any) -> Iterable[dict[str, Any] | str]:
    """Outcomes of the orders, in order, each as soon as it is ready; ``ray``: the connected module, or ``None``."""
    if ray is not None:
        yield from map_on_cluster(ray, run_seed, orders)
        return
    workers = min(jobs or os.cpu_count() or 1, len(orders))
    if workers == 1:
        yield from (run_seed(*order) for order in orders)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_start_worker) as pool:
        try:
            yield from pool.map(run_seed, *zip(*orders, strict=True))
        except BrokenProcessPool:
            raise RunError("a process was killed, maybe for lack of memory; repeat the command with fewer --jobs") from None


def _start_worker() -> None:
    """Compute on one thread, and end as soon as the study's process does, however it ends."""
    import torch

    torch.set_num_threads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None  # noqa: S101  called in a worker
    parent.join()
    os._exit(1)


def summary(cell: Cell, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of a cell's seeds; conditions of the same name are pooled."""
    names = list(dict.fromkeys(condition.name for condition in cell.conditions))
    return {
        "row": cell.row,
        "column": cell.column,
        "seeds": len(outcomes),
        "steps": [outcome["steps"] for outcome in outcomes],
        "wall_s": [round(outcome["wall_s"], 1) for outcome in outcomes],
        "cpu_s": [outcome.get("cpu_s") for outcome in outcomes],
        "robot_s": [outcome["robot_s"] for outcome in outcomes],
        "reached": [outcome["reached"] for outcome in outcomes],
        "paper": dict(cell.paper),
        "conditions": {name: _condition_summary(name, outcomes) for name in names},
    }


def _condition_summary(name: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summary of one condition: a mean return per seed, and the successes of all episodes."""
    by_seed = [[item for item in outcome["judged"] if item["condition"] == name] for outcome in outcomes]
    returns = [float(np.mean([value for item in results for value in item["returns"]])) for results in by_seed]
    result = {**over_seeds(returns), "episodes": sum(len(item["returns"]) for results in by_seed for item in results)}
    successes = [item["successes"] for results in by_seed for item in results]
    if all(value is not None for value in successes):
        result |= {"successes": sum(successes), "success_rate": sum(successes) / result["episodes"]}
        if len(outcomes) >= 5:
            result["success_95"] = ends(wilson_interval(sum(successes), result["episodes"]))
    metrics = {name for results in by_seed for item in results for name in item["metrics"]}
    result["metrics"] = {
        metric: float(np.mean([item["metrics"][metric] for results in by_seed for item in results if metric in item["metrics"]]))
        for metric in sorted(metrics)
    }
    return result


def over_seeds(returns: Sequence[float]) -> dict[str, Any]:
    """Mean return of each seed, their interquartile mean and its interval."""
    iqm = float(interquartile_mean(np.array(returns)))
    return {"returns": list(returns), "return_iqm": iqm, "return_95": ends(seeds_interval(returns))}


def improvements(cells: Sequence[Cell], outcomes_of: dict[str, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Probability, per column, that a seed of the first row outscores one of each other row in the last condition."""
    columns: dict[str, list[Cell]] = {}
    for cell in cells:
        columns.setdefault(cell.column, []).append(cell)
    pairs = []
    for column, rows in columns.items():
        finished = [(cell, outcomes_of[name_of(cell)]) for cell in rows if outcomes_of[name_of(cell)]]
        scored = {cell.row: _condition_summary(cell.conditions[-1].name, done)["returns"] for cell, done in finished}
        for row, scores in list(scored.items())[1:]:
            first, others = next(iter(scored.items()))
            probability, interval = probability_of_improvement(others, scores)
            pair = {"column": column, "row": first, "over": row}
            pairs.append({**pair, "probability": probability, "probability_95": ends(interval)})
    return pairs


def _machine() -> dict[str, Any]:
    versions = {"python": platform.python_version(), **{name: metadata.version(name) for name in _PACKAGES}}
    processor = platform.processor()
    try:
        names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        processor = names[0].partition(":")[2].strip() if names else processor
    except OSError:
        pass
    return {"machine": {"processor": processor, "cores": os.cpu_count(), "system": platform.system()}, "versions": versions}
