"""Learners of runs: made from a config, restored, given data, begun from another run or with a
teacher."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tensordict import TensorDict
from torchrl.envs import EnvBase

from brickhub.files import quoted
from brickhub.seed import derive_seed
from bricksrl.agents import make_learner
from bricksrl.agents.compiled import compile_updates
from bricksrl.agents.learner import Learner
from bricksrl.agents.teachers import Base, Scripted, add_base, imitate
from bricksrl.data import Episodes, describe, load
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.simulation import resolve_device
from bricksrl.envs.specs import given_specs, observed_specs
from bricksrl.envs.tasks.scripted import CONTROLLERS, controller_of
from bricksrl.envs.transforms import (
    base_of,
    keeps_vectors,
    layout_of,
    load_transform_state,
    prepare,
    through,
)
from bricksrl.errors import (
    CheckpointError,
    DataError,
    DivergedError,
    RunError,
)
from bricksrl.training.config import SCRIPTED, TrainConfig
from bricksrl.training.reproducible import reproducible
from bricksrl.training.restore import Which, load_state
from bricksrl.training.run_folder import RunFolder

_log = logging.getLogger(__name__)
_MAX_DIFFERING = 5
"""Maximum number of settings that a message shows."""


@dataclass(frozen=True)
class Trained:
    """A restored learner and its number of training episodes."""

    learner: Learner
    episodes: int


def load_learner(
    run_dir: Path | str,
    env: EnvBase,
    *,
    which: Which = "last",
) -> Trained:
    """The learner of a run, on the CPU, for ``env``. Raises RunError if there is no run in the
    folder, CheckpointError if it is damaged, or the observation or action of ``env`` differs,
    DivergedError if its weights are not finite."""
    folder = RunFolder(run_dir)
    config = folder.read_config()
    state = load_state(
        folder,
        config,
        env,
        which=which,
        frozen=True,
    )
    learner = make_learner_for(config, env, device="cpu")
    # What only acts needs no replay buffer, which is most of a checkpoint.
    agent = {key: value for key, value in state["agent"].items() if key != "memory"}
    learner.load_state_dict(agent)
    check_weights(learner)
    return Trained(on_its_hub(learner, env), len(state["episodes"]))


def on_its_hub(learner: Learner, env: EnvBase) -> Learner:
    """A learner that only acts, by the hub of an environment's robot where it needs that."""
    if learner.needs_hub:
        learner.use_hub_of(env)
    return learner


def untrained_learner(run_dir: Path | str, env: EnvBase) -> Learner:
    """The learner of a run as it was before any training, on the CPU. Raises RunError if there is
    no run in the folder."""
    config = RunFolder(run_dir).read_config()
    with reproducible(derive_seed(config.seed, "agent")):
        learner = make_learner_for(config, env, device="cpu")
    return on_its_hub(learner, env)


def one_robot(config: TrainConfig) -> TrainConfig:
    """The config for a single robot, the first, on the CPU."""
    return replace(
        config,
        num_envs=1,
        robots=1,
        hub=config.hubs[0],
        device="cpu",
    )


def stand_in(config: TrainConfig) -> EnvBase:
    """The environment of the config with a virtual robot that nobody uses: its specs, and its
    transforms with what they draw."""
    # Without hub and link of the config, which would reach for a robot.
    options = EnvOptions(options=config.options, **config.transforms)
    env = make(config.env, options, seed=config.seed)
    # Transforms that measure when they are made need the robot, so it is closed after that.
    prepare(env)
    env.close(raise_if_closed=False)
    return env


def make_learner_for(
    config: TrainConfig,
    env: EnvBase,
    device: str | None = None,
) -> Learner:
    """A new learner from a config, for ``env``. Raises RunError without enough memory, device or
    compiler."""
    if device is None:
        device = str(resolve_device(config.device))
    try:
        learner = make_learner(
            config.agent,
            env,
            config.settings,
            device,
        )
    except RuntimeError as error:
        # torch has no type of its own for it on the processor.
        if "memory" not in str(error):
            raise
        raise RunError(
            f"there is not enough memory for the agent {config.agent}; give it smaller networks "
            "or memory"
        ) from None
    if config.compile:
        compile_updates(learner)
    # Last, as it wraps the policy: what is compiled is what learns.
    if config.base is not None:
        add_base(learner, base_for(config, env))
    return learner


def base_for(config: TrainConfig, env: EnvBase) -> Base:
    """The frozen policy of the config's ``base``: a run's, or the hand-written controller of its
    environment. Raises RunError if there is none, or it has a memory, CheckpointError if it does
    not fit the environment."""
    if config.base == SCRIPTED:
        if config.env not in CONTROLLERS:
            raise RunError(
                f"{config.env} has no hand-written controller; give the folder of a run as base"
            )
        if not keeps_vectors(env):
            raise RunError(
                "the hand-written controller acts on what the robot itself observes; omit the "
                "transforms"
            )
        observed = list(observed_specs(env))
        # Every environment that has a controller has a task.
        task = interface_of(env).task
        controller = CONTROLLERS[config.env] if task is None else controller_of(config.env, task)
        return Base(Scripted(controller, observed))
    policy = load_learner(str(config.base), env).learner.policy
    # One with a memory would have to be told of each episode, also for rows of a batch.
    if hasattr(policy, "reset"):
        raise RunError(
            f"the policy of {config.base} depends on more than what it observes; choose "
            "another base"
        )
    return Base(policy)


def read_for(
    path: str,
    env: EnvBase,
    *,
    images: bool,
) -> Episodes:
    """The dataset in a folder, or of a run, for an agent in ``env``; of a run that learned from
    data, that one. Raises DataError if it cannot be used there."""
    folder = RunFolder(path)
    if folder.config_path.exists():
        path = folder.read_config().data or path
    data = load(path, images=images, task=interface_of(env).task)
    wanted = describe(env)
    # By name: their units and order are those of the description.
    recorded = [entry.name for entry in data.description.observation]
    observed = [entry.name for entry in wanted.observation]
    if any(name not in recorded for name in observed):
        reason = (
            f"{path} is of {data.description.env}: its observation is "
            f"[{', '.join(recorded)}], not [{', '.join(observed)}]"
        )
        raise DataError(
            f"{reason}; choose data of this environment, or learn in a task of your own that "
            "observes what they have"
        )
    if recorded != observed:
        unobserved = [name for name in recorded if name not in observed]
        # Else only their order differs, which nobody needs to know.
        if unobserved:
            _log.warning(
                "%s has %s, which %s does not observe; it is left out",
                path,
                ", ".join(unobserved),
                wanted.env,
            )
        data = data.observing(observed)
    # Actions are not sorted anew: one that is missing cannot be left out.
    recorded_actions = [entry.name for entry in data.description.action]
    actions = [entry.name for entry in wanted.action]
    if recorded_actions != actions:
        reason = (
            f"{path} is of {data.description.env}: its action is "
            f"[{', '.join(recorded_actions)}], not [{', '.join(actions)}]"
        )
        raise DataError(
            f"{reason}; choose data of this environment, or the environment of the data"
        )
    if not len(data):
        raise DataError(f"the dataset {path} is empty; give one with at least one step")
    return data


def attach_dataset(
    config: TrainConfig,
    learner: Learner,
    env: EnvBase,
) -> TensorDict | None:
    """Give a learner the config's data or demonstrations, and return their frames ``[time]``; also
    needed when a run resumes. Raises DataError if they cannot be used, RunError if the agent cannot
    use a dataset, or needs one."""
    if learner.needs_dataset and config.dataset is None:
        raise RunError(
            f"{config.agent} needs demonstrations; give their folder, or use `bricksrl "
            "train-offline`"
        )
    if config.dataset is None:
        return None
    if not learner.uses_dataset:
        raise RunError(
            f"the agent {config.agent} cannot use a dataset; choose another agent, or omit the data"
        )
    # What the environment itself observes, before its transforms: that is what data hold.
    specs = given_specs(base_of(env))
    if "observation" not in specs:
        raise DataError(f"no data hold what {config.env} observes; learn without data")
    images = bool(layout_of(env).images) or "image" in specs
    data = read_for(config.dataset, env, images=images)
    frames = data.to_tensordict()  # [time]
    # One episode after the other: where the next begins, no step leads across, also where the
    # recording broke off.
    is_last = data.episode[1:] != data.episode[:-1]
    frames["next", "done"][:-1] |= is_last[:, None]
    frames["next", "done"][-1] = True
    for key, spec in specs.items():
        if key not in frames or frames[key].shape[1:] != spec.shape:
            raise DataError(
                f"no data hold the '{key}' {list(spec.shape)} that {config.env} observes; learn "
                "without data"
            )
    teacher = teacher_of(config, learner)
    if teacher is not None:
        # Its policy is asked for its actions, and knows observations by its own statistics, which
        # this loads into the transforms.
        load_state(teacher, one_robot(teacher.read_config()), env)
    frames = through(env, frames)
    learner.use_dataset(frames)
    return frames


def teacher_of(config: TrainConfig, learner: Learner) -> RunFolder | None:
    """The run of the demonstrations whose policy a new learner imitates, if there is one."""
    # What goes on from another run has learned already; what imitates learns from data as they are.
    if config.demonstrations is None or config.start is not None or learner.needs_dataset:
        return None
    folder = RunFolder(config.demonstrations)
    return folder if folder.config_path.exists() else None


def warm_start(
    config: TrainConfig,
    learner: Learner,
    env: EnvBase,
    frames: TensorDict | None,
) -> None:
    """Let a new learner go on from the config's ``start`` run, or imitate its demonstrations, whose
    ``frames`` are given; those of a run with what its policy would have done. Raises RunError if
    there is no such run or the agent cannot be taught, CheckpointError if they do not fit."""
    if config.start is not None:
        _go_on_from(
            config.start,
            config,
            learner,
            env,
        )
    elif frames is not None and config.demonstrations is not None and not learner.needs_dataset:
        actions = frames["action"]
        if teacher_of(config, learner) is not None:
            # What a run recorded has exploration in it; its policy's best actions have none.
            teacher = load_learner(config.demonstrations, env).learner
            teacher.reset_policy()
            observations = frames.select(*teacher.policy.in_keys)
            actions = teacher.exploit(observations)["action"]
        imitate(learner, frames, actions)


def _go_on_from(
    start: str,
    config: TrainConfig,
    learner: Learner,
    env: EnvBase,
) -> None:
    """Let a new learner go on from a run of the same agent with the same settings."""
    folder = RunFolder(start)
    old_config = folder.read_config()
    if old_config.agent != config.agent:
        remedy = f"take that agent, or let the run demonstrate: --demonstrations {quoted(start)}"
        raise CheckpointError(f"{start} is {old_config.agent}'s, not {config.agent}'s; {remedy}")
    if old_config.base != config.base:
        raise CheckpointError(
            f"{start} adds to the base {old_config.base}, not to {config.base}; give its own"
        )
    # As plain values: a user's class differs each time it is loaded.
    differing = _differing(old_config.to_dict()["settings"], config.to_dict()["settings"])
    if differing:
        raise CheckpointError(
            f"the agent of {start} has other settings: {differing}; go on with its own"
        )
    state = load_state(folder, one_robot(old_config), env)
    learner.load_state_dict(state["agent"])
    load_transform_state(env, state["transforms"])
    # Episodes that ran in a fleet do not go on.
    learner.begin_elsewhere()


def _differing(own: dict[str, Any], given: dict[str, Any]) -> str:
    """Settings of a run's own agent that are not the given ones, such as ``gamma 0.99, not 0.5``;
    "" if there are none."""
    texts = [
        f"{name} {own.get(name)}, not {given.get(name)}"
        for name in (own | given)
        if own.get(name) != given.get(name)
    ]
    shown = texts[:_MAX_DIFFERING]
    if len(texts) > len(shown):
        shown.append(f"and {len(texts) - len(shown)} more")
    return "; ".join(shown).replace("; and", " and")


def check_weights(learner: Learner) -> None:
    """Raise DivergedError if a weight of the acting policy is not finite."""
    tensors = learner.acting.state_dict().values()
    if not all(bool(tensor.isfinite().all()) for tensor in tensors):
        raise DivergedError(
            "the agent has diverged: its weights are not finite; train it with a smaller "
            "learning_rate"
        )
