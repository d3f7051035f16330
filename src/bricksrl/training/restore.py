"""Restoring: the learner of a run, as its checkpoint has it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bricksrl.agents import make_learner
from bricksrl.errors import BricksError, CheckpointError, DescriptionError, RunError
from bricksrl.fields import check_fields
from bricksrl.training.callbacks import Episode
from bricksrl.training.config import TrainConfig
from bricksrl.training.run_folder import RunFolder

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.learner import Learner

Which = Literal["last", "best"]
"""Checkpoint of a run: the last one, or the one of its best evaluation."""


@dataclass(frozen=True)
class Trained:
    """A learner as a checkpoint of a run has it, and the number of episodes that it learned from."""

    learner: Learner
    episodes: int


def load_learner(run_dir: Path | str, env: EnvBase, *, which: Which = "last") -> Trained:
    """The learner of a run, on the CPU, to act in ``env``.

    Raises:
        RunError: there is no run in the folder.
        CheckpointError: it is damaged, or ``env`` observes or acts otherwise than the run's environment.
    """
    folder = RunFolder(Path(run_dir))
    config = folder.read_config()
    learner = make_learner_for(config, env, device="cpu")
    state = load_state(folder, config, env, which=which)
    learner.load_state_dict({key: value for key, value in state["agent"].items() if key != "memory"})
    learner.policy.eval()
    return Trained(learner, len(state["episodes"]))


def one_robot(config: TrainConfig) -> TrainConfig:
    """The config with one robot, the first one, in place of many copies or of a fleet, on the CPU."""
    return replace(config, num_envs=1, robots=1, hub=config.hubs[0], device="cpu")


def resolve_device(name: str) -> str:
    """A device by its name; "auto" is the best one here.

    Raises:
        RunError: there is no such device.
    """
    import torch

    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "mps" if torch.backends.mps.is_available() else "cpu"
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError, NotImplementedError):
        raise RunError(f"there is no device '{name}' here; choose cpu, cuda, mps or auto") from None
    return name


def make_learner_for(config: TrainConfig, env: EnvBase, device: str | None = None) -> Learner:
    """A fresh learner as a config names it, to act in ``env``.

    Raises:
        RunError: there is not enough memory for it, no such device, or no compiler where it is to be compiled.
    """
    device = resolve_device(config.device) if device is None else device
    try:
        learner = make_learner(config.agent, env, config.settings, device)
    except RuntimeError as error:
        if "memory" not in str(error):
            raise
        raise RunError(f"there is not enough memory for the agent {config.agent}; give it smaller networks or memory") from None
    if config.compile:
        from bricksrl.agents.compiled import compile_updates

        compile_updates(learner)
    return learner


def identity_of(config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """What must be equal for a checkpoint to belong to a run."""
    from bricksrl.agents.networks import action_size
    from bricksrl.envs.specs import ObservationLayout

    data = config.to_dict()
    run = {key: data[key] for key in ("env", "agent", "seed", "settings")}
    return {**run, "layout": asdict(ObservationLayout.of(env)), "action_size": action_size(env)}


def load_state(folder: RunFolder, config: TrainConfig, env: EnvBase, *, which: Which = "last") -> dict[str, Any]:
    """All of a run's checkpoint, looked over.

    Raises:
        CheckpointError: it is damaged, or belongs to another run or environment; or there is no best one.
    """
    from bricksrl.training.checkpoint import load_checkpoint

    if which == "best" and not folder.best_path.exists():
        raise CheckpointError(f"the run in {folder.path} has no best checkpoint; train with evaluations, or take the last one")
    path = folder.checkpoint_path if which == "last" else folder.best_path
    state, identity = load_checkpoint(path), identity_of(config, env)
    try:
        is_same = bool(_with_later_settings(state.get("identity"), config) == identity)
    except RuntimeError:  # tensors in the place of numbers
        is_same = False
    if not is_same:
        raise CheckpointError(f"{path} belongs to another config or environment; use those that it was made with")
    try:
        _check_state(state)
    except (AttributeError, BricksError, LookupError, OverflowError, RuntimeError, TypeError, ValueError):
        raise CheckpointError(f"{path} lacks a part of a run's state; restore it from a copy or train anew") from None
    return state


def _with_later_settings(identity: Any, config: TrainConfig) -> Any:
    """The identity in a checkpoint, and the settings that there were not yet when it was written, with their defaults."""
    if not isinstance(identity, dict) or not isinstance(identity.get("settings"), dict):
        return identity
    try:
        usual = TrainConfig(config.env, config.agent, settings=type(config.settings)()).to_dict()["settings"]
    except (DescriptionError, TypeError):
        return identity
    return {**identity, "settings": {**usual, **identity["settings"]}}


def _check_state(state: dict[str, Any]) -> None:
    """Raise some error unless whatever goes on from it finds what it needs; the learner sees to its own part."""
    import torch

    for episode in map(Episode.from_dict, state["episodes"]):
        check_fields(Episode, vars(episode))
        for value in (*episode.losses.values(), episode.updates_per_step or 0.0, episode.evaluation or 0.0):
            float(value)
    if any(type(state["pace"][name]) is not int for name in ("asked", "done")):
        raise TypeError
    torch.Generator().set_state(state["generator"])
    float(state["best"] or 0.0)
    for frames in state["collected"]:
        frames["next"]["done"].shape  # noqa: B018
    sizes = {"observation": len(state["identity"]["layout"]["low"]), "action": state["identity"]["action_size"]}
    rows = state["agent"].get("memory", {"rows": {}})["rows"]
    if any(name in rows and rows[name].shape[1:] != (size,) for name, size in sizes.items()):
        raise ValueError
