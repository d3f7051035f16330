"""Learning from what was recorded: the agent makes its updates from a dataset, and now and then shows what it has learned.

A run without the robot is a run like any other, in a folder like any other: its episodes are those in which the agent does its
best after a share of the updates. What is here serves learning on the robot too: a dataset to learn from beside the agent's own
steps, and the agent of an earlier run to start with.
"""

from __future__ import annotations

import dataclasses
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bricksrl.agents.presets import IMITATORS, BCSettings, Settings
from bricksrl.errors import BricksError, CheckpointError, DataError, RunError
from bricksrl.training.curve import draw_learning_curve
from bricksrl.training.observer import Episode, Observer, Phase, Progress, RunResult
from bricksrl.training.run import RunFolder
from bricksrl.training.saved import identity_of, load_agent, load_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent, Transitions
    from bricksrl.agents.student import Student
    from bricksrl.data import Episodes
    from bricksrl.training.config import TrainConfig
    from bricksrl.training.interrupt import Interruption

STRIDE = 20
"""Updates between two looks at whether to stop."""


def as_transitions(data: Episodes) -> Transitions:
    """What an agent studies, of a dataset."""
    import torch

    from bricksrl.agents.agent import Transitions

    last = torch.ones(len(data), dtype=torch.bool)
    last[:-1] = data.episode[1:] != data.episode[:-1]
    return Transitions(data.observation, data.action, data.reward, data.next_observation, data.terminated, last)


def read_for(path: str, env: EnvBase | None = None) -> Transitions:
    """The dataset in a folder, or that of a run, for an agent that is to act in ``env``.

    Raises:
        DataError: there is none, it is damaged, or its numbers are not those that ``env`` shows and takes.
    """
    from bricksrl.data import describe, load

    data = load(path, images=False)
    wanted = data.description if env is None else describe(env)
    for name in ("observation", "action"):
        theirs, ours = ([channel.name for channel in getattr(it, name)] for it in (data.description, wanted))
        if theirs != ours:
            raise DataError(f"{path} is of {data.description.env}: its {name} is [{', '.join(theirs)}], not [{', '.join(ours)}]")
    return as_transitions(data)


def study(config: TrainConfig, agent: Agent, env: EnvBase | None = None) -> None:
    """Give an agent what the config wants it to know beside what it finds out itself. It is needed again when a run goes on.

    Args:
        env: where the agent is to act, which the data must fit; without it that was looked at before.

    Raises:
        DataError: the dataset cannot be used.
        RunError: the agent learns from no dataset, or from nothing else and there is none.
    """
    if config.agent in IMITATORS and config.data is None:
        raise RunError(f"{config.agent} does as a dataset does, and has none; give the folder of one as data")
    if config.start is not None:
        agent.prefill_episodes = 0  # it knows better than to act at random
    if config.data is not None:
        _learner(config, agent).study(read_for(config.data, env))


def take_over(config: TrainConfig, agent: Agent, env: EnvBase) -> None:
    """Make a fresh agent that of the run which the config starts from: networks, targets, temperature, optimiser, replay.

    Of another agent only the policy is taken, see `take_policy`.

    Raises:
        RunError: there is no such run.
        CheckpointError: its agent sees or does something else, or has other settings or another form of policy.
    """
    from bricksrl.agents.taking import PolicyFormError, take_policy

    if config.start is None:
        return
    folder = RunFolder(Path(config.start))
    before = folder.read_config()
    if before.agent != config.agent:
        try:
            take_policy(agent, load_agent(folder.path, env).agent)
        except PolicyFormError as error:
            found = f"the policy of {config.start}, which is {before.agent}'s, does not fit {config.agent}: {error}"
            raise CheckpointError(f"{found}; choose an agent and settings that it fits") from None
        return
    if before.settings != config.settings:
        raise CheckpointError(f"the agent of {config.start} has other settings; go on with its own")
    agent.load_state_dict(load_state(folder, before, env)["agent"])


def settings_like(before: TrainConfig, settings: Settings) -> Settings:
    """The settings of another agent that is to go on from the policy of ``before``: with a network of the same form."""
    theirs = before.settings
    normalised = theirs.layer_norm if isinstance(theirs, BCSettings) else getattr(theirs, "actor_layer_norm", False)
    form = {name: getattr(theirs, name) for name in ("hidden", "angles", "goals") if hasattr(theirs, name)}
    own = {field.name for field in dataclasses.fields(settings)}
    form = {**form, "actor_layer_norm": normalised}
    alike: Settings = dataclasses.replace(settings, **{name: value for name, value in form.items() if name in own})
    return alike


def _learner(config: TrainConfig, agent: Agent) -> Student:
    from bricksrl.agents.student import Student

    if not isinstance(agent, Student):
        raise RunError(f"the agent {config.agent} learns from no dataset here; take another agent, or leave the data away")
    return agent


def train_offline(
    config: TrainConfig,
    agent: Agent,
    env: EnvBase,
    observer: Observer,
    interruption: Interruption,
    folder: RunFolder | None = None,
) -> RunResult:
    """Train from a dataset alone, into a new folder, or go on in that of an interrupted run.

    Raises:
        RunError: the folder of the run exists, or the agent learns from no dataset.
        CheckpointError: what is in ``folder`` is damaged or belongs to another run.
        HubError: the link to the robot failed; what was learned until then is saved.
    """
    from bricksrl.training.checkpoint import save_checkpoint

    learner = _learner(config, agent)
    done: list[Episode] = [] if folder is None else _restore(folder, config, learner, env)
    if folder is None:
        with interruption.held_back():
            folder = RunFolder.create(config, _state(config, learner, env, done))
    observer.on_start(config, folder.path, len(done))
    try:
        while len(done) < config.episodes:
            episode = lesson(config, learner, env, done, lambda: not interruption.requested)
            if episode is None:
                break
            with interruption.held_back():
                done.append(episode)
                folder.append(episode)
                save_checkpoint(folder.checkpoint_path, _state(config, learner, env, done))
            left_s = (config.episodes - len(done)) * episode.seconds / len(done)
            observer.on_episode(episode, Progress(config.episodes, episode.steps / episode.seconds, left_s))
    except (KeyboardInterrupt, BricksError):
        if not interruption.requested:
            raise
    finally:
        with interruption.held_back():
            draw_learning_curve(folder.curve_path, done, f"{config.env} · {config.agent} from data · seed {config.seed}")
    result = RunResult(folder.path, tuple(done), interrupted=len(done) < config.episodes)
    observer.on_end(result)
    return result


def _state(config: TrainConfig, agent: Agent, env: EnvBase, done: list[Episode]) -> dict[str, Any]:
    """All of a checkpoint."""
    from bricksrl.training.learner import Pace
    from bricksrl.training.session import run_state

    return {**run_state(identity_of(config, env), done), "agent": agent.state_dict(), "pace": Pace().to_dict()}


def _restore(folder: RunFolder, config: TrainConfig, agent: Agent, env: EnvBase) -> list[Episode]:
    import torch

    state = load_state(folder, config, env)
    agent.load_state_dict(state["agent"])
    torch.set_rng_state(state["generator"])
    done = [Episode.from_dict(data) for data in state["episodes"]]
    folder.clean()
    folder.write_episodes(done)
    return done


def lesson(config: TrainConfig, agent: Agent, env: EnvBase, done: list[Episode], go_on: Callable[[], bool]) -> Episode | None:
    """The updates before the next episode, and that episode; ``None`` when ``go_on`` said no, and nothing of it counts then.

    Raises:
        HubError: the link to the robot failed.
    """
    from bricksrl.training.online import is_success, run_episode, seed_episode

    started_s = time.perf_counter()
    number = len(done) + 1
    losses = _learn(_learner(config, agent), _share(config, number), go_on)
    if losses is None:
        return None
    seed_episode(env, config.seed, "episode", number)
    rollout = run_episode(env, agent, env.reset(), None)
    before = done[-1] if done else None
    return Episode(
        episode=number,
        phase=Phase.OFFLINE,
        steps=rollout.length + (before.steps if before else 0),
        length=rollout.length,
        return_=rollout.return_,
        success=is_success(env, rollout),
        losses=losses,
        seconds=time.perf_counter() - started_s + (before.seconds if before else 0.0),
    )


def _share(config: TrainConfig, number: int) -> int:
    """Updates before episode ``number``: all episodes together make those of the config."""
    return config.updates * number // config.episodes - config.updates * (number - 1) // config.episodes


def _learn(agent: Student, updates: int, go_on: Callable[[], bool]) -> dict[str, float] | None:
    """Make updates; the means of what they tell, or ``None`` when ``go_on`` said no."""
    sums: defaultdict[str, float] = defaultdict(float)
    made: defaultdict[str, int] = defaultdict(int)
    for at in range(0, updates, STRIDE):
        count = min(STRIDE, updates - at)
        for name, value in agent.update(count).items():
            sums[name] += count * value
            made[name] += count
        if not go_on():
            return None
    return {name: total / made[name] for name, total in sums.items()}
