"""SAC on each robot over several seeds, with the paper's number of episodes if it has the task,
next to the paper's results.

    python -m benchmarks robots
    python -m benchmarks robots --envs Walker-v1 --seeds 3

Each seed trains with the default preset in its own process, on one thread, as many in parallel as
there are cores, and is then evaluated on other episodes than those of the training. Other
environments stay in the result.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper import RETURNS, SUCCESS
from benchmarks.session import Session
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.statistics import (
    interquartile_mean,
    mean,
    stratified_bootstrap_interval,
    wilson_interval,
)
from bricksrl.training import TrainConfig, train

EPISODES = {
    "RunAway-v0": 40,
    "Spinning-v0": 15,
    "Walker-v0": 75,
    "Walker-v1": 75,
    "Walker-v2": 12,
    "LineFollow-v0": 30,
    "Park-v0": 30,
    "RoboArm-v0": 250,
    "RoboArm_mixed-v0": 250,
}
EVALUATED_EPISODES = 20


def run(
    env_id: str, agent: str, episodes: int, config: dict[str, Any], seed: int
) -> dict[str, Any]:
    """Train and evaluate one agent. ``config``: further fields of its configuration."""
    with tempfile.TemporaryDirectory() as folder:
        started_cpu_s = time.process_time()
        result = train(
            TrainConfig(
                env_id, agent, episodes=episodes, seed=seed, run_dir=Path(folder) / "run", **config
            )
        )
        cpu_s = time.process_time() - started_cpu_s
        evaluation = evaluate(result.run_dir, episodes=EVALUATED_EPISODES)
    last = result.episodes[-1]
    return {
        "seed": seed,
        "return_mean": round(evaluation.return_mean, 3),
        "return_std": round(evaluation.return_std, 3),
        "success_rate": evaluation.success_rate,
        "metrics": {name: round(value, 4) for name, value in evaluation.metrics.items()},
        "steps": last.steps,
        "training_cpu_s": round(cpu_s, 1),
        "returns": [round(value, 2) for value in evaluation.returns],
    }


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Summary over the seeds: interquartile mean, mean and deviation of the returns, and success
    rate, with intervals."""
    strata = [run["returns"] for run in runs]
    means = [run["return_mean"] for run in runs]
    interval = stratified_bootstrap_interval([means], mean)
    result: dict[str, Any] = {
        "return_iqm": round(float(interquartile_mean(np.array(strata).ravel())), 3),
        "return_mean": round(statistics.fmean(means), 3),
        "return_std": round(statistics.pstdev(means), 3),
        "return_interval": [round(interval.low, 3), round(interval.high, 3)],
        "training_cpu_s_median": statistics.median(run["training_cpu_s"] for run in runs),
    }
    if runs[0]["success_rate"] is not None:
        trials = EVALUATED_EPISODES * len(runs)
        successes = round(sum(run["success_rate"] for run in runs) * EVALUATED_EPISODES)
        rate = wilson_interval(successes, trials)
        result["success_rate"] = round(successes / trials, 3)
        result["success_interval"] = [round(rate.low, 3), round(rate.high, 3)]
    result["metrics"] = {
        name: round(statistics.fmean(run["metrics"][name] for run in runs), 4)
        for name in runs[0]["metrics"]
    }
    return result


def paper_of(env_id: str) -> dict[str, Any] | None:
    """The paper's means and standard deviations on LEGO robots, and the success rate of its SAC if
    it has one."""
    if env_id not in RETURNS:
        return None
    success = {"sac_success_rate": SUCCESS[env_id]["sac"]} if env_id in SUCCESS else {}
    return {agent: list(RETURNS[env_id][agent]) for agent in ("sac", "td3", "droq")} | success


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--episodes", type=int, help="instead of the paper's")
    args = session.parse(envs=list(EPISODES), agent="sac", seeds=5)
    variant = "" if args.agent == "sac" else f"_{args.agent}"
    episodes = {env_id: args.episodes or EPISODES[env_id] for env_id in args.envs}
    cells: dict[str, tuple[Any, ...]] = {
        f"{env_id}-{args.agent}-{count}": (env_id, args.agent, count, {})
        for env_id, count in episodes.items()
    }
    known: dict[str, Any] = session.known(variant).get("environments", {})
    for (env_id, count), runs in zip(
        episodes.items(), session.by_seed(run, cells, args.seeds).values(), strict=True
    ):
        known[env_id] = {
            "episodes": count,
            "summary": summary(runs),
            "paper": paper_of(env_id),
            "seeds": runs,
        }
        print(env_id, known[env_id]["summary"], flush=True)
    ordered = {env_id: known[env_id] for env_id in EPISODES if env_id in known}
    session.write({"agent": args.agent, "preset": "default", "environments": ordered}, variant)
