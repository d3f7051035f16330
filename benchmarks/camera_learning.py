"""Learning speed in the camera task: success over episodes, steps and time.

    python -m benchmarks camera_learning --seeds 5
    python -m benchmarks camera_learning --preset paper --marks 100 250 --seeds 3

Initial episodes of random actions are included. Each agent trains in one process on one thread, pauses at each mark, and is
evaluated there on ``EVALUATED_EPISODES`` deterministic episodes. Medians and ranges over the seeds; times are training times.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import torch

from benchmarks.session import Session
from bricksrl.agents import preset
from bricksrl.evaluation import evaluate
from bricksrl.training import RunResult, TrainConfig, resume, train

ENV = "RoboArm_mixed-v0"
EVALUATED_EPISODES = 40
GOAL = 0.8
"""Success that counts as learned; the paper's agents reach 0.68 after 250 episodes."""


def run(agent: str, name: str, seed: int, marks: list[int]) -> dict[str, Any]:
    """Train one agent from mark to mark."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        return run_in(Path(folder) / "run", agent, name, seed, marks)


def run_in(folder: Path, agent: str, name: str, seed: int, marks: list[int]) -> dict[str, Any]:
    """Train one agent in a folder."""
    results: list[dict[str, Any]] = []
    cpu_s = wall_s = 0.0
    result: RunResult | None = None
    for mark in marks:
        cpu, wall = time.process_time(), time.perf_counter()
        if result is None:
            settings = preset(name, agent, images=True)
            result = train(TrainConfig(ENV, agent, episodes=mark, seed=seed, settings=settings, run_dir=folder))
        else:
            result = resume(folder, episodes=mark)
        cpu_s, wall_s = cpu_s + time.process_time() - cpu, wall_s + time.perf_counter() - wall
        outcome = evaluate(folder, episodes=EVALUATED_EPISODES, save=False)
        results.append(
            {
                "episodes": mark,
                "steps": result.episodes[-1].steps,
                "success_rate": outcome.success_rate,
                "return_mean": round(outcome.return_mean, 2),
                "steps_to_goal_mean": round(statistics.mean(outcome.lengths), 1),
                "cpu_s": round(cpu_s, 1),
                "wall_s": round(wall_s, 1),
            }
        )
        print(agent, name, seed, results[-1], flush=True)
    assert result is not None
    return {"seed": seed, "marks": results, "train_success": [int(bool(episode.success)) for episode in result.episodes]}


def summary(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians and ranges at each mark."""
    medians = []
    for at_mark in zip(*(run_at_mark["marks"] for run_at_mark in runs), strict=True):
        rates = [run_at_mark["success_rate"] for run_at_mark in at_mark]
        medians.append(
            {
                "episodes": at_mark[0]["episodes"],
                "success_median": statistics.median(rates),
                "success_range": [min(rates), max(rates)],
                **{
                    f"{key}_median": statistics.median(run_at_mark[key] for run_at_mark in at_mark)
                    for key in ("steps", "return_mean", "steps_to_goal_mean", "cpu_s", "wall_s")
                },
            }
        )
    return medians


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--agents", nargs="+", default=["sac"], choices=["sac", "td3"])
    parser.add_argument("--preset", default="default")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--marks", type=int, nargs="+", default=[10, 25, 50, 100])
    args = session.parse()
    results: dict[str, Any] = {}
    ends = sorted(args.marks)
    for agent in args.agents:
        jobs = {
            f"{agent}-{args.preset}-{seed}-{'-'.join(map(str, ends))}": (agent, args.preset, seed, ends)
            for seed in range(args.seeds)
        }
        runs = list(session.outcomes(run, jobs, processes=1))
        marks = summary(runs)
        learned = next((mark["episodes"] for mark in marks if mark["success_median"] >= GOAL), None)
        results[agent] = {"learned_after_episodes": learned, "summary": marks, "seeds": runs}
    result = {"env": ENV, "preset": args.preset, "evaluated_episodes": EVALUATED_EPISODES, "agents": results}
    session.write(result, "" if args.preset == "default" else f"_{args.preset}")
