"""`train` and `resume`: runs from a config to files."""

import threading
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torchrl.envs import EnvBase

from brickhub.files import only_writer, remove_unfinished
from brickhub.seed import derive_seed
from brickhub.user_files import calling, is_reference
from bricksrl.agents.learner import Learner
from bricksrl.envs.connection import Placement
from bricksrl.envs.make import make
from bricksrl.envs.registry import is_simulation
from bricksrl.envs.rollout import Driver
from bricksrl.envs.transforms import load_transform_state, with_unit_actions
from bricksrl.errors import DescriptionError, RunError, counted
from bricksrl.training.callbacks import Callback, CallbackList, RunResult
from bricksrl.training.config import TrainConfig
from bricksrl.training.fleet.fleet_robots import make_fleet
from bricksrl.training.learner_side import AsyncLearner, InLoopLearner, LearnerSide
from bricksrl.training.learners import attach_dataset, make_learner_for, warm_start
from bricksrl.training.loggers import Tracking
from bricksrl.training.loop import Loop
from bricksrl.training.reproducible import reproducible
from bricksrl.training.restore import identity_of, load_state, run_state
from bricksrl.training.run_folder import RunFolder
from bricksrl.training.signals import StopSignals


def train(
    config: TrainConfig,
    callback: Callback | None = None,
    *,
    env: EnvBase | None = None,
    place: Placement | None = None,
    stop: threading.Event | None = None,
    driver: Driver | None = None,
) -> RunResult:
    """Train a new agent into a new folder, which is created once the robot is connected.

    Ctrl-C, or ``stop`` set from any thread, ends the run after the current step; `resume` continues
    after the last complete episode. A lost link ends the episode, and the run continues when the
    robot is back.

    Args:
        env: your own environment, which stays open; by default ``config.env`` is made and closed.
        place: places a real robot at the start position, as for `bricksrl.make`.
        driver: may take over from the agent at any step.

    Raises:
        RunError: the folder exists, or the config does not suit the environment or computer.
        UnknownNameError: there is no such environment, hub or agent.
        HubError: the robot is out of reach; earlier progress is saved.
        LearnerError: the process of an asynchronous learner failed; earlier progress is saved.
        DivergedError: the weights of the agent are not finite any more.
        KeyboardInterrupt: Ctrl-C before the robot was connected; nothing was created.
    """
    if not isinstance(config, TrainConfig):
        raise DescriptionError(f"config is of type {type(config).__name__}; give TrainConfig(...)")
    if config.run_dir is not None and config.run_dir.exists():
        raise RunError(f"{config.run_dir} exists already; resume that run or choose another folder")
    return _run(
        config,
        None,
        callback,
        env,
        place,
        stop,
        driver,
    )


def resume(
    run_dir: Path | str,
    callback: Callback | None = None,
    *,
    episodes: int | None = None,
    env: EnvBase | None = None,
    place: Placement | None = None,
    stop: threading.Event | None = None,
    driver: Driver | None = None,
) -> RunResult:
    """Continue a run after its last complete episode; synchronous runs on the CPU end bit-identical
    to uninterrupted ones. ``episodes``: total number, if more than before; ``env, place, driver``:
    as in `train`.

    Raises:
        RunError: there is no run in the folder, or another process works on it.
        CheckpointError: its checkpoint is damaged or of another run.
        HubError, LearnerError: as in `train`.
    """
    folder = RunFolder(run_dir)
    config = folder.read_config()
    if episodes is not None and episodes < config.episodes:
        whole = counted(config.episodes, "episode")
        raise RunError(
            f"the run in {run_dir} is meant to have {whole}; give that number or more, not "
            f"{episodes}"
        )
    if config.updates and episodes not in (None, config.episodes):
        raise RunError(
            f"the run in {run_dir} learned from data; `bricksrl train ENV --from RUN` goes on "
            "from it on a robot"
        )
    with only_writer(folder.path, RunError):
        return _run(
            replace(config, episodes=episodes or config.episodes),
            folder,
            callback,
            env,
            place,
            stop,
            driver,
        )


def _run(
    config: TrainConfig,
    folder: RunFolder | None,
    callback: Callback | None,
    env: EnvBase | None,
    place: Placement | None,
    stop: threading.Event | None,
    driver: Driver | None,
) -> RunResult:
    """A new run, or one from the checkpoint in ``folder``."""
    is_fleet = len(config.hubs) > 1
    if is_fleet and (env is not None or driver is not None):
        raise RunError("a fleet takes no env and no driver; omit them")
    if env is not None and env.batch_size:
        _check_copies(env)
    callback = callback or Callback()
    if config.log != "none":
        callback = CallbackList(callback, Tracking(config.log))
    with ExitStack() as stack:
        if env is None:
            env = _make_env(config, place)
            stack.callback(env.close, raise_if_closed=False)
        else:
            # Agents act in -1..1, which `make` already ensures.
            env = with_unit_actions(env)
        # This follows the environment, whose own draws do not count then.
        stack.enter_context(reproducible(derive_seed(config.seed, "agent")))
        signals = stack.enter_context(StopSignals(stop or threading.Event()))
        # A user can mend an error of their own algorithm only if the message has the line of their
        # file.
        with calling(config.agent, "fails", is_of_user=is_reference(config.agent)):
            return _run_in(
                env,
                config,
                folder,
                callback,
                signals,
                driver,
            )


def _check_copies(env: EnvBase) -> None:
    """Raise RunError if the episodes of a user's copies cannot be told."""
    # Copies end at different steps, so only the frames hold their returns and lengths.
    needed = {"episode_reward", "step_count"}
    if not needed <= set(env.full_observation_spec.keys()):
        raise RunError(
            "copies of your own need TorchRL's RewardSum and StepCounter; add them, or omit env "
            "and give num_envs"
        )


def _make_env(config: TrainConfig, place: Placement | None) -> EnvBase:
    """The environment of a config: a fleet, copies, or one robot."""
    if len(config.hubs) > 1:
        # Nobody has to place virtual robots, so their processes need no person.
        return make_fleet(config, place if config.hub != "virtual" else None)
    # Only thousands of copies in one batch are worth a device. A robot, or a single simulation,
    # acts on the processor.
    is_batch = config.num_envs > 1 and is_simulation(config.env)
    return make(
        config.env,
        config.robot,
        copies=config.num_envs,
        seed=config.seed,
        device=config.device if is_batch else "cpu",
        place=place,
    )


def _run_in(
    env: EnvBase,
    config: TrainConfig,
    folder: RunFolder | None,
    callback: Callback,
    signals: StopSignals,
    driver: Driver | None,
) -> RunResult:
    """A new run, or one from the checkpoint in ``folder``, in an environment."""
    # This comes first, because a checkpoint that does not fit must be refused before anything
    # moves.
    state = {} if folder is None else load_state(folder, config, env)
    learner = make_learner_for(config, env)
    if len(config.hubs) > 1 and learner.on_policy:
        raise RunError(
            f"{config.agent} learns from what it does now; choose another agent for several robots"
        )
    frames = attach_dataset(config, learner, env)
    if folder is None:
        warm_start(config, learner, env, frames)
        # The first checkpoint is written now, so that a run that is stopped in its first episode
        # can be resumed.
        state = {"agent": learner.state_dict(), "pace": {"asked": 0, "done": 0}, "collected": []}
        state |= run_state(env, identity_of(config, env), [])
    else:
        # This is loaded once more, because a teacher's statistics may have been loaded for the
        # dataset.
        load_transform_state(env, state["transforms"])
    callback.on_env(env)
    callback.on_learner(learner)
    # Copies and fleets are robots of other processes.
    is_one_robot = not env.batch_size and len(config.hubs) == 1
    how = learner.use_hub_of(env) if is_one_robot else ""
    if how:
        callback.on_note(how)
    # The lock is released last, because a learner in another process may write until it has ended.
    with ExitStack() as lock, ExitStack() as stack:
        side = _learning(
            stack,
            config,
            env,
            learner,
            state,
            signals,
        )
        # This follows everything that draws while things are made.
        torch.set_rng_state(state["generator"])
        loop = Loop(
            config,
            env,
            side,
            callback,
            signals,
            state,
            driver,
        )
        # A robot that cannot be reached leaves no folder behind, so it is connected first.
        if folder is None and not config.updates:
            loop.source.start()
        with signals.held_back():
            if folder is None:
                folder = RunFolder.create(config, state)
                lock.enter_context(only_writer(folder.path, RunError))
            else:
                # A crash may have left files half written, and metrics ahead of the checkpoint.
                remove_unfinished(folder.path)
                folder.write_episodes(loop.episodes)
                folder.write_config(config)
        # The state may hold a replay buffer, which the learner has copied by now.
        del state
        return loop.run(folder)


def _learning(
    stack: ExitStack,
    config: TrainConfig,
    env: EnvBase,
    learner: Learner,
    state: dict[str, Any],
    signals: StopSignals,
) -> LearnerSide:
    """The learner from a checkpoint's state, here or in another process until the end of the
    ``stack``."""
    # An agent that learns nothing by gradients, or only between episodes, keeps no robot waiting.
    keeps_none_waiting = not learner.updates_per_step or bool(config.updates)
    if not config.asynchronous or keeps_none_waiting:
        learner.load_state_dict(state["agent"])
        learner.act_on(env.device)
        return InLoopLearner(learner, state)
    side = stack.enter_context(AsyncLearner(config, env, learner, state))
    # Starting a process takes seconds, in which nothing can be lost yet.
    with signals.at_once():
        side.wait_until_ready()
    return side
