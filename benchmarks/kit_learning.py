"""Tasks learned on the cart of LEGO's kits through LEGO's own package, next to the same tasks on a
robot with a hub.

    python -m benchmarks kit_learning
    python -m benchmarks kit_learning --envs Spinning-v0 --seeds 1

The cart's devices are virtual, and so is the hub of the other robot. Both have the same rate: the
hub streams, as the devices of the kits always do, and both links are those of the default physics.
Needs the extra `legoeducation`.

Hand-written controllers show what the devices are worth without the luck of learning. The share of
the return is as good as its zero, which is arbitrary: Park subtracts 0.6 a step. The share of the
score counts from the return of random actions instead.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks import baselines
from benchmarks.robots import run, summary
from benchmarks.scripted import CONTROLLERS
from benchmarks.session import Session
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.reference_returns import REFERENCES

EPISODES = {"LineFollow-v0": 20, "Park-v0": 20, "Spinning-v0": 15}
ROBOTS: dict[str, dict[str, Any]] = {
    "hub": {"streaming": True},
    "cart": {"options": {"robot": "cart"}},
}
_SCRIPTED_EPISODES, _TIMED_STEPS = 10, 50


def train_on(robot: str, env_id: str, episodes: int, seed: int) -> dict[str, Any]:
    """Train and evaluate one agent on one of the two robots."""
    return run(env_id, "sac", episodes, ROBOTS[robot], seed)


def by_hand(robot: str, env_id: str) -> dict[str, Any]:
    """Mean duration of a step, in the robot's time, and the return of the hand-written
    controller."""
    options = EnvOptions(**ROBOTS[robot])
    env = make(env_id, options, seed=0)
    state, times_s = env.reset(), []
    for _ in range(_TIMED_STEPS):
        state = env.step(env.rand_action(state))["next"]
        times_s.append(env.timing.hub_time_s)
    env.close()
    measured = baselines.measure(env_id, CONTROLLERS[env_id], _SCRIPTED_EPISODES, options)
    step_ms = round(1000 * (times_s[-1] - times_s[0]) / (_TIMED_STEPS - 1))
    return {"step_ms": step_ms, "scripted_return": measured["return_mean"]}


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--episodes", type=int, help="instead of 20, and 15 of Spinning-v0")
    args = session.parse(envs=list(EPISODES), seeds=5)
    counts = {env_id: args.episodes or EPISODES[env_id] for env_id in args.envs}
    parts = list(itertools.product(range(args.seeds), counts, ROBOTS))
    jobs = {
        f"{env}-{robot}-{counts[env]}-{seed}": (robot, env, counts[env], seed)
        for seed, env, robot in parts
    }
    found = dict(zip(parts, session.outcomes(train_on, jobs), strict=True))
    known: dict[str, Any] = session.known().get("environments", {})
    for env_id, count in counts.items():
        runs = {
            robot: [found[seed, env_id, robot] for seed in range(args.seeds)] for robot in ROBOTS
        }
        known[env_id] = entry(env_id, count, runs)
        print(
            env_id,
            {key: value for key, value in known[env_id].items() if key != "seeds"},
            flush=True,
        )
    session.write(
        {
            "agent": "sac",
            "environments": {env_id: known[env_id] for env_id in EPISODES if env_id in known},
        }
    )


def entry(env_id: str, episodes: int, runs: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Result of one task by the runs on both robots."""
    found = {robot: {**summary(runs[robot]), **by_hand(robot, env_id)} for robot in ROBOTS}
    cart, hub = (found[robot]["return_mean"] for robot in ("cart", "hub"))
    random = REFERENCES[env_id]["random"]
    return {
        "episodes": episodes,
        **found,
        "share_of_return": round(cart / hub, 3) if hub > 0 else None,
        "share_of_score": round((cart - random) / (hub - random), 3),
        "seeds": runs,
    }
