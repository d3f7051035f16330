"""The numbers that a newcomer repeats: the training of docs/start.md, with the arithmetic of other
processors.

    python -m benchmarks first_numbers [--episodes 20] [--arithmetics ...]

Processors round differently, and learning amplifies it. The command of the page is run with this
processor's own arithmetic, and with those of `benchmarks.shaken`; the page says between which
returns they lie.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from benchmarks.shaken import ARITHMETICS, environment_of

COMMAND = ("train", "Walker-v1", "--seed", "0", "--no-film")
OWN = "this processor"


def trained(arithmetic: str, episodes: int) -> dict[str, Any]:
    """Mean return and rate of success in the evaluation after the training."""
    variables = {} if arithmetic == OWN else environment_of(arithmetic)
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "walk"
        words = [*COMMAND, "--episodes", str(episodes), "--run", str(run)]
        subprocess.run(  # noqa: S603  our own arguments
            [sys.executable, "-m", "bricksrl", *words],
            env={**os.environ, **variables},
            stdout=subprocess.DEVNULL,
            check=True,
        )
        evaluation = json.loads((run / "evaluation.json").read_text(encoding="utf-8"))
    return {name: evaluation[name] for name in ("return_mean", "success_rate")}


def main(session: Session) -> int:
    """Train with each arithmetic, and write what came of it."""
    args = session.parse(episodes=20, arithmetics=[OWN, *ARITHMETICS])
    parts = {name.replace(" ", "-"): (name, args.episodes) for name in args.arithmetics}
    found = dict(zip(args.arithmetics, session.outcomes(trained, parts), strict=True))
    for name, run in found.items():
        print(f"{name}: return {run['return_mean']:.2f}, success {run['success_rate']:.0%}")
    returns = [run["return_mean"] for run in found.values()]
    print(f"returns from {min(returns):.2f} to {max(returns):.2f}")
    session.write({"episodes": args.episodes, "runs": found})
    return 0
