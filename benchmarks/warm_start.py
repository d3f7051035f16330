"""Warm start: episodes on the robot until the return is -25 on Walker-v0, with and without a dataset.

    python benchmarks/datasets.py --out runs/datasets
    python benchmarks/warm_start.py --data runs/datasets/Walker-v0-expert

Three ways, each from ``--seeds`` seeds, on the twin: SAC from nothing; SAC with half of each batch from the dataset; IQL that has
learned from the dataset alone before and goes on. The first episode whose own return (the agent explores in it) is -25 or more
counts; an agent that does not get there counts with ``--episodes`` and one more.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

from machine import command, write
from stopping import StopWhen

from bricksrl.training import TrainConfig, train

ENV, GOAL = "Walker-v0", -25.0
WAYS = ("alone", "data", "start")


def run(way: str, data: str, seed: int, episodes: int, updates: int) -> dict[str, Any]:
    """Train until the goal."""
    observer = StopWhen(lambda episode: episode.return_ >= GOAL)
    with tempfile.TemporaryDirectory() as folder:
        start, run_dir = Path(folder) / "start", Path(folder) / "run"
        if way == "start":
            train(TrainConfig(ENV, "iql", 1, seed=seed, data=data, updates=updates, run_dir=start))
        config = TrainConfig(
            ENV,
            "iql" if way == "start" else "sac",
            episodes,
            seed=seed,
            data=None if way == "alone" else data,
            start=str(start) if way == "start" else None,
            run_dir=run_dir,
            record=False,
        )
        returns = [episode.return_ for episode in train(config, observer, stop=observer.stop).episodes]
    reached = returns[-1] >= GOAL
    print(way, seed, [round(one, 1) for one in returns], flush=True)
    return {"seed": seed, "episodes": len(returns) + (not reached), "reached": reached, "returns": returns}


def main() -> None:
    """Make all runs and write them."""
    parser = command(__doc__)
    parser.add_argument("--data", type=Path, default=Path("runs/datasets/Walker-v0-expert"))
    parser.add_argument("--ways", nargs="+", default=WAYS, choices=WAYS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--updates", type=int, default=5000, help="of IQL, from the dataset alone")
    chosen = parser.parse_args()
    found: dict[str, Any] = {}
    for way in chosen.ways:
        runs = [run(way, str(chosen.data.absolute()), seed, chosen.episodes, chosen.updates) for seed in range(chosen.seeds)]
        found[way] = {"episodes_median": statistics.median(one["episodes"] for one in runs), "seeds": runs}
    print({way: one["episodes_median"] for way, one in found.items()})
    print(write("warm_start", {"env": ENV, "goal": GOAL, "updates": chosen.updates, "ways": found}))


if __name__ == "__main__":
    main()
