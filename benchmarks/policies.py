"""Trained robots in the box: a small SAC for each environment, its weights, settings and returns in
bricksrl/policies/trained.

    python -m benchmarks policies --envs RunAway-v0

Each learns with small networks, is evaluated every few episodes, and the best of these is kept as
plain numbers and evaluated on episodes that it has not seen. The camera task is left out: its
policy reads images.
"""

from __future__ import annotations

import csv
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.session import Session
from bricksrl.agents import preset
from bricksrl.errors import DescriptionError
from bricksrl.policies.by_name import FOLDER, TRAINED, PlainPolicy, path_of

if TYPE_CHECKING:
    from bricksrl.policies.policy import Policy

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


LAYERS = ("weights", "biases")


def plain_of(policy: Policy) -> PlainPolicy:
    """The numbers of an agent's policy. Raises DescriptionError for one with images, transforms, or
    other layers than an `mlp` of linear layers with ReLU."""
    from tensordict.nn import NormalParamExtractor
    from torch import nn

    from bricksrl.agents.features.encoder import Encoder
    from bricksrl.agents.networks import Actor

    actors = [module for module in policy.modules() if isinstance(module, Actor)]
    encoder, body = (actors[0].encoder, actors[0].body) if len(actors) == 1 else (None, None)
    layers = list(body) if isinstance(body, nn.Sequential) else []
    are_plain = bool(layers) and all(isinstance(layer, nn.Linear | nn.ReLU) for layer in layers)
    if (
        not are_plain
        or not isinstance(encoder, Encoder)
        or encoder.images
        or encoder.numbers.normalize
    ):
        raise DescriptionError(
            "only linear layers with ReLU on plain observations can be written as plain numbers"
        )
    numbers, linear = encoder.numbers, [layer for layer in layers if isinstance(layer, nn.Linear)]
    ends = (
        *numbers.seen.bounds(),
        numbers.linear,
        numbers.scale,
        numbers.offset,
        numbers.angle_matrix,
    )
    tensors = (*ends, numbers.goal, numbers.reached, numbers.period, numbers.goal_scale)
    weights = [layer.weight.detach().cpu().numpy() for layer in linear]
    biases = [layer.bias.detach().cpu().numpy() for layer in linear]
    if isinstance(actors[0].head, NormalParamExtractor):  # the best action is that of the location
        m = len(biases[-1]) // 2
        weights[-1], biases[-1] = weights[-1][:m], biases[-1][:m]
    arrays = [*(tensor.cpu().numpy() for tensor in tensors), tuple(weights), tuple(biases)]
    values: dict[str, Any] = dict(
        zip((field.name for field in fields(PlainPolicy)), arrays, strict=True)
    )
    return PlainPolicy(**values)


def save(policy: PlainPolicy, path: Path) -> None:
    """Write a policy to a file ``.npz``; equal policies give equal files."""
    arrays = {
        field.name: getattr(policy, field.name)
        for field in fields(policy)
        if field.name not in LAYERS
    }
    layers = {
        f"{name}_{i}": array for name in LAYERS for i, array in enumerate(getattr(policy, name))
    }
    np.savez_compressed(path, **arrays, **layers)


def run(env: str, episodes: int, out: str) -> dict[str, Any]:
    """Train a policy into the file ``out``; returns its row of the table."""
    from bricksrl.evaluation import evaluate
    from bricksrl.policies import load_policy
    from bricksrl.training import TrainConfig, train

    with tempfile.TemporaryDirectory() as parent:
        folder, every = Path(parent) / "run", max(1, episodes // 8)
        settings = replace(preset("default", "sac"), hidden=HIDDEN)
        options = {"settings": settings, "eval_every": every, "record": False, "run_dir": folder}
        train(TrainConfig(env, "sac", episodes, SEED, **options))
        result = evaluate(
            folder, episodes=EVALUATED_EPISODES, seed=EVALUATED_SEED, which="best", save=False
        )
        save(plain_of(load_policy(folder, which="best")), Path(out))
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
    session.parser.add_argument(
        "--episodes", type=int, help="of each training (default: those of the table)"
    )
    args = session.parse(envs=list(EPISODES))
    place = session.place_of(FOLDER)
    jobs = {
        env: (env, args.episodes or EPISODES[env], str(place / path_of(env).name))
        for env in args.envs
    }
    rows: dict[str, Any] = {} if session.is_apart else dict(TRAINED)
    rows |= {row["env"]: row for row in session.outcomes(run, jobs)}
    with (place / "policies.csv").open("w", encoding="utf-8", newline="") as file:
        file.write(
            f"# Written by `python -m benchmarks policies`; returns over {EVALUATED_EPISODES} "
            "episodes of other seeds.\n"
        )
        table = csv.DictWriter(file, list(next(iter(rows.values()))), lineterminator="\n")
        table.writeheader()
        table.writerows(rows[env] for env in EPISODES if env in rows)
