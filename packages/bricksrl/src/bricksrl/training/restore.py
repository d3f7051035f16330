"""Learners of runs: new, restored, begun from another run or with a teacher; and their repeatable
conditions."""

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from tensordict import TensorDict
from torchrl.envs import EnvBase

from brickhub.fields import check_fields, check_value
from brickhub.files import quoted
from brickhub.seed import derive_seed
from bricksrl.agents import make_learner, with_present_names
from bricksrl.agents.bc import recorded_memory
from bricksrl.agents.compiled import compile_updates
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import action_size
from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.teachers import Base, Scripted, add_base, imitate, restore
from bricksrl.data import Episodes, describe, load
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.simulation import resolve_device
from bricksrl.envs.specs import given_specs, observed_specs
from bricksrl.envs.tasks.scripted import CONTROLLERS
from bricksrl.envs.transforms import (
    base_of,
    keeps_vectors,
    layout_of,
    load_transform_state,
    prepare,
    through,
    transform_state,
)
from bricksrl.errors import (
    BricksError,
    CheckpointError,
    DataError,
    DescriptionError,
    DivergedError,
    RunError,
)
from bricksrl.training.callbacks import Episode
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.config import SCRIPTED, TrainConfig, portable
from bricksrl.training.run_folder import RunFolder

_log = logging.getLogger(__name__)

Which = Literal["last", "best"]
"""The last checkpoint of a run, or that of its best evaluation."""


@dataclass(frozen=True)
class Trained:
    """A restored learner and its number of training episodes."""

    learner: Learner
    episodes: int


def load_learner(run_dir: Path | str, env: EnvBase, *, which: Which = "last") -> Trained:
    """The learner of a run, on the CPU, for ``env``. Raises RunError if there is no run in the
    folder, CheckpointError if it is damaged, or the observation or action of ``env`` differs,
    DivergedError if its weights are not finite."""
    folder = RunFolder(run_dir)
    config = folder.read_config()
    state = load_state(folder, config, env, which=which, frozen=True)
    learner = make_learner_for(config, env, device="cpu")
    restore(learner, {key: value for key, value in state["agent"].items() if key != "memory"})
    check_weights(learner)
    return Trained(learner, len(state["episodes"]))


def untrained_learner(run_dir: Path | str, env: EnvBase) -> Learner:
    """The learner of a run as it was before any training, on the CPU. Raises RunError if there is
    no run in the folder."""
    config = RunFolder(run_dir).read_config()
    with reproducible(derive_seed(config.seed, "agent")):
        return make_learner_for(config, env, device="cpu")


def check_weights(learner: Learner) -> None:
    """Raise DivergedError if a weight of the acting policy is not finite."""
    if not all(bool(tensor.isfinite().all()) for tensor in learner.acting.state_dict().values()):
        raise DivergedError(
            "the agent has diverged: its weights are not finite; train it with a smaller "
            "learning_rate"
        )


def one_robot(config: TrainConfig) -> TrainConfig:
    """The config for a single robot, the first, on the CPU."""
    return replace(config, num_envs=1, robots=1, hub=config.hubs[0], device="cpu")


def stand_in(config: TrainConfig) -> EnvBase:
    """The environment of the config with a virtual robot that nobody uses: its specs, and its
    transforms with what they draw."""
    env = make(
        config.env, EnvOptions(options=config.options, **config.transforms), seed=config.seed
    )
    prepare(env)
    env.close(raise_if_closed=False)
    return env


def make_learner_for(config: TrainConfig, env: EnvBase, device: str | None = None) -> Learner:
    """A new learner from a config, for ``env``. Raises RunError without enough memory, device or
    compiler."""
    device = str(resolve_device(config.device)) if device is None else device
    try:
        learner = make_learner(config.agent, env, config.settings, device)
    except RuntimeError as error:
        if "memory" not in str(error):
            raise
        raise RunError(
            f"there is not enough memory for the agent {config.agent}; give it smaller networks "
            "or memory"
        ) from None
    if config.compile:
        compile_updates(learner)
    if config.base is not None:
        add_base(learner, base_for(config, env))
    return learner


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
    differs = _differences(state.get("identity"), identity, config)
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


def _differences(saved: Any, identity: dict[str, Any], config: TrainConfig) -> set[str]:
    """Names of the values that differ in a checkpoint, where settings that are newer than it have
    their defaults."""
    with contextlib.suppress(DescriptionError, LookupError, TypeError):
        defaults = TrainConfig(
            config.env, config.agent, settings=type(config.settings)()
        ).to_dict()["settings"]
        saved = {**saved, "settings": {**defaults, **with_present_names(saved["settings"])}}
    with contextlib.suppress(LookupError, TypeError):  # of a layout what it had then
        layout = {key: value for key, value in identity["layout"].items() if key in saved["layout"]}
        identity = {**identity, "layout": layout}
        saved = {**saved, "layout": {key: saved["layout"][key] for key in layout}}
    try:
        saved = portable(saved)
        identity = portable(identity)
        return {key for key, value in identity.items() if value != saved[key]}
    except (AttributeError, LookupError, RuntimeError, TypeError):
        # a part is missing, or a tensor in place of a number
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
    state.setdefault("transforms", {})
    identity = state["identity"]
    shapes = dict(
        identity["layout"].get("vectors", [("observation", [len(identity["layout"]["low"])])])
    )
    shapes["action"] = [identity["action_size"]]
    rows = state["agent"].get("memory", {"rows": {}})["rows"]
    if any(
        name in rows and list(rows[name].shape[1:]) != list(shape) for name, shape in shapes.items()
    ):
        raise ValueError


def read_for(path: str, env: EnvBase, *, images: bool) -> Episodes:
    """The dataset in a folder, or of a run, for an agent in ``env``; of a run that learned from
    data, that one. Raises DataError if it cannot be used there."""
    folder = RunFolder(path)
    if folder.config_path.exists():
        path = folder.read_config().data or path
    data = load(path, images=images, task=interface_of(env).task)
    wanted = describe(env)
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
        if unobserved := [name for name in recorded if name not in observed]:
            _log.warning(
                "%s has %s, which %s does not observe; it is left out",
                path,
                ", ".join(unobserved),
                wanted.env,
            )
        data = data.observing(observed)
    actions, own = (
        [entry.name for entry in description.action] for description in (data.description, wanted)
    )
    if actions != own:
        reason = (
            f"{path} is of {data.description.env}: its action is [{', '.join(actions)}], not "
            f"[{', '.join(own)}]"
        )
        raise DataError(
            f"{reason}; choose data of this environment, or the environment of the data"
        )
    if not len(data):
        raise DataError(f"the dataset {path} is empty; give one with at least one step")
    return data


def attach_dataset(config: TrainConfig, learner: Learner, env: EnvBase) -> TensorDict | None:
    """Give a learner the config's data or demonstrations, and return their frames ``[time]``; also
    needed when a run resumes. Raises DataError if they cannot be used, RunError if the agent cannot
    use a dataset, or needs one."""
    if learner.imitates and config.dataset is None:
        raise RunError(
            f"{config.agent} needs demonstrations; give their folder, or use `bricksrl "
            "train-offline`"
        )
    if config.dataset is None:
        return None
    if learner.loss is None or learner.on_policy:
        raise RunError(
            f"the agent {config.agent} cannot use a dataset; choose another agent, or omit the data"
        )
    given = given_specs(base_of(env))
    if "observation" not in given:
        raise DataError(f"no data hold what {config.env} observes; learn without data")
    images = bool(layout_of(env).images) or "image" in given
    data = read_for(config.dataset, env, images=images)
    frames = data.to_tensordict()
    frames["next", "done"][:-1] |= (data.episode[1:] != data.episode[:-1])[:, None]
    frames["next", "done"][-1] = True
    for key, spec in given.items():
        if key not in frames or frames[key].shape[1:] != spec.shape:
            raise DataError(
                f"no data hold the '{key}' {list(spec.shape)} that {config.env} observes; learn "
                "without data"
            )
    if (teacher := teacher_of(config, learner)) is not None:  # whose policy knows its statistics
        load_state(teacher, one_robot(teacher.read_config()), env)
    frames = through(env, frames)
    learner.see(frames)
    if isinstance(learner.memory, TransitionReplayBuffer):
        learner.dataset = learner.memory.empty_like(max(2, len(frames)))
        learner.dataset.extend(frames)
    elif learner.memory is not None and not learner.imitates:
        # of a user, with batches of its own kind: it comes first
        learner.remember(frames)
    else:
        size = getattr(config.settings, "batch_size", 256)
        keys = learner.policy.in_keys
        learner.dataset = recorded_memory(
            frames, size, keys, chunk=learner.chunk, device=learner.device
        )
    return frames


def teacher_of(config: TrainConfig, learner: Learner) -> RunFolder | None:
    """The run of the demonstrations whose policy a new learner imitates, if there is one."""
    if config.demonstrations is None or config.start is not None or learner.imitates:
        return None
    folder = RunFolder(config.demonstrations)
    return folder if folder.config_path.exists() else None


def warm_start(
    config: TrainConfig, learner: Learner, env: EnvBase, frames: TensorDict | None
) -> None:
    """Let a new learner go on from the config's ``start`` run, or imitate its demonstrations, whose
    ``frames`` are given; those of a run with what its policy would have done. Raises RunError if
    there is no such run or the agent cannot be taught, CheckpointError if they do not fit."""
    if config.start is not None:
        folder = RunFolder(config.start)
        old_config = folder.read_config()
        if old_config.agent != config.agent:
            remedy = (
                "take that agent, or let the run demonstrate: --demonstrations "
                f"{quoted(config.start)}"
            )
            raise CheckpointError(
                f"{config.start} is {old_config.agent}'s, not {config.agent}'s; {remedy}"
            )
        if old_config.base != config.base:
            raise CheckpointError(
                f"{config.start} adds to the base {old_config.base}, not to {config.base}; "
                "give its own"
            )
        # a user's class differs each time it is loaded
        if old_config.to_dict()["settings"] != config.to_dict()["settings"]:
            raise CheckpointError(
                f"the agent of {config.start} has other settings; go on with its own"
            )
        state = load_state(folder, one_robot(old_config), env)
        restore(learner, state["agent"])
        load_transform_state(env, state["transforms"])
        learner.begin_elsewhere()  # episodes that ran in a fleet do not go on
    elif frames is not None and config.demonstrations is not None and not learner.imitates:
        actions = frames["action"]
        if teacher_of(config, learner) is not None:
            teacher = load_learner(config.demonstrations, env).learner
            teacher.reset_policy()
            actions = teacher.exploit(frames.select(*teacher.policy.in_keys))["action"]
        imitate(learner, frames, actions)


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
        return Base(Scripted(CONTROLLERS[config.env], list(observed_specs(env))))
    policy = load_learner(str(config.base), env).learner.policy
    if hasattr(policy, "reset"):
        raise RunError(
            f"the policy of {config.base} depends on more than what it observes; choose "
            "another base"
        )
    return Base(policy)


@contextlib.contextmanager
def reproducible(seed: int) -> Iterator[None]:
    """One thread and a seeded global generator inside; both are restored afterwards. Also silences
    TorchRL's log. Sums over several threads are rounded differently for each number of cores; small
    networks hardly gain from threads."""
    threads = torch.get_num_threads()
    logger = logging.getLogger("torchrl")
    level = logger.level
    with torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        logger.setLevel(logging.WARNING)  # it logs the size of each replay buffer
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            logger.setLevel(level)
