"""Transforms: what SAC learns behind TorchRL's transforms, compared with none.

    python -m benchmarks transforms

On WalkerSim-v0, with each transform and ``--seeds`` seeds, ``--steps`` steps of the robot. The number of a seed is the mean
return of ``--episodes`` episodes without exploration, of the environment itself: not scaled, each step of the robot counted. A
transform is compared with the plain run by the 95 % interval (Welch) of the difference of means.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torchrl.envs import (
    CatFrames,
    Compose,
    EnvBase,
    FrameSkipTransform,
    ObservationNorm,
    RewardScaling,
    SqueezeTransform,
    Transform,
    TransformedEnv,
    UnsqueezeTransform,
    VecNormV2,
)

import bricksrl
from benchmarks.session import Session
from bricksrl.evaluation.evaluator import evaluate
from bricksrl.training import TrainConfig, train

ENV, KEYS = "WalkerSim-v0", ["observation"]


def drawn_statistics() -> Transform:
    """Normalisation by the mean and deviation of 100 random steps."""
    seen = bricksrl.make(ENV, seed=1234).rollout(100)["observation"]
    return ObservationNorm(seen.mean(0), seen.std(0).clamp_min(1.0), in_keys=KEYS, standard_normal=True)


TRANSFORMS: dict[str, Callable[[], Transform] | None] = {
    "plain": None,
    "ObservationNorm": drawn_statistics,
    "VecNorm": lambda: VecNormV2(in_keys=KEYS),
    "CatFrames": lambda: CatFrames(3, -1, in_keys=KEYS),
    "RewardScaling": lambda: RewardScaling(loc=0.0, scale=0.1),
    "Unsqueeze and Squeeze": lambda: Compose(UnsqueezeTransform(-1, in_keys=KEYS), SqueezeTransform(-1, in_keys=KEYS)),
    "FrameSkip": lambda: FrameSkipTransform(2),
}


def environment(name: str, seed: int) -> EnvBase:
    """The environment behind a transform."""
    torch.manual_seed(seed)
    make, env = TRANSFORMS[name], bricksrl.make(ENV, seed=seed)
    return env if make is None else TransformedEnv(env, make())


def run(name: str, steps: int, episodes: int, seed: int) -> float:
    """Mean return after so many steps of the robot."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir, rounds = Path(folder) / "run", max(1, round(steps / 100))
        train(TrainConfig(ENV, "sac", rounds, seed=seed, run_dir=run_dir, record=False), env=environment(name, seed))
        return evaluate(run_dir, environment(name, seed), episodes=episodes, save=False).return_mean


def difference(values: list[float], plain: list[float]) -> tuple[float, float, float]:
    """Difference of means, and its 95 % interval (Welch)."""
    from scipy import stats

    test = stats.ttest_ind(values, plain, equal_var=False)
    low, high = test.confidence_interval(0.95)
    return sum(values) / len(values) - sum(plain) / len(plain), float(low), float(high)


def main(session: Session) -> None:
    """Run all and write the results."""
    session.parser.add_argument("--transforms", nargs="+", default=list(TRANSFORMS), choices=list(TRANSFORMS))
    session.parser.add_argument("--seeds", type=int, default=10)
    session.parser.add_argument("--steps", type=int, default=1000)
    session.parser.add_argument("--episodes", type=int, default=20)
    args = session.parse()
    size = args.steps, args.episodes
    cells = {f"{name.replace(' ', '-')}-{args.steps}-{args.episodes}": (name, *size) for name in args.transforms}
    returns = dict(zip(args.transforms, session.by_seed(run, cells, args.seeds).values(), strict=True))
    results: dict[str, Any] = {}
    for name, values in returns.items():
        results[name] = {"returns": values}
        if name != "plain" and "plain" in returns and args.seeds > 1:
            results[name]["difference"], *results[name]["interval"] = difference(values, returns["plain"])
        print(name, results[name], flush=True)
    session.write({"env": ENV, "steps": args.steps, "transforms": results})
