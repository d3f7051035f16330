"""What the demo learns, over five seeds: returns of trained agents, and how long the training took.

    python benchmarks/demo_seeds.py

Trains SAC with its default settings on the virtual robot and evaluates five episodes of each agent. One process, one thread.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

import torch
from machine import command, write

from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train

EPISODES = {"RunAway-v0": 40, "Spinning-v0": 15}
SEEDS = range(5)
EVALUATED_EPISODES = 5


def run(env_id: str, episodes: int, seed: int, folder: Path) -> dict[str, Any]:
    """Train and evaluate one agent."""
    result = train(TrainConfig(env_id, episodes=episodes, seed=seed, run_dir=folder / f"{env_id}-{seed}"))
    if result.interrupted:
        raise KeyboardInterrupt
    last = result.episodes[-1]
    found = evaluate(result.run_dir, episodes=EVALUATED_EPISODES)
    print(f"{env_id} seed {seed}: {found.return_mean:.4g} ± {found.return_std:.4g}, trained {last.seconds:.1f} s")
    return {
        "seed": seed,
        "return_mean": found.return_mean,
        "return_std": found.return_std,
        "returns": list(found.returns),
        "success_rate": found.success_rate,
        "metrics": found.metrics,
        "steps": last.steps,
        "training_s": round(last.seconds, 1),
    }


def main() -> None:
    """Run all seeds and write them with their medians."""
    command(__doc__).parse_args()
    torch.set_num_threads(1)
    environments: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for env_id, episodes in EPISODES.items():
            runs = [run(env_id, episodes, seed, Path(folder)) for seed in SEEDS]
            medians = {key: statistics.median(one[key] for one in runs) for key in ("return_mean", "success_rate", "training_s")}
            environments[env_id] = {"training_episodes": episodes, "medians": medians, "seeds": runs}
    print(write("demo_seeds", {"agent": "sac", "preset": "default", "environments": environments}))


if __name__ == "__main__":
    main()
