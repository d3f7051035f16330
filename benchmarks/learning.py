"""How fast agents learn in the simulations: returns and success of what was learned after so many episodes, or steps, in all.

    python benchmarks/learning.py --agents sac td3 --seeds 10

Episodes of random actions at the start count. Each agent trains with its default preset in one process on one thread, pauses at
each mark, and is evaluated there on ``EVALUATED_EPISODES`` deterministic episodes. Medians and ranges over the seeds.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import torch
from machine import write

from bricksrl.agents import preset
from bricksrl.evaluation import evaluate
from bricksrl.training import Episode, Observer, Progress, TrainConfig, resume, train

MARKS = {"WalkerSim-v0": ("episodes", (5, 10, 25, 75)), "RoboArmSim-v0": ("steps", (250, 500, 1000))}
EVALUATED_EPISODES = 40


class StopAt(Observer):
    """Stops a run at the end of the episode in which it has made so many steps."""

    def __init__(self, steps: int) -> None:
        self.stop = threading.Event()
        self._steps = steps

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if episode.steps >= self._steps:
            self.stop.set()


def run(env_id: str, agent: str, name: str, seed: int, folder: Path, marks: tuple[int, ...]) -> list[dict[str, Any]]:
    """Train one agent from mark to mark."""
    unit, _ = MARKS[env_id]
    found: list[dict[str, Any]] = []
    cpu_s = 0.0
    for mark in marks:
        observer = StopAt(mark if unit == "steps" else 10**9)
        episodes = mark if unit == "episodes" else 10 * mark
        started_s = time.process_time()
        if found:
            result = resume(folder, observer, episodes=episodes, stop=observer.stop)
        else:
            config = TrainConfig(env_id, agent, episodes=episodes, seed=seed, settings=preset(name, agent), run_dir=folder)
            result = train(config, observer, stop=observer.stop)
        cpu_s += time.process_time() - started_s
        last = result.episodes[-1]
        outcome = evaluate(folder, episodes=EVALUATED_EPISODES, save=False)
        found.append(
            {
                unit: mark,
                "steps_made": last.steps,
                "return_mean": round(outcome.return_mean, 2),
                "success_rate": outcome.success_rate,
                "cpu_s": round(cpu_s, 1),
            }
        )
    print(env_id, agent, name, seed, [(one[unit], one["return_mean"], one["success_rate"]) for one in found], flush=True)
    return found


def summary(runs: list[list[dict[str, Any]]], unit: str) -> list[dict[str, Any]]:
    """Medians and ranges at each mark."""
    found = []
    for at_mark in zip(*runs, strict=True):
        returns, successes = ([one[key] for one in at_mark] for key in ("return_mean", "success_rate"))
        found.append(
            {
                unit: at_mark[0][unit],
                "return_median": statistics.median(returns),
                "return_range": [min(returns), max(returns)],
                "success_median": statistics.median(successes),
                "success_least": min(successes),
                "cpu_s_median": statistics.median(one["cpu_s"] for one in at_mark),
            }
        )
    return found


def main() -> None:
    """Train all and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--agents", nargs="+", default=["sac"])
    parser.add_argument("--preset", default="default")
    parser.add_argument("--envs", nargs="+", default=list(MARKS), choices=list(MARKS))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--marks", type=int, help="only so many marks")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    results: dict[str, Any] = {}
    for env_id in chosen.envs:
        unit, marks = MARKS[env_id]
        for agent in chosen.agents:
            with tempfile.TemporaryDirectory() as folder:
                runs = [
                    run(env_id, agent, chosen.preset, seed, Path(folder) / str(seed), marks[: chosen.marks])
                    for seed in range(chosen.seeds)
                ]
            results.setdefault(env_id, {})[agent] = {"summary": summary(runs, unit), "seeds": runs}
    name = "learning" if chosen.preset == "default" else f"learning_{chosen.preset}"
    print(write(name, {"preset": chosen.preset, "seeds": chosen.seeds, "environments": results}))


if __name__ == "__main__":
    main()
