"""SAC on each robot over each link of the virtual hub: trained and evaluated there, with the
default preset.

    python -m benchmarks link_profiles
    python -m benchmarks link_profiles --envs Walker-v1 --links linux --seeds 3

Walker-v1 also with the time of a step that is given behind its name. Other environments and links
stay in the result.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.robots import EPISODES, run, summary
from benchmarks.session import Session
from brickhub.hub.link.profiles import PROFILES

TASKS: dict[str, tuple[str, dict[str, Any]]] = {
    **{env_id: (env_id, {}) for env_id in EPISODES if env_id != "RoboArm_mixed-v0"},
    **{
        f"Walker-v1, {step_ms} ms": ("Walker-v1", {"step_ms": step_ms})
        for step_ms in (150, 100, 60)
    },
}
"""Environment and its options, by the name of the row."""


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--episodes", type=int, help="instead of those of the benchmark robots")
    args = session.parse(envs=list(TASKS), links=list(PROFILES), seeds=5)
    cells = list(itertools.product(args.envs, args.links))
    parts = {}
    for row, link in cells:
        env_id, options = TASKS[row]
        episodes = args.episodes or EPISODES[env_id]
        name = f"{row.replace(', ', '-').replace(' ', '')}-{link}-{episodes}"
        parts[name] = (env_id, "sac", episodes, {"link": link, "options": options})
    known: dict[str, Any] = session.known().get("environments", {})
    for (row, link), runs in zip(
        cells, session.by_seed(run, parts, args.seeds).values(), strict=True
    ):
        known.setdefault(row, {})[link] = {
            "episodes": args.episodes or EPISODES[TASKS[row][0]],
            **summary(runs),
            "seeds": runs,
        }
        print(
            row,
            link,
            {name: known[row][link][name] for name in ("return_mean", "return_interval")},
            flush=True,
        )
    ordered = {
        row: {link: known[row][link] for link in PROFILES if link in known[row]}
        for row in TASKS
        if row in known
    }
    session.write({"agent": "sac", "preset": "default", "environments": ordered})
