"""Warm start: episodes on the robot until the return is -25 on Walker-v0, with and without a dataset.

    python -m benchmarks warm_start

Four methods, each with ``--seeds`` seeds, on the virtual robot: SAC from scratch; SAC with half of each batch from the dataset;
IQL that was trained on the dataset and continues; SAC that continues from the policy of a BC agent trained on the dataset, with
the dataset. The result is the first episode with a return, exploration included, of -25 or more; an agent that does not reach it
counts with ``--episodes`` and one more. A missing dataset is recorded first.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import datasets
from benchmarks.session import Session
from benchmarks.stopping import StopWhen
from bricksrl.agents import preset
from bricksrl.training import TrainConfig, train
from bricksrl.training.restore import settings_like

ENV, GOAL = "Walker-v0", -25.0
WAYS = {"alone": ("sac", None), "data": ("sac", None), "start": ("iql", "iql"), "policy": ("sac", "bc")}
"""Agent that learns on the robot, and agent that it continues from."""


def run(way: str, data: str, episodes: int, updates: int, seed: int) -> dict[str, Any]:
    """Train until the goal."""
    callback = StopWhen(lambda episode: episode.return_ >= GOAL)
    with tempfile.TemporaryDirectory() as folder:
        start, run_dir = Path(folder) / "start", Path(folder) / "run"
        agent, teacher = WAYS[way]
        settings = preset("default", agent)
        if teacher is not None:
            teacher_config = TrainConfig(ENV, teacher, 1, seed=seed, data=data, updates=updates, run_dir=start)
            train(teacher_config)
            settings = settings_like(teacher_config, settings)
        config = TrainConfig(
            ENV,
            agent,
            episodes,
            seed=seed,
            settings=settings,
            data=None if way == "alone" else data,
            start=None if teacher is None else str(start),
            run_dir=run_dir,
            record=False,
        )
        returns = [episode.return_ for episode in train(config, callback, stop=callback.stop).episodes]
    reached = returns[-1] >= GOAL
    return {"seed": seed, "episodes": len(returns) + (not reached), "reached": reached, "returns": returns}


def main(session: Session) -> None:
    """Run all and write the results."""
    parser = session.parser
    parser.add_argument("--data", type=Path, help=f"the dataset (default: the expert's in {datasets.FOLDER})")
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=list(WAYS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--updates", type=int, default=5000, help="of IQL and of BC, from the dataset alone")
    args = session.parse()
    data = args.data or session.place_of(datasets.FOLDER) / f"{ENV}-expert"
    if args.data is None and not data.exists():
        datasets.made(data.parent, (ENV,), quick=session.is_quick, processes=session.jobs)
    size = args.episodes, args.updates
    cells = {f"{way}-{args.episodes}-{args.updates}": (way, str(data.absolute()), *size) for way in args.ways}
    results: dict[str, Any] = {}
    for way, runs in zip(args.ways, session.by_seed(run, cells, args.seeds).values(), strict=True):
        results[way] = {"episodes_median": statistics.median(run_result["episodes"] for run_result in runs), "seeds": runs}
    print({way: run_result["episodes_median"] for way, run_result in results.items()})
    session.write({"env": ENV, "goal": GOAL, "updates": args.updates, "ways": results})
