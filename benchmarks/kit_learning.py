"""Tasks learned on the cart of LEGO's kits through LEGO's own package, next to the same tasks on a robot with a hub.

    python -m benchmarks kit_learning
    python -m benchmarks kit_learning --envs Spinning-v0 --seeds 1

The cart's devices are virtual, and so is the hub of the other robot, whose numbers are from `python -m benchmarks robots`: the
same task, rate and number of episodes. Needs the extra `legoeducation`.
"""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

from benchmarks.robots import EPISODES, run, summary
from benchmarks.session import Session, read_result

ENVS = ("LineFollow-v0", "Park-v0", "Spinning-v0")
on_cart = partial(run, robot="cart")


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--envs", nargs="+", default=list(ENVS), choices=ENVS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, help="instead of those of the robots with a hub")
    args = session.parse()
    counts = {env_id: args.episodes or EPISODES[env_id] for env_id in args.envs}
    jobs = {
        f"{env_id}-{count}-{seed}": (env_id, "sac", count, seed) for env_id, count in counts.items() for seed in range(args.seeds)
    }
    found = session.outcomes(on_cart, jobs)
    hubs = read_result(session.published("robots"))["environments"]
    known: dict[str, Any] = session.known().get("environments", {})
    for env_id, count in counts.items():
        runs = list(itertools.islice(found, args.seeds))
        cart, hub = summary(runs), hubs[env_id]["summary"]
        share = cart["return_mean"] / hub["return_mean"]
        known[env_id] = {"episodes": count, "cart": cart, "hub": hub, "share_of_return": round(share, 3), "seeds": runs}
        print(env_id, known[env_id]["share_of_return"], cart, flush=True)
    session.write({"agent": "sac", "environments": {env_id: known[env_id] for env_id in ENVS if env_id in known}})
