"""Evaluation of a trained agent: whole episodes without exploration or learning."""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from torchrl.envs import EnvBase

from brickhub.fields import Count, check_value
from brickhub.files import write_durably
from brickhub.seed import EpisodeKind, check_seed, derive_seed, evaluation_seed
from brickhub.user_files import is_reference, with_absolute_file
from bricksrl.agents import algorithm
from bricksrl.envs.connection import Placement
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import is_simulation, options_of
from bricksrl.envs.rollout import EpisodeScore, play_episodes
from bricksrl.envs.transforms import with_unit_actions
from bricksrl.errors import RunError
from bricksrl.evaluation.statistics import (
    Interval,
    interquartile_mean,
    mean,
    seeds_interval,
    wilson_interval,
)
from bricksrl.training.learners import load_learner
from bricksrl.training.reproducible import reproducible
from bricksrl.training.restore import Which
from bricksrl.training.run_folder import Origin, RunFolder

_log = logging.getLogger(__name__)

EVALUATION_SEED = 1000
"""Seed of an evaluation by default."""
MAX_COPIES = 1024
"""Maximum number of simulation copies that are evaluated in parallel."""
OnEpisode = Callable[[int, float], None]
"""Called with the number of a finished episode, from 1, and its return."""


@dataclass(frozen=True)
class EvaluationResult:
    """Result of the deterministic evaluation of one agent.

    Attributes:
        run_dir, env, agent, hub, seed: run, environment, agent, connection, and seed of the
            evaluation.
        trained_episodes: episodes that the agent was trained for.
        as_trained: whether environment, options and physics are those of the training, of an
            environment of the caller its id; `bricksrl compare` counts no other.
        return_mean, return_std: mean and population standard deviation of the returns; the latter
            is 0 for one episode.
        return_iqm: interquartile mean of the returns.
        return_interval: 95 % bootstrap interval of their mean; ``None`` for fewer than five
            episodes.
        action_size: mean absolute value of the actions, in 0..1.
        success_rate, success_interval: rate of success and its 95 % Wilson interval; ``None`` where
            the environment defines no success.
        metrics: mean of each metric of the task, units in the names.
    """

    run_dir: str
    env: str
    agent: str
    hub: str
    seed: int
    episodes: int
    trained_episodes: int
    as_trained: bool
    return_mean: float
    return_std: float
    return_iqm: float
    return_interval: Interval | None
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    action_size: float
    success_rate: float | None
    success_interval: Interval | None
    metrics: dict[str, float]

    @classmethod
    def of(
        cls,
        scores: Sequence[EpisodeScore],
        **about: Any,
    ) -> EvaluationResult:
        """The result of episodes; ``about`` are the fields that they do not determine."""
        returns = np.array([score.return_ for score in scores])
        success_rate, success_interval = None, None
        outcomes = [score.success for score in scores if score.success is not None]
        if outcomes:
            success_rate = sum(outcomes) / len(outcomes)
            success_interval = wilson_interval(sum(outcomes), len(outcomes))
        metrics = {}
        for name in scores[0].metrics:
            metrics[name] = sum(score.metrics[name] for score in scores) / len(scores)
        return cls(
            **about,
            episodes=len(scores),
            return_mean=float(returns.mean()),
            return_std=float(returns.std()),
            return_iqm=float(interquartile_mean(returns)),
            return_interval=seeds_interval(returns.tolist(), mean),
            returns=tuple(returns.tolist()),
            lengths=tuple(score.length for score in scores),
            action_size=sum(score.action_size for score in scores) / len(scores),
            success_rate=success_rate,
            success_interval=success_interval,
            metrics=metrics,
        )

    def to_json(self) -> str:
        """One JSON object on one line."""
        return json.dumps(dataclasses.asdict(self))

    def save(self) -> None:
        """Write the result to the run's ``evaluation.json``, replacing an earlier one. Raises
        RunError if the file cannot be written."""
        path = RunFolder(self.run_dir).evaluation_path
        try:
            write_durably(path, (self.to_json() + "\n").encode())
        except OSError as error:
            raise RunError(
                f"the evaluation is not saved: cannot write {path} ({error.strerror}); make room "
                "or copy it"
            ) from None


def evaluate(
    run_dir: Path | str,
    env: EnvBase | str | None = None,
    *,
    episodes: int = 5,
    seed: int = EVALUATION_SEED,
    kind: EpisodeKind = "evaluation",
    which: Which = "last",
    save: bool = True,
    on_episode: OnEpisode | None = None,
    on_env: Callable[[EnvBase], None] | None = None,
    place: Placement | None = None,
    **named: Any,
) -> EvaluationResult:
    """Evaluate the agent of a run deterministically.

    Args:
        env: an environment (it stays open) or an id; by default the environment of the training.
        seed: with the seed of the run it gives the episodes; see :mod:`brickhub.seed`.
        kind: of the episodes; "selection" where the result chooses among agents.
        which: checkpoint: the last one, or that of the best evaluation during training.
        save: write the result to the run's ``evaluation.json``, replacing an earlier one.
        on_env: called with the environment before the robot moves, for instance to keep it for stop
            and pause.
        place: places a real robot at the start of an episode and returns when it is there.
        named: for an environment made here: fields of :class:`~bricksrl.envs.EnvOptions` that
            differ from the training, such as ``hub``, and options of the task. By default it is
            neither randomized nor in real time, whatever the training was, and has those options of
            the training that ``env`` has; a warning in the log names the others.

    Raises:
        RunError: there is no run in the folder.
        DescriptionError: the number of episodes or the seed is invalid.
        CheckpointError: the checkpoint is damaged, or ``env`` has other observations or actions
            than the training.
        DivergedError: the weights of the agent are not finite.
    """
    check_value("episodes", episodes, Count)
    check_seed(seed)
    origin = RunFolder(run_dir).origin()
    drawn = evaluation_seed(origin.seed, seed)
    env_id = origin.env
    hub = origin.options.hub
    own: EnvBase | None = None
    if env is None or isinstance(env, str):
        env_id = with_absolute_file(origin.env if env is None else env)
        nominal = evaluation_options(origin, origin.env)
        options = evaluation_options(origin, env_id, **named)
        # Whoever gives options has chosen them, and needs no note about those of the training.
        missing = [name for name in nominal.options if name not in options.options]
        left_out = [] if "options" in named else missing
        if left_out:
            _log.warning(
                "%s has no %s, which the training had; it is evaluated without",
                env_id,
                ", ".join(left_out),
            )
        names = ("options", "physics", "randomize", "link", "scene", "fault")
        changed = [name for name in names if getattr(options, name) != getattr(nominal, name)]
        as_trained = env_id == origin.env and not changed
        hub = options.hub
        # Copies in a batch make a simulation many times as fast.
        side_by_side = is_simulation(env_id) and hub == "virtual" and not options.realtime
        # Episodes are played one after the other where something may have a memory, or read specs
        # without a batch: a policy of planned chunks, a transform, or an agent of the user's own.
        in_chunks = hasattr(algorithm(origin.agent).settings, "chunk")
        in_turn = in_chunks or options.is_transformed or is_reference(origin.agent)
        copies = min(episodes, MAX_COPIES) if side_by_side and not in_turn else 1
        env = own = make(
            env_id,
            options,
            copies=copies,
            seed=origin.seed,
            place=place,
        )
    else:
        task = interface_of(env).task
        env = with_unit_actions(env)
        # A task from a file has an id of its own, which does not name the file.
        as_trained = task is None or is_reference(env_id) or task.id == env_id
    try:
        if on_env is not None:
            on_env(env)
        # Whatever an agent draws at its best, such as a diffusion policy, follows from the seed.
        with reproducible(derive_seed(drawn, "evaluation")):
            trained = load_learner(run_dir, env, which=which)
            actor = trained.learner
            actor.act_on(env.device)  # type: ignore[union-attr]  # an id has become an environment
            scores = []
            played = play_episodes(
                env,
                actor.exploit,
                episodes,
                drawn,
                kind=kind,
                reset_policy=actor.reset_policy,
            )
            for score in played:
                scores.append(score)
                if on_episode is not None:
                    on_episode(len(scores), score.return_)
        task = interface_of(env).task
        result = EvaluationResult.of(
            scores,
            run_dir=str(run_dir),
            env=env_id if task is None else task.id,
            agent=origin.agent,
            hub=hub,
            seed=seed,
            trained_episodes=trained.episodes,
            as_trained=as_trained,
        )
    finally:
        if own is not None:
            own.close(raise_if_closed=False)
    if save:
        result.save()
    return result


def evaluation_options(
    origin: Origin,
    env: str,
    **named: Any,
) -> EnvOptions:
    """Options of the environment of an evaluation: those of the training that it has, without
    physics, link, scene and faults of another environment or hub, neither randomized nor in real
    time."""
    same_env = env == origin.env
    before = origin.options
    nominal = replace(
        before,
        realtime=False,
        randomize=False,
        options=before.options if same_env else options_of(env, before.options),
    )
    # A real robot has its own link and physics, and another task may have another robot.
    keeps_twin = same_env and named.get("hub", before.hub) == "virtual"
    if not keeps_twin:
        nominal = replace(
            nominal,
            physics=None,
            link=None,
            scene=None,
            fault=(),
        )
    elif named.get("randomize", False):
        # Physics from a file would be overridden by drawn ones, so they are left out.
        nominal = replace(nominal, physics=None)
    return nominal.changed(**named)
