"""The example of docs/libraries.md: Stable-Baselines3's SAC on Walker-v1, with our features and
without.

    python -m benchmarks other_library [--seeds 3] [--steps 2000]

The code is that of the page, with another seed, and for ``raw`` without its wrapper. The trained
agent then plays five episodes without exploration. The share is that of the hand-written trot's
mean return.
"""

from __future__ import annotations

import re
import statistics
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.session import Session
from bricksrl.envs.reference_returns import REFERENCES

PAGE = Path(__file__).parents[1] / "docs" / "libraries.md"
ENV, EPISODES = "Walker-v1", 5
WRAPPED = re.compile(r"FeatureObservation\((gymnasium\.make\(.*\))\)")
WAYS = ("features", "raw")


def example(way: str, seed: int, steps: int) -> str:
    """The page's code for a way, seed and number of steps."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = [block for block in blocks if WRAPPED.search(block)]
    if way == "raw":
        code = WRAPPED.sub(r"\1", code)
    return str(code).replace("seed=0", f"seed={seed}").replace("learn(2000)", f"learn({steps})")


def learned(way: str, seed: int, steps: int) -> dict[str, Any]:
    """Returns of the agent that the example trains."""
    import torch

    torch.set_num_threads(1)
    names: dict[str, Any] = {}
    exec(example(way, seed, steps), names)  # noqa: S102  our own page
    env, agent, returns = names["env"], names["agent"], []
    for episode in range(EPISODES):
        observation, total, ended = env.reset(seed=1000 + episode)[0], 0.0, False
        while not ended:
            observation, reward, terminated, truncated, _ = env.step(
                agent.predict(observation, deterministic=True)[0]
            )
            total, ended = total + float(reward), terminated or truncated
        returns.append(round(total, 2))
    env.close()
    return {"seed": seed, "returns": returns, "mean": round(float(np.mean(returns)), 2)}


def main(session: Session) -> None:
    """Train all of them and write the returns."""
    session.parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    args = session.parse(seeds=3, steps=2000)
    trot = REFERENCES[ENV]["by hand"]
    parts = {
        f"{way}-{seed}-{args.steps}": (way, seed, args.steps)
        for way in args.ways
        for seed in range(args.seeds)
    }
    outcomes = session.outcomes(learned, parts)
    runs = {way: [next(outcomes) for _ in range(args.seeds)] for way in args.ways}
    for way, found in runs.items():
        mean = statistics.mean(run["mean"] for run in found)
        print(
            f"{way:9} {mean:7.1f}, {mean / trot:.2f} of the trot's {trot:.1f}; seeds "
            f"{[run['mean'] for run in found]}"
        )
    setup = {
        "env": ENV,
        "steps": args.steps,
        "stable_baselines3": version("stable-baselines3"),
        "trot": trot,
    }
    session.write({**setup, "runs": runs})
