"""Small datasets with known content."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from brickhub.entry import Entry
from bricksrl.data import About, Description, Recorder, Step

TOY = Description(
    env="Toy-v0",
    rate_hz=4.0,
    observation=(
        Entry("angle", 0.0, 360.0, "deg", wraps=True),
        Entry("distance", 0.0, 2000.0, "mm"),
    ),
    action=(Entry("motor", -100.0, 100.0, "deg"),),
    robot={"name": "toy", "motors": ["motor"]},
)
SEEING = Description(
    TOY.env, TOY.rate_hz, TOY.observation, TOY.action, TOY.robot, camera="webcam", image_px=16
)


def steps(seed: int, length: int, description: Description = TOY) -> list[Step]:
    """A truncated episode of ``length`` steps with numbers from ``seed``."""
    rng = np.random.default_rng(seed)
    n, m, side = len(description.observation), len(description.action), description.image_px
    states = rng.normal(size=(length + 1, n)).astype(np.float32)
    actions = rng.uniform(-1, 1, (length, m)).astype(np.float32)
    rewards = rng.normal(size=length).astype(np.float32)
    images = rng.integers(0, 256, (length + 1, side, side, 3), dtype=np.uint8)
    return [
        Step(
            observation=states[i],
            action=actions[i],
            reward=float(rewards[i]),
            next_observation=states[i + 1],
            terminated=False,
            truncated=i == length - 1,
            image=images[i] if side else None,
            next_image=images[i + 1] if side else None,
            intervention=i % 3 == 0,
            age_s=0.02,
            hub_time_s=0.25 * (i + 1),
        )
        for i in range(length)
    ]


def record_episode(recorder: Recorder, seed: int, length: int) -> None:
    about = About(
        policy="random", seed=seed, success=seed % 2 == 0, hub="virtual", versions={"bricksrl": "0"}
    )
    recorder.write(steps(seed, length, recorder.description), about)


def record(
    root: Path,
    lengths: tuple[int, ...] = (3, 5, 4),
    description: Description = TOY,
    first_seed: int = 0,
) -> Path:
    """A dataset of episodes of these lengths with seeds 0, 1, 2..."""
    with Recorder(root, description) as recorder:
        for seed, length in enumerate(lengths, first_seed):
            record_episode(recorder, seed, length)
    return root
