"""Learning from datasets, and warm starts from earlier runs."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from bricksrl.errors import CheckpointError, DataError, RunError
from bricksrl.training.restore import load_learner, load_state, one_robot
from bricksrl.training.run_folder import RunFolder

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.learner import Learner
    from bricksrl.data import Episodes
    from bricksrl.training.config import TrainConfig


def read_for(path: str, env: EnvBase, *, images: bool) -> Episodes:
    """The dataset in a folder, or of a run, for an agent in ``env``. Raises DataError if it cannot be used there."""
    from bricksrl.data import describe, load

    data = load(path, images=images)
    for name in ("observation", "action"):
        names, own = ([entry.name for entry in getattr(source, name)] for source in (data.description, describe(env)))
        if names != own:
            reason = f"{path} is of {data.description.env}: its {name} is [{', '.join(names)}], not [{', '.join(own)}]"
            raise DataError(f"{reason}; choose data of this environment, or the environment of the data")
    if not len(data):
        raise DataError(f"the dataset {path} is empty; give one with at least one step")
    return data


def attach_dataset(config: TrainConfig, learner: Learner, env: EnvBase) -> None:
    """Give a learner the config's dataset; also needed when a run resumes. Raises DataError if the dataset cannot be used,
    RunError if the agent cannot use a dataset, or needs one."""
    from bricksrl.agents.bc import recorded_memory
    from bricksrl.agents.replay.buffer import TransitionReplayBuffer

    if learner.imitates and config.data is None:
        raise RunError(f"{config.agent} needs a dataset; give its folder as data")
    if config.data is None:
        return
    if learner.loss is None or learner.on_policy:
        raise RunError(f"the agent {config.agent} cannot use a dataset; choose another agent, or omit the data")
    if not (learner.memory is None or isinstance(learner.memory, TransitionReplayBuffer) or config.updates):
        remedy = "give it a bricksrl.agents.replay.buffer.TransitionReplayBuffer, or omit the data"
        raise RunError(f"{config.agent} has a replay buffer that cannot be mixed with a dataset; {remedy}")
    data = read_for(config.data, env, images="image" in learner.policy.in_keys)
    frames = data.to_tensordict()
    frames["next", "done"][:-1] |= (data.episode[1:] != data.episode[:-1])[:, None]
    frames["next", "done"][-1] = True
    if isinstance(learner.memory, TransitionReplayBuffer):
        learner.dataset = learner.memory.empty_like(max(2, len(frames)))
        learner.dataset.extend(frames)
    else:
        size, keys = getattr(config.settings, "batch_size", 256), learner.policy.in_keys
        learner.dataset = recorded_memory(frames, size, keys, chunk=learner.chunk, device=learner.device)


def warm_start(config: TrainConfig, learner: Learner, env: EnvBase) -> None:
    """Copy the whole agent of the config's ``start`` run to a new learner; of another algorithm only the policy, see
    `transfer_policy`. Raises RunError if there is no such run, CheckpointError if it does not fit."""
    from bricksrl.agents.policy_transfer import PolicyFormError, restore, transfer_policy

    if config.start is None:
        return
    folder = RunFolder(config.start)
    old_config = folder.read_config()
    if old_config.agent == config.agent:
        if old_config.to_dict()["settings"] != config.to_dict()["settings"]:  # a user's class differs each time it is loaded
            raise CheckpointError(f"the agent of {config.start} has other settings; go on with its own")
        restore(learner, load_state(folder, one_robot(old_config), env)["agent"])
        learner.end_episodes()  # those that ran in a fleet do not go on
        return
    try:
        transfer_policy(learner, load_learner(folder.path, env).learner)
    except PolicyFormError as error:
        reason = f"the policy of {config.start}, which is {old_config.agent}'s, does not fit {config.agent}: {error}"
        raise CheckpointError(f"{reason}; choose a matching agent and settings") from None


def settings_like(before: TrainConfig, settings: Any) -> Any:
    """Settings of another agent with a network of the same form as in ``before``."""
    form = {"actor_layer_norm": False, **vars(before.settings)}
    names = {field.name for field in dataclasses.fields(settings)} & form.keys()
    names &= {"hidden", "angles", "goals", "network", "actor_layer_norm"}
    return dataclasses.replace(settings, **{name: form[name] for name in names})
