"""The paper's datasets, recorded on the virtual robots, and their table next to the paper's.

    python benchmarks/datasets.py --out runs/datasets

For each of the four tasks a SAC agent is trained, and two datasets are recorded: of the trained agent (expert) and of random
actions, ``--episodes`` each. They are in ``<out>/<task>-expert`` and ``<out>/<task>-random``, the runs in ``<out>/<task>-sac``;
existing ones are kept. Tasks run in parallel, one per core.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from pathlib import Path
from typing import Any

from machine import command, write

from bricksrl.evaluation.paper import DATASETS

TASKS = {"Walker-v0": 75, "RoboArm-v0": 250, "RunAway-v0": 40, "Spinning-v0": 15}
"""Episodes of training, as many as the paper's."""
SEED = 0


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
    return {**result, "seconds": time.perf_counter() - started_s, "cpu_seconds": time.process_time() - cpu_s}


def record(env_id: str, path: Path, run: Path | None, episodes: int) -> None:
    """Record a dataset of a run's agent, or of random actions; it is renamed to ``path`` when it is complete."""
    import bricksrl
    from bricksrl.data import Recorder, describe
    from bricksrl.data.collect import collect, random_policy
    from bricksrl.policies import load_policy

    env = bricksrl.make(env_id, seed=SEED)
    unfinished = path.with_name(f"{path.name}-unfinished-{os.getpid()}")
    try:
        policy = random_policy(env, SEED) if run is None else load_policy(run, env)
        with Recorder(unfinished, describe(env)) as recorder:
            collect(env, policy, recorder, episodes, name="random" if run is None else "sac", seed=SEED)
    finally:
        env.close(raise_if_closed=False)
    unfinished.rename(path)


def _job(job: tuple[str, Path, int, int]) -> tuple[str, dict[str, Any]]:
    return job[0], make(*job)


def table(results: dict[str, dict[str, Any]]) -> list[str]:
    """The paper's table and ours, a line per task."""
    lines = [f"{'task':13}{'mean reward':>24}{'expert transitions':>22}{'random transitions':>22}{'random reward':>15}"]
    for env_id, result in results.items():
        paper = DATASETS[env_id]
        cells = [
            f"{result['expert']['mean_reward']:.4g} ({paper['mean_reward']:.4g})",
            f"{result['expert']['transitions']} ({paper['expert_transitions']:.0f})",
            f"{result['random']['transitions']} ({paper['random_transitions']:.0f})",
        ]
        lines.append(f"{env_id:13}{cells[0]:>24}{cells[1]:>22}{cells[2]:>22}{result['random']['mean_reward']:>15.4g}")
    return lines


def main() -> None:
    """Run from the command line."""
    parser = command(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/datasets"))
    parser.add_argument("--tasks", nargs="+", choices=sorted(TASKS), default=list(TASKS))
    parser.add_argument("--episodes", type=int, default=100, help="of each dataset")
    parser.add_argument("--trained", type=int, help="episodes of training, in place of the paper's")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--no-result", action="store_true", help="print the table and leave results/datasets.json as it is")
    args = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    args.out.mkdir(parents=True, exist_ok=True)
    jobs = [(task, args.out, args.episodes, args.trained or TASKS[task]) for task in args.tasks]
    started_s = time.perf_counter()
    results: dict[str, dict[str, Any]] = {}
    with multiprocessing.get_context("spawn").Pool(args.processes, maxtasksperchild=1) as pool:
        for env_id, result in pool.imap_unordered(_job, jobs, chunksize=1):
            results[env_id] = result
            print(f"{env_id}: {result['seconds']:.0f} s", flush=True)
    results = {task: results[task] for task in args.tasks}
    for line in table(results):
        print(line)
    print("in brackets: the paper's")
    if not args.no_result:
        print(write("datasets", {"seed": SEED, "tasks": results, "paper": DATASETS, "seconds": time.perf_counter() - started_s}))


if __name__ == "__main__":
    main()
