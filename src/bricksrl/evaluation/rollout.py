"""How good a trained agent is: whole episodes without exploring and without learning."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bricksrl.data.files import write_durably
from bricksrl.errors import RunError
from bricksrl.evaluation.statistics import Interval, interquartile_mean, mean, stratified_bootstrap_interval, wilson_interval
from bricksrl.seed import check_seed
from bricksrl.training.run import RunFolder
from bricksrl.training.runner import make_env
from bricksrl.training.saved import load_agent

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent
    from bricksrl.envs.env import Placement
    from bricksrl.training.config import TrainConfig
    from bricksrl.training.online import Rollout
    from bricksrl.twin.physics import Physics

OnEpisode = Callable[[int, float], None]
"""Told the number of an episode that ended, from 1, and its return."""


@dataclass(frozen=True)
class EvaluationResult:
    """Deterministic episodes of one agent.

    Attributes:
        run_dir, env, agent, hub, seed: what was evaluated, and where.
        trained_episodes: episodes that the agent had learned from.
        return_mean, return_std: of the returns; the deviation is the population's, 0 for a single episode.
        return_iqm: interquartile mean of the returns.
        return_interval: 95 % bootstrap interval of their mean.
        success_rate, success_interval: share of successes and its 95 % Wilson interval; ``None`` where the environment has no
            notion of success.
        metrics: mean of each of the task's own numbers, units in the names.
    """

    run_dir: str
    env: str
    agent: str
    hub: str
    seed: int
    episodes: int
    trained_episodes: int
    return_mean: float
    return_std: float
    return_iqm: float
    return_interval: Interval
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    success_rate: float | None
    success_interval: Interval | None
    metrics: dict[str, float]

    def to_json(self) -> str:
        """One JSON object on one line."""
        return json.dumps(dataclasses.asdict(self))


def evaluate(
    run_dir: Path,
    env: EnvBase | str | None = None,
    *,
    episodes: int = 5,
    seed: int = 1000,
    hub: str | None = None,
    realtime: bool = False,
    randomize: bool = False,
    physics: Physics | None = None,
    save: bool = True,
    on_episode: OnEpisode | None = None,
    on_env: Callable[[EnvBase], None] | None = None,
    place: Placement | None = None,
) -> EvaluationResult:
    """Let the agent of a run do its best, as its last checkpoint has it.

    Args:
        env: where; an environment that is ready (it stays open), or an id; without one, where the agent was trained.
        seed: of the episodes, which differ from those of any training.
        hub: how to reach the robot of an environment named by its id; as in training without one.
        realtime: let a virtual robot take as long as a real one.
        randomize: draw another physics of a virtual robot for each episode; off, however the agent was trained.
        physics: of a virtual robot; without it, and where it was trained, as in training.
        save: write the result into the run's ``evaluation.json``, over an earlier one.
        on_env: gets the environment before anything moves in it: whoever may stop or pause the robot keeps it.
        place: puts a real robot where an episode starts and returns when it is there.

    Raises:
        RunError: there is no run in the folder, or ``episodes`` is below 1.
        DescriptionError: the seed cannot be one.
        CheckpointError: its checkpoint is damaged, or ``env`` observes or acts otherwise than what the agent was trained in.
    """
    if episodes < 1:
        raise RunError(f"episodes is {episodes}; evaluate at least 1")
    check_seed(seed)
    from bricksrl.training.reproducible import derive_seed, reproducible

    folder = RunFolder(run_dir)
    config = folder.read_config()
    own: EnvBase | None = None
    if env is None or isinstance(env, str):
        is_virtual = (hub or config.hub) == "virtual"
        if physics is None and not randomize and env in (None, config.env) and is_virtual:
            physics = config.physics
        options = config.options if env in (None, config.env) else {}
        config = replace(config, env=env or config.env, hub=hub or config.hub, realtime=realtime)
        config = replace(config, randomize=randomize, physics=physics, options=options)
        env = own = make_env(config, place)
    try:
        if on_env is not None:
            on_env(env)
        with reproducible(derive_seed(seed, "evaluation")):
            trained = load_agent(run_dir, env)
            judged = _roll_out(env, trained.agent, episodes, seed, on_episode)
        result = _summarise(judged, env, config, trained.episodes, seed)
    finally:
        if own is not None:
            own.close(raise_if_closed=False)
    if save:
        write_durably(folder.evaluation_path, (result.to_json() + "\n").encode())
    return result


@dataclass(frozen=True)
class _Judged:
    """An episode, and what the task says of it: before the next reset, a camera's findings are gone then."""

    rollout: Rollout
    success: bool | None
    metrics: dict[str, float]


def _roll_out(env: EnvBase, agent: Agent, episodes: int, seed: int, on_episode: OnEpisode | None) -> list[_Judged]:
    """Whole deterministic episodes; episode ``k`` depends on ``seed`` and ``k`` only."""
    from bricksrl.training.online import is_success, run_episode, seed_episode, task_metrics

    judged = []
    for episode in range(1, episodes + 1):
        rollout = None
        while rollout is None or getattr(env, "is_cut", False):  # a pause cuts an episode short: it does not count
            seed_episode(env, seed, "evaluation", episode)
            rollout = run_episode(env, agent, env.reset(), None)
        judged.append(_Judged(rollout, is_success(env, rollout), task_metrics(env, rollout)))
        if on_episode is not None:
            on_episode(episode, rollout.return_)
    return judged


def _summarise(judged: list[_Judged], env: EnvBase, config: TrainConfig, trained_episodes: int, seed: int) -> EvaluationResult:
    task = getattr(env, "task", None)
    returns = np.array([one.rollout.return_ for one in judged])
    outcomes = [one.success for one in judged if one.success is not None]
    metrics = [one.metrics for one in judged]
    return EvaluationResult(
        run_dir=str(config.run_dir),
        env=config.env if task is None else task.id,
        agent=config.agent,
        hub=config.hub,
        seed=seed,
        episodes=len(judged),
        trained_episodes=trained_episodes,
        return_mean=float(returns.mean()),
        return_std=float(returns.std()),
        return_iqm=float(interquartile_mean(returns)),
        return_interval=stratified_bootstrap_interval([returns.tolist()], mean),
        returns=tuple(returns.tolist()),
        lengths=tuple(one.rollout.length for one in judged),
        success_rate=sum(outcomes) / len(outcomes) if outcomes else None,
        success_interval=wilson_interval(sum(outcomes), len(outcomes)) if outcomes else None,
        metrics={name: sum(one[name] for one in metrics) / len(metrics) for name in metrics[0]},
    )
