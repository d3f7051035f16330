"""The state of a run: what is saved with its agent, and a verified checkpoint restored."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.fields import check_fields, check_value
from brickhub.files import parsing
from bricksrl.agents.networks import action_size
from bricksrl.envs.transforms import (
    layout_of,
    load_transform_state,
    prepare,
    transform_state,
)
from bricksrl.errors import CheckpointError
from bricksrl.training.callbacks import Episode
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.config import TrainConfig, portable
from bricksrl.training.run_folder import RunFolder

Which = Literal["last", "best"]
"""The last checkpoint of a run, or that of its best evaluation."""


def load_state(
    folder: RunFolder,
    config: TrainConfig,
    env: EnvBase,
    *,
    which: Which = "last",
    frozen: bool = False,
) -> dict[str, Any]:
    """A verified checkpoint of a run; what its transforms have kept, those of ``env`` get,
    ``frozen`` or to run on. Raises CheckpointError if it is damaged, missing, or of another run or
    environment."""
    check_value("which", which, Which)
    if which == "best" and not folder.best_path.exists():
        raise CheckpointError(
            f"the run in {folder.path} has no best checkpoint; train with evaluations, or take "
            "the last one"
        )
    path = folder.checkpoint_path if which == "last" else folder.best_path
    state = load_checkpoint(path)
    prepare(env)
    # This comes before the identity, because what a transform keeps may change the layout. If it
    # does not fit, the transforms are others and so is the layout, which is the error to report.
    misfit: Exception | None = None
    try:
        load_transform_state(env, state["transforms"], frozen=frozen)
    except Exception as error:  # noqa: BLE001
        # A transform of any kind may refuse in any way.
        misfit = error
    identity = identity_of(config, env)
    # The digest says that the file is whole, and not who wrote it. A stranger's may hold anything,
    # and whatever is wrong inside, there is one thing to do about it.
    with parsing(
        CheckpointError(f"{path} lacks a part of a run's state; restore a copy or train again")
    ):
        differing = _differing(state["identity"], identity)
        if not differing:
            _check_parts(state)
        if not differing and misfit is not None:
            raise misfit
    if differing and differing <= {"layout", "action_size"}:
        raise CheckpointError(
            f"{folder.path} learned in {config.env}; choose an environment with its observations "
            "and actions"
        )
    if differing:
        raise CheckpointError(
            f"{path} belongs to another config; restore the run's own config.json"
        )
    return state


def identity_of(config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """Values that must be equal in a checkpoint and its run."""
    data = config.to_dict()
    identity = {key: data[key] for key in ("env", "agent", "seed", "settings")}
    layout = asdict(layout_of(env))
    # Names are for messages only, because weights do not depend on them.
    del layout["names"]
    return {**identity, "layout": layout, "action_size": action_size(env)}


def run_state(
    env: EnvBase,
    identity: dict[str, Any],
    episodes: list[Episode],
) -> dict[str, Any]:
    """State of a run in a checkpoint, without its agent.

    ``best`` is the mean return of the best evaluation, ``is_evaluation_due`` whether the last
    episode is to be evaluated yet, and ``recorded`` the number of whole episodes in the run's
    dataset.
    """
    return {
        "identity": identity,
        "episodes": [episode.to_dict() for episode in episodes],
        "best": None,
        "is_evaluation_due": False,
        "recorded": 0,
        # Without the generator's state, a resumed run would draw other actions than the whole one.
        "generator": torch.get_rng_state(),
        "transforms": transform_state(env),
    }


@dataclass
class _Parts:
    """Parts of a checkpoint beside its agent, whose learner checks it, and their types."""

    episodes: list[dict[str, Any]]
    best: float | None
    is_evaluation_due: bool
    recorded: int
    pace: dict[str, int]
    collected: list[dict[str, Any]]
    transforms: dict[str, Any]
    generator: Tensor


def _differing(saved: dict[str, Any], identity: dict[str, Any]) -> set[str]:
    """Names of the values that differ in a checkpoint. Raises any error where one is missing."""
    # A run may have been moved together with its user's files, so their names count and not the
    # folders.
    saved = portable(saved)
    identity = portable(identity)
    return {key for key, value in identity.items() if value != saved[key]}


def _check_parts(state: dict[str, Any]) -> None:
    """Raise any error unless a run can go on from the state."""
    check_fields(_Parts, {field.name: state[field.name] for field in fields(_Parts)})
    for data in state["episodes"]:
        check_fields(Episode, vars(Episode.from_dict(data)))
    for name in ("asked", "done"):
        _ = state["pace"][name]
    torch.Generator().set_state(state["generator"])
    # A replay buffer accepts rows of any shape, and an update would fail on them much later.
    identity = state["identity"]
    shapes = dict(identity["layout"]["vectors"])
    shapes["action"] = [identity["action_size"]]
    # An agent that has remembered nothing yet has no rows.
    rows = state["agent"].get("memory", {"rows": {}})["rows"]
    for name, shape in shapes.items():
        if name in rows and list(rows[name].shape[1:]) != list(shape):
            raise ValueError(name)
    for frames in state["collected"]:
        _ = TensorDict(frames)["next", "done"]
