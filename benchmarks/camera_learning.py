"""Learning speed in the camera task: success over episodes, steps and time.

    python -m benchmarks camera_learning --seeds 5
    python -m benchmarks camera_learning --preset paper --marks 100 250 --seeds 3

Initial episodes of random actions are included. Each agent trains as in `learning.py`, with marks
after numbers of episodes. Medians and ranges over the seeds; times are training times.
"""

from __future__ import annotations

import statistics
from typing import Any

from benchmarks.learning import EVALUATED_EPISODES, run
from benchmarks.session import Session

ENV = "RoboArm_mixed-v0"
GOAL = 0.8
"""Success that counts as learned; the paper's agents reach 0.68 after 250 episodes."""


def summary(runs: list[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Medians and ranges at each mark."""
    medians = []
    for at_mark in zip(*runs, strict=True):
        rates = [mark["success_rate"] for mark in at_mark]
        names = ("steps", "return", "cpu_s", "wall_s")
        others = {
            f"{name}_median": statistics.median(mark[name] for mark in at_mark) for name in names
        }
        success = {
            "success_median": statistics.median(rates),
            "success_range": [min(rates), max(rates)],
        }
        medians.append({"episodes": at_mark[0]["episodes"], **success, **others})
    return medians


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--agents", nargs="+", default=["sac"], choices=["sac", "td3"])
    parser.add_argument("--marks", type=int, nargs="+", default=[10, 25, 50, 100])
    args = session.parse(preset="default", seeds=3)
    results: dict[str, Any] = {}
    ends = sorted(args.marks)
    for agent in args.agents:
        name = f"{agent}-{args.preset}-{'-'.join(map(str, ends))}"
        runs = session.by_seed(
            run, {name: (ENV, agent, args.preset, ends, "episode", {})}, args.seeds
        )[name]
        marks = summary(runs)
        learned = next((mark["episodes"] for mark in marks if mark["success_median"] >= GOAL), None)
        results[agent] = {"learned_after_episodes": learned, "summary": marks, "seeds": runs}
    result = {
        "env": ENV,
        "preset": args.preset,
        "evaluated_episodes": EVALUATED_EPISODES,
        "agents": results,
    }
    session.write(result, "" if args.preset == "default" else f"_{args.preset}")
