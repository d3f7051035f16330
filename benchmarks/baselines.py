"""Random actions and hand-written controllers in every environment, next to the paper's
measurements on its robots.

    python -m benchmarks baselines

One process, one thread. The paper's numbers are means and standard deviations over five episodes on
LEGO robots (its tables 2 and 3); those of its simulations are from the same robots.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

import bricksrl
from benchmarks.paper import RETURNS, SUCCESS
from benchmarks.scripted import CONTROLLERS
from benchmarks.session import Session
from brickhub.seed import derive_seed
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.rollout import Policy, Rollout, play, seed_episode
from bricksrl.evaluation.statistics import mean, stratified_bootstrap_interval, wilson_interval

REASONS = {
    "RunAway-v0": (
        "The virtual robot starts 200 to 300 mm before the wall; the paper does not say "
        "where its robot did."
    ),
    "RoboArm-v0": "The paper's success rate depends on its threshold, 50 degrees here.",
    "RoboArm_mixed-v0": (
        "An episode ends at the goal; how often random actions cross it depends on camera "
        "and goals."
    ),
}
SEED = 2000


def episode(env: Any, policy: Policy) -> tuple[float, bool, dict[str, float]]:
    """Return, success and walk metrics of an episode."""
    rollout = Rollout()
    for frame in play(env, policy):
        rollout.add(frame, env)
    return rollout.return_, bool(rollout.judged(env)[0]), env.walk_metrics()


def measure(
    env_id: str, policy: Policy, episodes: int, options: EnvOptions | None = None
) -> dict[str, Any]:
    """Results over episodes, each with its own seed."""
    env = bricksrl.make(env_id, options, seed=SEED)
    torch.manual_seed(SEED)
    runs = []
    for number in range(episodes):
        seed_episode(env, derive_seed(SEED, "baseline", number))
        runs.append(episode(env, policy))
    env.close()
    returns = [run[0] for run in runs]
    successes = sum(run[1] for run in runs)
    interval, rate = (
        stratified_bootstrap_interval([returns], mean),
        wilson_interval(successes, episodes),
    )
    result: dict[str, Any] = {
        "episodes": episodes,
        "return_mean": round(float(np.mean(returns)), 2),
        "return_std": round(float(np.std(returns)), 2),
        "return_interval": [round(interval.low, 2), round(interval.high, 2)],
        "success_rate": round(successes / episodes, 3),
        "success_interval": [round(rate.low, 3), round(rate.high, 3)],
    }
    names = runs[0][2]
    if names:
        result["walk"] = {
            name: round(float(np.mean([run[2][name] for run in runs])), 4) for name in names
        }
    return result


def paper_of(env_id: str) -> dict[str, Any] | None:
    """The paper's results of random actions on the robot."""
    if env_id not in RETURNS or env_id.endswith("Sim-v0"):
        return None
    success = {"random_success": SUCCESS[env_id]["random"]} if env_id in SUCCESS else {}
    return {"random": list(RETURNS[env_id]["random"])} | success


def main(session: Session) -> None:
    """Measure and write; results of other environments stay in the result."""
    args = session.parse(envs=list(CONTROLLERS), episodes=50)
    torch.set_num_threads(1)
    table: dict[str, Any] = {}
    for env_id in args.envs:
        size = len(bricksrl.envs.get_task(env_id).interface.commands)
        policies: dict[str, Policy] = {
            "random": lambda state, size=size: state.set("action", 2.0 * torch.rand(size) - 1.0),  # type: ignore[misc]
            "scripted": CONTROLLERS[env_id],
        }
        table[env_id] = {
            name: measure(env_id, policy, args.episodes) for name, policy in policies.items()
        }
        table[env_id]["scripted"]["controller"] = (CONTROLLERS[env_id].__doc__ or "").splitlines()[
            0
        ]
        table[env_id]["paper"] = paper_of(env_id)
        if env_id in REASONS:
            table[env_id]["why_they_differ"] = REASONS[env_id]
        print(env_id, table[env_id], flush=True)
    known: dict[str, Any] = session.known().get("environments", {})
    known.update(table)
    session.write(
        {"environments": {env_id: known[env_id] for env_id in CONTROLLERS if env_id in known}}
    )
