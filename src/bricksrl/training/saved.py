"""The agent of a run, made anew and as its checkpoint has it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bricksrl.agents import make_agent
from bricksrl.errors import CheckpointError, RunError
from bricksrl.training.config import TrainConfig, check_types
from bricksrl.training.learner import Pace
from bricksrl.training.observer import Episode
from bricksrl.training.run import RunFolder

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent


@dataclass(frozen=True)
class Trained:
    """An agent as a run's last checkpoint has it, and the number of episodes that it learned from."""

    agent: Agent
    episodes: int


def load_agent(run_dir: Path, env: EnvBase) -> Trained:
    """The agent of a run, to act in ``env``.

    Raises:
        RunError: there is no run in the folder.
        CheckpointError: it is damaged, or ``env`` observes or acts otherwise than the run's environment.
    """
    folder = RunFolder(run_dir)
    config = folder.read_config()
    agent = make_agent_for(config, env)
    state = load_state(folder, config, env)
    agent.load_state_dict(state["agent"])
    return Trained(agent, len(state["episodes"]))


def make_agent_for(config: TrainConfig, env: EnvBase) -> Agent:
    """A fresh agent as a config names it, to act in ``env``.

    Raises:
        RunError: there is not enough memory for it.
    """
    from bricksrl.agents.layout import layout_of

    task = getattr(env, "task", None)
    layout, action_size = layout_of(env), int(env.action_spec.shape[-1])
    try:
        return make_agent(config.agent, layout, action_size, config.settings, task)
    except RuntimeError as error:
        if "memory" not in str(error):
            raise
        raise RunError(f"there is not enough memory for the agent {config.agent}; give it smaller networks or memory") from None


def identity_of(config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """What must be equal for a checkpoint to belong to a run."""
    from bricksrl.agents.layout import layout_of

    data = config.to_dict()
    run = {key: data[key] for key in ("env", "agent", "seed", "settings")}
    return {**run, "layout": layout_of(env).to_dict(), "action_size": int(env.action_spec.shape[-1])}


def load_state(folder: RunFolder, config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """All of a run's checkpoint, looked over.

    Raises:
        CheckpointError: it is damaged, or belongs to another run or environment.
    """
    from bricksrl.training.checkpoint import load_checkpoint

    path = folder.checkpoint_path
    state = load_checkpoint(path)
    try:
        is_same = bool(_with_later_settings(state.get("identity"), config) == identity_of(config, env))
    except RuntimeError:  # tensors in the place of numbers
        is_same = False
    if not is_same:
        raise CheckpointError(f"{path} belongs to another config or environment; use those that it was made with")
    try:
        _check_state(state)
    except (AttributeError, LookupError, OverflowError, RuntimeError, TypeError, ValueError):
        raise CheckpointError(f"{path} lacks a part of a run's state; restore it from a copy or train anew") from None
    return state


def _with_later_settings(identity: Any, config: TrainConfig) -> Any:
    """The identity in a checkpoint, and the settings that there were not yet when it was written, as they are without a word."""
    if config.settings is None or not isinstance(identity, dict) or not isinstance(identity.get("settings"), dict):
        return identity
    usual = replace(config, settings=type(config.settings)()).to_dict()["settings"]
    return {**identity, "settings": {**usual, **identity["settings"]}}


def _check_state(state: dict[str, Any]) -> None:
    """Raise some error unless whatever goes on from it finds what it needs; the agent sees to its own part."""
    import torch

    for data in state["episodes"]:
        episode = Episode.from_dict(data)
        check_types(Episode, vars(episode))
        for value in (*episode.losses.values(), episode.updates_per_step or 0.0):
            float(value)
    check_types(Pace, vars(Pace(**state["pace"])))
    torch.Generator().set_state(state["generator"])
    state["agent"].keys()
