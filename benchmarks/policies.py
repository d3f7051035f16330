"""Trained robots in the box: a small SAC for each environment, its weights, settings and returns in bricksrl/policies/trained.

    python -m benchmarks policies --envs RunAway-v0

Each learns with small networks, is evaluated every few episodes, and the best of these is kept as plain numbers and evaluated
on episodes that it has not seen. The camera task is left out: its policy reads images.
"""

from __future__ import annotations

import csv
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from bricksrl.agents import preset
from bricksrl.policies.boxed import FOLDER, TRAINED, path_of

EPISODES = {
    "RunAway-v0": 15,
    "Spinning-v0": 20,
    "WalkerSim-v0": 60,
    "WalkerSim-v1": 60,
    "RoboArmSim-v0": 60,
    "Walker-v1": 50,
    "Walker-v0": 50,
    "LineFollow-v0": 40,
    "Park-v0": 80,
    "RoboArm-v0": 60,
}
"""Training episodes of each environment."""
HIDDEN = (64, 64)
SEED, EVALUATED_SEED = 0, 5000
EVALUATED_EPISODES = 20


def run(env: str, episodes: int, out: str) -> dict[str, Any]:
    """Train a policy into the file ``out``; returns its row of the table."""
    from bricksrl.evaluation import evaluate
    from bricksrl.policies import load_policy
    from bricksrl.policies.plain import plain_of
    from bricksrl.training import TrainConfig, train

    with tempfile.TemporaryDirectory() as parent:
        folder, every = Path(parent) / "run", max(1, episodes // 8)
        settings = replace(preset("default", "sac"), hidden=HIDDEN)
        options = {"settings": settings, "eval_every": every, "record": False, "run_dir": folder}
        train(TrainConfig(env, "sac", episodes, SEED, **options))
        result = evaluate(folder, episodes=EVALUATED_EPISODES, seed=EVALUATED_SEED, which="best", save=False)
        plain_of(load_policy(folder, which="best")).save(Path(out))
    return {
        "env": env,
        "agent": "sac",
        "hidden": " ".join(map(str, HIDDEN)),
        "episodes": episodes,
        "seed": SEED,
        "return": round(result.return_mean, 2),
        "success": result.success_rate,
    }


def main(session: Session) -> None:
    """Train, and write the files and their table; policies of other environments stay."""
    session.parser.add_argument("--envs", nargs="+", default=list(EPISODES), choices=list(EPISODES))
    session.parser.add_argument("--episodes", type=int, help="of each training (default: those of the table)")
    args = session.parse()
    place = session.place_of(FOLDER)
    jobs = {env: (env, args.episodes or EPISODES[env], str(place / path_of(env).name)) for env in args.envs}
    rows: dict[str, Any] = {} if session.is_apart else dict(TRAINED)
    rows |= {row["env"]: row for row in session.outcomes(run, jobs)}
    with (place / "policies.csv").open("w", encoding="utf-8", newline="") as file:
        file.write(f"# Written by `python -m benchmarks policies`; returns over {EVALUATED_EPISODES} episodes of other seeds.\n")
        table = csv.DictWriter(file, list(next(iter(rows.values()))), lineterminator="\n")
        table.writeheader()
        table.writerows(rows[env] for env in EPISODES if env in rows)
