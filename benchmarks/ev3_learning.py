"""Tasks learned on the virtual EV3 driver, next to the same tasks on the robots with a SPIKE hub.

    python -m benchmarks ev3_learning --jobs 1
    python -m benchmarks ev3_learning --envs Spinning-v0 --seeds 1

Nobody has published how long an exchange with an EV3 over USB takes: 5 to 20 ms are assumed, and
the seeds are spread over that range. The numbers of the other robots, the scout for LineFollow-v0
and the 2Wheeler elsewhere, are those of the benchmark `robots`: the same agent, episodes, steps and
evaluation, over Bluetooth.

The share of the return is as good as its zero, which is arbitrary. The share of the score counts
from the return of random actions instead.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.robots import EPISODES, run, summary
from benchmarks.session import Session, read_result
from brickhub.hub.link.profiles import LinkProfile
from bricksrl.envs.reference_returns import REFERENCES
from bricktwin.twin.physics import Physics

ENVS = ("RunAway-v0", "Spinning-v0", "LineFollow-v0", "Park-v0")
FASTEST_MS, SLOWEST_MS = 5.0, 20.0
"""Times of an exchange that are assumed."""


def exchange_ms(seed: int, seeds: int) -> float:
    """Time of an exchange of a seed."""
    share = seed / (seeds - 1) if seeds > 1 else 0.5
    return FASTEST_MS + share * (SLOWEST_MS - FASTEST_MS)


def train_on(env_id: str, episodes: int, exchange: float, seed: int) -> dict[str, Any]:
    """Train and evaluate one agent."""
    # command and answer wait for a connection event each
    physics = Physics().with_link(LinkProfile(exchange / 2))
    found = run(
        env_id, "sac", episodes, {"physics": physics, "options": {"robot": "ev3-driver"}}, seed
    )
    return {**found, "exchange_ms": exchange}


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--episodes", type=int, help="instead of those of the benchmark robots")
    args = session.parse(envs=list(ENVS), seeds=5)
    parts = list(itertools.product(args.envs, range(args.seeds)))
    jobs = {}
    for env_id, seed in parts:
        count = args.episodes or EPISODES[env_id]
        exchange = exchange_ms(seed, args.seeds)
        jobs[f"{env_id}-{count}-{exchange:g}-{seed}"] = (env_id, count, exchange, seed)
    found = dict(zip(parts, session.outcomes(train_on, jobs), strict=True))
    others = read_result(session.published("robots"))["environments"]
    known: dict[str, Any] = session.known().get("environments", {})
    for env_id in args.envs:
        runs = [found[env_id, seed] for seed in range(args.seeds)]
        known[env_id] = entry(env_id, args.episodes or EPISODES[env_id], runs, others[env_id])
        print(
            env_id,
            {key: value for key, value in known[env_id].items() if key != "seeds"},
            flush=True,
        )
    session.write(
        {
            "agent": "sac",
            "environments": {env_id: known[env_id] for env_id in ENVS if env_id in known},
        }
    )


def entry(
    env_id: str, episodes: int, runs: list[dict[str, Any]], other: dict[str, Any]
) -> dict[str, Any]:
    """Result of one task by the runs of the EV3 and by the other robot's result."""
    ev3 = summary(runs)
    hub = {
        key: other["summary"].get(key) for key in ("return_mean", "return_interval", "success_rate")
    }
    random = REFERENCES[env_id]["random"]
    ev3_return, hub_return = ev3["return_mean"], hub["return_mean"]
    return {
        "episodes": episodes,
        "ev3": ev3,
        "hub": hub,
        "share_of_return": round(ev3_return / hub_return, 3) if hub_return > 0 else None,
        "share_of_score": round((ev3_return - random) / (hub_return - random), 3),
        "seeds": runs,
    }
