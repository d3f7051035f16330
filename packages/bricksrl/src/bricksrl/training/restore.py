"""The state of a run: what is saved with its agent, and a verified checkpoint restored."""

import contextlib
from dataclasses import asdict
from typing import Any, Literal

import torch
from torchrl.envs import EnvBase

from brickhub.fields import check_fields, check_value
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import action_size
from bricksrl.agents.teachers import anchor
from bricksrl.envs.transforms import (
    layout_of,
    load_transform_state,
    prepare,
    transform_state,
)
from bricksrl.errors import (
    BricksError,
    CheckpointError,
)
from bricksrl.training.callbacks import Episode
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.config import TrainConfig, portable
from bricksrl.training.run_folder import RunFolder

Which = Literal["last", "best"]
"""The last checkpoint of a run, or that of its best evaluation."""


def restore(learner: Learner, state: dict[str, Any]) -> None:
    """Restore `Learner.state_dict` of a learner that may be anchored. Raises CheckpointError as
    `Learner.load_state_dict` does, RunError if an anchored one is compiled."""
    loss = state.get("loss")
    if isinstance(loss, dict) and any(str(name).startswith("anchor.") for name in loss):
        anchor(learner)
    learner.load_state_dict(state)


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
    # others: their layout differs
    with contextlib.suppress(AttributeError, LookupError, RuntimeError, TypeError, ValueError):
        load_transform_state(env, state["transforms"], frozen=frozen)
    identity = identity_of(config, env)
    differs = _differences(state.get("identity"), identity)
    if differs and differs <= {"layout", "action_size"}:
        raise CheckpointError(
            f"{folder.path} learned in {config.env}; choose an environment with its observations "
            "and actions"
        )
    if differs:
        raise CheckpointError(
            f"{path} belongs to another config; restore the run's own config.json"
        )
    try:
        _check_state(state)
    except (
        AttributeError,
        BricksError,
        LookupError,
        OverflowError,
        RuntimeError,
        TypeError,
        ValueError,
    ):
        raise CheckpointError(
            f"{path} lacks a part of a run's state; restore a copy or train again"
        ) from None
    return state


def identity_of(config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """Values that must be equal in a checkpoint and its run."""
    data = config.to_dict()
    layout = asdict(layout_of(env))
    run = {key: data[key] for key in ("env", "agent", "seed", "settings")}
    del layout["names"]  # for messages
    return {**run, "layout": layout, "action_size": action_size(env)}


def run_state(env: EnvBase, identity: dict[str, Any], episodes: list[Episode]) -> dict[str, Any]:
    """State of a run in a checkpoint, without its agent.

    ``best`` is the mean return of the best evaluation, ``is_evaluation_due`` whether the last
    episode is to be evaluated yet, and ``recorded`` the number of whole episodes in the run's
    dataset.
    """
    state = {"identity": identity, "episodes": [episode.to_dict() for episode in episodes]}
    progress = {"best": None, "is_evaluation_due": False, "recorded": 0}
    return {
        **state,
        **progress,
        "generator": torch.get_rng_state(),
        "transforms": transform_state(env),
    }


def _differences(saved: Any, identity: dict[str, Any]) -> set[str]:
    """Names of the values that differ in a checkpoint."""
    try:
        saved = portable(saved)
        identity = portable(identity)
        return {key for key, value in identity.items() if value != saved[key]}
    except (AttributeError, LookupError, RuntimeError, TypeError):
        # A part is missing, or there is a tensor in place of a number.
        return set(identity)


def _check_state(state: dict[str, Any]) -> None:
    """Raise any error unless the state is complete; the learner checks its own part."""
    for episode in map(Episode.from_dict, state["episodes"]):
        check_fields(Episode, vars(episode))
        for value in (
            *episode.measures.values(),
            episode.updates_per_step or 0.0,
            episode.evaluation or 0.0,
        ):
            float(value)
    if any(type(state["pace"][name]) is not int for name in ("asked", "done")):
        raise TypeError
    torch.Generator().set_state(state["generator"])
    float(state["best"] or 0.0)
    if type(state["recorded"]) is not int or type(state["is_evaluation_due"]) is not bool:
        raise TypeError
    for frames in state["collected"]:
        frames["next"]["done"].shape  # noqa: B018
    if not isinstance(state["transforms"], dict):
        raise TypeError
    identity = state["identity"]
    shapes = dict(identity["layout"]["vectors"])
    shapes["action"] = [identity["action_size"]]
    # An agent that has remembered nothing yet has no rows.
    rows = state["agent"].get("memory", {"rows": {}})["rows"]
    for name, shape in shapes.items():
        if name in rows and list(rows[name].shape[1:]) != list(shape):
            raise ValueError
