"""The paper's datasets, recorded on the virtual robots, and their table next to the paper's.

    python -m benchmarks datasets

For each of the four tasks a SAC agent is trained, and two datasets are recorded: of the trained
agent (expert) and of random actions, ``--episodes`` each. They are in ``<out>/<task>-expert`` and
``<out>/<task>-random``, the runs in ``<out>/<task>-sac``; existing ones are kept. Tasks run in
parallel, one per core.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.paper import DATASETS
from benchmarks.parts import Failure, outcomes
from benchmarks.session import Session
from bricksrl.errors import RunError

TASKS = {"Walker-v0": 75, "RoboArm-v0": 250, "RunAway-v0": 40, "Spinning-v0": 15}
"""Episodes of training, as many as the paper's."""
SEED = 0
FOLDER = Path("runs/datasets")


def make(env_id: str, out: Path, episodes: int, trained: int) -> dict[str, Any]:
    """Train, record both datasets, and summarise them."""
    from bricksrl.data.summary import summarise
    from bricksrl.training import TrainConfig, train

    started_s, cpu_s = time.perf_counter(), time.process_time()
    run = out / f"{env_id}-sac"
    if not run.exists():
        train(TrainConfig(env_id, "sac", episodes=trained, seed=SEED, run_dir=run, record=False))
    result: dict[str, Any] = {"trained_episodes": trained}
    for kind in ("expert", "random"):
        path = out / f"{env_id}-{kind}"
        if not path.exists():
            record(env_id, path, run if kind == "expert" else None, episodes)
        summary = summarise(path)
        result[kind] = {
            "mean_reward": summary.return_mean,
            "std_reward": summary.return_std,
            "transitions": summary.transitions,
            "episodes": summary.episodes,
            "success_rate": summary.success_rate,
        }
    return {
        **result,
        "seconds": time.perf_counter() - started_s,
        "cpu_seconds": time.process_time() - cpu_s,
    }


def record(env_id: str, path: Path, run: Path | None, episodes: int) -> None:
    """Record a dataset of a run's agent, or of random actions; it is renamed to ``path`` when it is
    complete."""
    import bricksrl
    from bricksrl.data import Recorder, describe
    from bricksrl.data.collect import collect, random_policy
    from bricksrl.policies import load_policy

    env = bricksrl.make(env_id, seed=SEED)
    unfinished = path.with_name(f"{path.name}-unfinished-{os.getpid()}")
    try:
        policy = random_policy(env, SEED) if run is None else load_policy(run, env)
        with Recorder(unfinished, describe(env)) as recorder:
            collect(
                env, policy, recorder, episodes, name="random" if run is None else "sac", seed=SEED
            )
    finally:
        env.close(raise_if_closed=False)
    unfinished.rename(path)


def made(
    out: Path,
    tasks: Sequence[str],
    episodes: int = 100,
    trained: int | None = None,
    *,
    quick: bool = False,
    processes: int | None = None,
) -> dict[str, dict[str, Any]]:
    """Summaries of the datasets by task; those that are missing in the folder ``out`` are
    recorded."""
    if quick:
        episodes, trained = 2, 2
    jobs = [(task, out, episodes, trained or TASKS[task]) for task in tasks]
    parts = {
        out / f"{task}-{episodes}-{trained}.json": job
        for job in jobs
        for task, _, episodes, trained in (job,)
    }
    results = dict(zip(tasks, outcomes(make, parts, processes), strict=True))
    for task, result in results.items():
        if isinstance(result, Failure):
            raise RunError(f"{task}: {result}")
    return results


def main(session: Session) -> None:
    """Run from the command line."""
    parser = session.parser
    parser.add_argument("--out", type=Path, help=f"folder of the datasets (default: {FOLDER})")
    parser.add_argument("--tasks", nargs="+", choices=sorted(TASKS), default=list(TASKS))
    parser.add_argument("--episodes", type=int, default=100, help="of each dataset")
    parser.add_argument("--trained", type=int, help="episodes of training, in place of the paper's")
    args = session.parse()
    started_s = time.perf_counter()
    out = args.out or session.place_of(FOLDER)
    results = made(out, args.tasks, args.episodes, args.trained, processes=session.jobs)
    print(*(f"{task}: {result}" for task, result in results.items()), sep="\n")
    session.write(
        {
            "seed": SEED,
            "tasks": results,
            "paper": DATASETS,
            "seconds": time.perf_counter() - started_s,
        }
    )
