"""`train` and `resume`: a run from its config to its files."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bricksrl.agents import AGENTS
from bricksrl.errors import BricksError, RunError, UnknownNameError
from bricksrl.training.config import TrainConfig
from bricksrl.training.interrupt import Interruption
from bricksrl.training.learner import InTheLoop, Learner, Pace
from bricksrl.training.observer import Episode, Observer, RunResult, Together
from bricksrl.training.offline import study, take_over, train_offline
from bricksrl.training.recording import recorded
from bricksrl.training.run import RunFolder
from bricksrl.training.saved import identity_of, load_state, make_agent_for
from bricksrl.training.session import Session, reset, run_state

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent
    from bricksrl.data.collect import Driver
    from bricksrl.envs.env import Placement


def train(
    config: TrainConfig,
    observer: Observer | None = None,
    *,
    env: EnvBase | None = None,
    place: Placement | None = None,
    stop: threading.Event | None = None,
    driver: Driver | None = None,
) -> RunResult:
    """Train an agent from nothing, into a new folder, which is made once the robot has answered.

    Ctrl-C, or ``stop`` set from another thread, ends the run after the step at hand; its files are then in order, and `resume`
    goes on from the end of the last whole episode. Where the link to the robot breaks, the running episode ends there, and the
    run goes on by itself when the robot answers again.

    Args:
        env: an environment of your own, which stays open; without one, ``config.env`` is made and closed at the end.
        place: puts a real robot where an episode starts, as `bricksrl.make` takes it.
        driver: who may take over from the agent at any step, and give back.

    Raises:
        RunError: the folder exists already.
        UnknownNameError: there is no such environment, hub or agent.
        HubError: the robot cannot be reached, or could not be reached again; what was learned until then is saved.
        LearnerError: the process that learns beside the robot failed; what was saved until then stays.
        KeyboardInterrupt: Ctrl-C before the robot has answered; nothing was made.
    """
    if config.agent not in AGENTS:
        raise UnknownNameError(f"there is no agent '{config.agent}'; choose one of {', '.join(AGENTS)}")
    if config.run_dir is not None and config.run_dir.exists():
        raise RunError(f"{config.run_dir} exists already; resume that run or choose another folder")
    listener = _listening(config, observer)
    with _prepared(config, env, place, stop) as (ready, agent, interruption):
        take_over(config, agent, ready)
        if config.updates:
            return train_offline(config, agent, ready, listener, interruption)
        listener.on_env(ready)
        state = {"agent": agent.state_dict(), "pace": Pace().to_dict()}
        with _learning(config, ready, agent, state, interruption) as learner:
            start = reset(ready, config, 1, interruption)
            identity = identity_of(config, ready)
            with interruption.held_back():
                folder = RunFolder.create(config, {**run_state(identity, []), **state})
            with recorded(config, ready, folder.path, listener) as watching:
                session = _session(config, folder, ready, learner, identity, watching, interruption, [])
                session.driver = driver
                return session.go_on(start)


def resume(
    run_dir: Path,
    observer: Observer | None = None,
    *,
    episodes: int | None = None,
    env: EnvBase | None = None,
    place: Placement | None = None,
    stop: threading.Event | None = None,
    driver: Driver | None = None,
) -> RunResult:
    """Go on with a run where its last whole episode ended; a synchronous one ends bit-identical to one never interrupted.

    Args:
        episodes: train up to this many in all, where that is more than the run was started with.
        env, place, driver: as in `train`.

    Raises:
        RunError: there is no run in the folder.
        CheckpointError: its checkpoint is damaged or belongs to another run.
        HubError, LearnerError: as in `train`.
    """
    import torch

    folder = RunFolder(run_dir)
    config = folder.read_config()
    if episodes is not None and episodes < config.episodes:
        raise RunError(f"the run in {run_dir} is for {config.episodes} episodes already; give that many or more, not {episodes}")
    if config.updates and episodes not in (None, config.episodes):
        raise RunError(f"the run in {run_dir} learned from data; train on the robot from there with start='{run_dir}'")
    config = replace(config, episodes=episodes or config.episodes)
    listener = _listening(config, observer)
    with _prepared(config, env, place, stop) as (ready, agent, interruption):
        if config.updates:
            return train_offline(config, agent, ready, listener, interruption, folder)
        listener.on_env(ready)
        state = load_state(folder, config, ready)
        with _learning(config, ready, agent, state, interruption) as learner:
            del state["agent"]  # it may be large
            torch.set_rng_state(state["generator"])
            done = [Episode.from_dict(data) for data in state["episodes"]]
            with interruption.held_back():
                folder.clean()
                folder.write_episodes(done)
                folder.write_config(config)
            left = len(done) < config.episodes
            with recorded(config, ready, folder.path, listener) as watching:
                session = _session(config, folder, ready, learner, state["identity"], watching, interruption, done)
                session.driver = driver
                return session.go_on(reset(ready, config, len(done) + 1, interruption) if left else None)


@contextmanager
def _prepared(
    config: TrainConfig, env: EnvBase | None, place: Placement | None, stop: threading.Event | None
) -> Iterator[tuple[EnvBase, Agent, Interruption]]:
    """Everything that a run needs: repeatable randomness, Ctrl-C in our hands, an open environment, a fresh agent."""
    from bricksrl.training.reproducible import derive_seed, reproducible

    own = env is None
    ready = make_env(config, place) if env is None else env
    interruption = Interruption(stop or threading.Event())
    try:
        with reproducible(derive_seed(config.seed, "agent")), interruption:
            agent = make_agent_for(config, ready)
            study(config, agent, ready)
            yield ready, agent, interruption
    finally:
        if own:
            ready.close(raise_if_closed=False)


@contextmanager
def _learning(
    config: TrainConfig, env: EnvBase, agent: Agent, state: dict[str, Any], interruption: Interruption
) -> Iterator[Learner]:
    """A learner that goes on from a checkpoint's state: ``agent`` itself, or one in a process of its own."""
    pace = Pace(**state["pace"])
    if not config.asynchronous or config.agent == "random":
        agent.load_state_dict(state["agent"])
        yield InTheLoop(agent, pace)
        return
    from bricksrl.agents.layout import layout_of
    from bricksrl.training.beside import BesideTheRobot
    from bricksrl.training.reproducible import derive_seed

    begin = {
        "config": config.to_dict(),
        "has_task": getattr(env, "task", None) is not None,
        "layout": layout_of(env).to_dict(),
        "action_size": int(env.action_spec.shape[-1]),
        "seed": derive_seed(config.seed, "learner", pace.asked),
    }
    patient = config.hub == "virtual" and not config.realtime
    learner = BesideTheRobot(agent, begin, state["agent"], pace, patient=patient)
    try:
        with interruption.at_once():
            learner.wait_until_ready()
        yield learner
        learner.close()
    except BricksError:
        learner.close()
        raise
    finally:
        learner.kill()


def _listening(config: TrainConfig, observer: Observer | None) -> Observer:
    """The observer, and the log that the config names."""
    if config.log == "none":
        return observer or Observer()
    from bricksrl.training.loggers import Tracking

    return Together(observer or Observer(), Tracking(config.log))


def _session(
    config: TrainConfig,
    folder: RunFolder,
    env: EnvBase,
    learner: Learner,
    identity: dict[str, Any],
    observer: Observer,
    interruption: Interruption,
    done: list[Episode],
) -> Session:
    updates = 0 if config.settings is None or config.agent == "random" else config.settings.updates_per_step
    return Session(config, folder, env, learner, updates, identity, observer, interruption, done)


def make_env(config: TrainConfig, place: Placement | None = None) -> EnvBase:
    """The environment that a config names; ``place`` puts a real robot where an episode starts.

    Raises:
        UnknownNameError: there is no such environment or hub.
    """
    from bricksrl.envs.registry import make
    from bricksrl.twin.physics import RandomPhysics

    physics = RandomPhysics() if config.randomize else config.physics
    options: dict[str, Any] = {**config.options, "physics": physics, "place": place}
    options |= {"streaming": config.streaming, "app_data": config.app_data}
    return make(config.env, hub=config.hub, seed=config.seed, realtime=config.realtime, **options)
