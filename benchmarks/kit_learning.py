"""Tasks learned on the cart of LEGO's kits through LEGO's own package, next to the same tasks on a robot with a hub.

    python -m benchmarks kit_learning
    python -m benchmarks kit_learning --envs Spinning-v0 --seeds 1

The cart's devices are virtual, and so is the hub of the other robot. Both have the same rate: the hub streams, as the devices of
the kits always do, so that a step takes the task's time and no more. Needs the extra `legoeducation`.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.robots import EPISODES, run, summary
from benchmarks.session import Session

ENVS = ("LineFollow-v0", "Park-v0", "Spinning-v0")
ROBOTS: dict[str, dict[str, Any]] = {"cart": {"options": {"robot": "cart"}}, "hub": {"streaming": True}}


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--envs", nargs="+", default=list(ENVS), choices=ENVS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, help="instead of those of the robots with a hub")
    args = session.parse()
    counts = {env_id: args.episodes or EPISODES[env_id] for env_id in args.envs}
    cells = itertools.product(counts.items(), ROBOTS.items())
    parts = {f"{env_id}-{robot}-{count}": (env_id, "sac", count, config) for (env_id, count), (robot, config) in cells}
    found = session.by_seed(run, parts, args.seeds)
    known: dict[str, Any] = session.known().get("environments", {})
    for env_id, count in counts.items():
        runs = {robot: found[f"{env_id}-{robot}-{count}"] for robot in ROBOTS}
        cart, hub = (summary(runs[robot]) for robot in ROBOTS)
        share = round(cart["return_mean"] / hub["return_mean"], 3) if hub["return_mean"] > 0 else None
        known[env_id] = {"episodes": count, "cart": cart, "hub": hub, "share_of_return": share, "seeds": runs}
        print(env_id, share, cart, hub, flush=True)
    session.write({"agent": "sac", "environments": {env_id: known[env_id] for env_id in ENVS if env_id in known}})
