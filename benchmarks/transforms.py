"""Transforms: what SAC learns behind TorchRL's transforms, compared with none.

    python -m benchmarks transforms
    python -m benchmarks transforms --camera --seeds 3 --episodes 100

On WalkerSim-v0, with each transform and ``--seeds`` seeds, ``--steps`` steps of the robot. The
number of a seed is the mean return of ``--episodes`` episodes without exploration, of the
environment itself: not scaled, each step of the robot counted. A transform is compared with the
plain run by the 95 % interval (Welch) of the difference of means.

``--camera``: on RoboArm_mixed-v0, 64 numbers of a frozen random convolution in place of the image,
beside the image itself; the number of a seed is the rate of success after ``--camera-episodes``
episodes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.data import Composite, Unbounded
from torchrl.envs import (
    CatFrames,
    Compose,
    EnvBase,
    ExcludeTransform,
    FrameSkipTransform,
    ObservationNorm,
    ObservationTransform,
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
CAMERA_ENV, EMBEDDED, IMAGE_PX = "RoboArm_mixed-v0", 64, 64


def drawn_statistics() -> Transform:
    """Normalisation by the mean and deviation of 100 random steps."""
    seen = bricksrl.make(ENV, seed=1234).rollout(100)["observation"]
    return ObservationNorm(
        seen.mean(0), seen.std(0).clamp_min(1.0), in_keys=KEYS, standard_normal=True
    )


class RandomConvolution(ObservationTransform):  # type: ignore[misc]
    """``EMBEDDED`` numbers of a frozen convolution, drawn by a seed, of each image ``[side, side,
    3]``."""

    def __init__(self, seed: int) -> None:
        super().__init__(in_keys=["image"], out_keys=["embedding"])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            # 4 maps of 4 x 4
            layers = (nn.Conv2d(3, 16, 8, 4), nn.ReLU(), nn.Conv2d(16, 4, 6, 3), nn.Flatten())
            self.network = nn.Sequential(*layers).requires_grad_(False)

    def _apply_transform(self, image: Tensor) -> Tensor:
        pixels = image.reshape(-1, IMAGE_PX, IMAGE_PX, 3).movedim(-1, 1) / 255
        numbers: Tensor = self.network(pixels).view(*image.shape[:-3], EMBEDDED)
        return numbers

    def _reset(
        self, _tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        spec = observation_spec.clone()
        spec["embedding"] = Unbounded((*spec.shape, EMBEDDED))
        return spec


CAMERA_TRANSFORMS: dict[str, Callable[[int], Transform] | None] = {
    "image": None,
    "embedding": lambda seed: Compose(RandomConvolution(seed), ExcludeTransform("image")),
}
TRANSFORMS: dict[str, Callable[[], Transform] | None] = {
    "plain": None,
    "ObservationNorm": drawn_statistics,
    "VecNorm": lambda: VecNormV2(in_keys=KEYS),
    "CatFrames": lambda: CatFrames(3, -1, in_keys=KEYS),
    "RewardScaling": lambda: RewardScaling(loc=0.0, scale=0.1),
    "Unsqueeze and Squeeze": lambda: Compose(
        UnsqueezeTransform(-1, in_keys=KEYS), SqueezeTransform(-1, in_keys=KEYS)
    ),
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
        train(
            TrainConfig(ENV, "sac", rounds, seed=seed, run_dir=run_dir, record=False),
            env=environment(name, seed),
        )
        return evaluate(run_dir, environment(name, seed), episodes=episodes, save=False).return_mean


def camera_run(name: str, episodes: int, evaluated: int, seed: int) -> float:
    """Rate of success after so many episodes in the camera task."""

    def environment() -> EnvBase:
        make, env = CAMERA_TRANSFORMS[name], bricksrl.make(CAMERA_ENV, seed=seed)
        return env if make is None else TransformedEnv(env, make(seed))

    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        train(
            TrainConfig(CAMERA_ENV, "sac", episodes, seed=seed, run_dir=run_dir, record=False),
            env=environment(),
        )
        rate = evaluate(run_dir, environment(), episodes=evaluated, save=False).success_rate
    return rate or 0.0


def difference(values: list[float], plain: list[float]) -> tuple[float, float, float]:
    """Difference of means, and its 95 % interval (Welch)."""
    from scipy import stats

    test = stats.ttest_ind(values, plain, equal_var=False)
    low, high = test.confidence_interval(0.95)
    return sum(values) / len(values) - sum(plain) / len(plain), float(low), float(high)


def main(session: Session) -> None:
    """Run all and write the results."""
    session.parser.add_argument(
        "--camera", action="store_true", help="measure the camera task instead"
    )
    args = session.parse(
        transforms=list(TRANSFORMS), seeds=10, steps=1000, episodes=20, camera_episodes=250
    )
    if args.camera:
        trained = args.camera_episodes
        cells = {
            f"{name}-{trained}-{args.episodes}": (name, trained, args.episodes)
            for name in CAMERA_TRANSFORMS
        }
        rates = dict(
            zip(
                CAMERA_TRANSFORMS,
                session.by_seed(camera_run, cells, args.seeds).values(),
                strict=True,
            )
        )
        session.write({"env": CAMERA_ENV, "episodes": trained, "success": rates}, "_camera")
        return
    size = args.steps, args.episodes
    cells = {
        f"{name.replace(' ', '-')}-{args.steps}-{args.episodes}": (name, *size)
        for name in args.transforms
    }
    returns = dict(
        zip(args.transforms, session.by_seed(run, cells, args.seeds).values(), strict=True)
    )
    results: dict[str, Any] = {}
    for name, values in returns.items():
        results[name] = {"returns": values}
        if name != "plain" and "plain" in returns and args.seeds > 1:
            results[name]["difference"], *results[name]["interval"] = difference(
                values, returns["plain"]
            )
        print(name, results[name], flush=True)
    session.write({"env": ENV, "steps": args.steps, "transforms": results})
