"""Run loop: collect, store, learn and update the acting policy, episode by episode."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import InitVar, dataclass, replace
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.modules import RandomPolicy

from brickhub.files import quoted
from brickhub.user_files import without_folder
from bricksrl.agents.learner import means
from bricksrl.envs.connection import Reconnect
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.reference_returns import reference_lines
from bricksrl.envs.rollout import Driver, Rollout, play, play_episodes, seed_episode
from bricksrl.errors import BricksError, DescriptionError, HubError, RunError
from bricksrl.training.async_learner import AsyncLearner
from bricksrl.training.callbacks import Callback, CallbackList, Episode, Phase, Progress, RunResult
from bricksrl.training.collection import collect_round
from bricksrl.training.config import TrainConfig
from bricksrl.training.curve import WINDOW, draw_learning_curve
from bricksrl.training.learner_side import InLoopLearner, LearningPace
from bricksrl.training.recording import Recording, open_recorder
from bricksrl.training.restore import check_weights
from bricksrl.training.run_folder import RunFolder
from bricksrl.training.signals import StopSignals

STRIDE = 20
"""Updates from data between checks for a stop."""


def numbers(metrics: Iterable[dict[str, Tensor]]) -> dict[str, float]:
    """Mean metrics as numbers."""
    return {name: float(value) for name, value in means(metrics).items()}


class InterruptedEpisodeError(Exception):
    """The run was stopped during an episode; internal."""


@dataclass
class RunLoop:
    """A running training. An interrupted episode does not count (`InterruptedEpisodeError`).

    Attributes:
        state: initial state of the run.
        driver: may choose actions instead of the agent.
    """

    config: TrainConfig
    env: EnvBase
    learner: InLoopLearner | AsyncLearner
    callback: Callback
    signals: StopSignals
    state: InitVar[dict[str, Any]]
    driver: Driver | None = None

    def __post_init__(self, state: dict[str, Any]) -> None:
        self.actor = self.learner.actor
        # an earlier policy is better than uniform actions
        self.prefill_episodes = 0 if self.config.start is not None else self.actor.prefill_episodes
        self.identity: dict[str, Any] = state["identity"]  # must be equal in a checkpoint and its run
        self.episodes = [Episode.from_dict(data) for data in state["episodes"]]  # complete ones
        self.best: float | None = state["best"]  # mean return of the best evaluation
        self._saved_at: LearningPace | None = None
        self._length = 0

    def run(self, folder: RunFolder, start: TensorDictBase | None = None) -> RunResult:
        """Train to the last episode or an interruption. Raises the errors of `bricksrl.training.train`. ``start``: reset of the
        first episode, if already done."""
        self.folder = folder
        with self._recorded():
            self.callback.on_start(self.config, folder.path, len(self.episodes))
            updates_per_step, caught_up = None, 0
            try:
                while not self._is_over() and not self.signals.requested:
                    self._episode(start)
                    start = None
                pace = self.learner.pace  # once, as learning continues meanwhile
                updates_per_step = self._updates_per_step(pace)
                caught_up = self._catch_up(pace)
            except InterruptedEpisodeError:
                self.learner.finish(lambda: False)
            except (KeyboardInterrupt, BricksError):
                if not self.signals.requested:
                    check_weights(self.actor)  # rather than an error that follows from them
                    raise
            finally:
                with self.signals.held_back():
                    title = f"{without_folder(self.config.env)} · {without_folder(self.config.agent)} · seed {self.config.seed}"
                    lines = reference_lines(self.config.env, self.config.options)
                    draw_learning_curve(folder.curve_path, self.episodes, title, lines)
            result = RunResult(folder.path, tuple(self.episodes), not self._is_over(), updates_per_step, caught_up)
            self.callback.on_end(result)
        return result

    @contextmanager
    def _recorded(self) -> Iterator[None]:
        """Record the incomplete last episode, however the run ends."""
        with open_recorder(self.config, self.env, self.folder.path) as recorder:
            if recorder is not None:
                self.callback = CallbackList(Recording(self.config, self.env, recorder), self.callback)
            yield

    def reset(self) -> TensorDictBase | None:
        """Start the next episode, which depends on config, number and actions only."""
        number = len(self.episodes) + 1
        reconnect = self._reconnect
        if reconnect is not None:
            reconnect.patience_s, reconnect.wait = self.config.patience_s, self.signals.wait
            reconnect.on_error = lambda error: self.callback.on_link_lost(len(self.episodes) + 1, self._length, error)
        with self.signals.at_once():  # a reset may wait for a hub or a person, and loses nothing
            self._length = 0
            seed_episode(self.env, self.config.seed, "episode", number)
            state: TensorDictBase = self.env.reset()
        return state

    @property
    def _reconnect(self) -> Reconnect | None:
        """Reconnection of a single robot; attributes of copies in processes cannot be set from here."""
        return None if self.env.batch_size else interface_of(self.env).reconnect

    def _episode(self, start: TensorDictBase | None) -> None:
        """One episode (or a round of all copies) with its checkpoint and evaluation."""
        number = len(self.episodes) + 1
        metrics: list[dict[str, Tensor]] = []
        phase = Phase.PREFILL if number <= self.prefill_episodes else Phase.TRAIN
        started_s = time.perf_counter()
        if self.config.updates:
            phase = Phase.OFFLINE
            self._learn_from_data(number, metrics)
        start = self.reset() if start is None else start
        started_s = started_s if self.config.updates else time.perf_counter()
        episode = self._copies(number, phase, metrics) if self.env.batch_size else self._robot(number, phase, start, metrics)
        if episode is None:
            return
        if not math.isfinite(episode.return_):
            raise DescriptionError(
                f"the return of episode {number} is {episode.return_}: a reward of {self.config.env} was not a number; "
                f"correct it, `bricksrl check {quoted(self.config.env)}` tries it"
            )
        episode = self._with_totals(episode, started_s)
        if self.config.eval_every and number % self.config.eval_every == 0 and not episode.link_lost:
            episode = self._evaluated(episode)
        self._save(episode)

    def _with_totals(self, episode: Episode, started_s: float) -> Episode:
        """The episode with total steps and time; the previous one ended at ``started_s``."""
        previous = self.episodes[-1] if self.episodes else None
        return replace(
            episode,
            steps=episode.steps + (previous.steps if previous else 0),
            seconds=time.perf_counter() - started_s + (previous.seconds if previous else 0.0),
            updates_per_step=self._updates_per_step(self.learner.pace),
        )

    def _save(self, episode: Episode) -> None:
        """Write metrics and checkpoint."""
        with self.signals.held_back():
            self.episodes.append(episode)
            self.folder.append(episode)
            self.save()
        self.callback.on_episode(episode, self._progress())

    def _learn_from_data(self, number: int, metrics: list[dict[str, Tensor]]) -> None:
        """This episode's share of the updates from data."""
        total, episodes = self.config.updates, self.config.episodes
        due = total * number // episodes - total * (number - 1) // episodes
        for start in range(0, due, STRIDE):
            metrics.append(self.actor.make_updates(min(STRIDE, due - start)))
            if self.signals.requested:
                raise InterruptedEpisodeError

    def _robot(self, number: int, phase: Phase, start: TensorDictBase | None, metrics: list[dict[str, Tensor]]) -> Episode | None:
        """One episode of one robot; ``None`` if the link broke in the first step."""
        rollout = Rollout()
        random = RandomPolicy(self.env.full_action_spec)
        policy = {Phase.PREFILL: random, Phase.TRAIN: self.actor.explore, Phase.OFFLINE: self.actor.exploit}[phase]
        for frame in play(self.env, policy, start, driver=self.driver, reset_policy=self.actor.reset_policy):
            rollout.add(frame)
            self._length = len(rollout.rewards)
            if phase is not Phase.OFFLINE:
                if not rollout.is_lost:
                    self.callback.on_transition(number, self._length, phase, frame)
                if self.actor.on_policy and bool(frame.get("intervention", False)):
                    remedy = "let it drive, or take an off-policy one such as sac"
                    raise RunError(f"this agent learns from its own actions only; {remedy}")
                self.learner.remember(frame[None])
                if phase is Phase.TRAIN and not rollout.is_lost:
                    metrics.append(self.learner.learn(1))
                self.callback.on_step(number, self._length, phase)
            if self.signals.requested and not bool(frame["next", "done"]):
                raise InterruptedEpisodeError
        self.learner.end_episodes()
        if rollout.is_lost and phase is Phase.OFFLINE:
            raise interface_of(self.env).link_error  # a measurement has to be complete, and its updates are made once
        if not rollout.rewards:
            return None
        success, steps = None if rollout.is_lost else rollout.success(self.env), self._length
        return Episode(number, phase, steps, steps, rollout.return_, success, numbers(metrics), link_lost=rollout.is_lost)

    def _copies(self, number: int, phase: Phase, metrics: list[dict[str, Tensor]]) -> Episode:
        """A round: as many steps of all copies as an episode has at most."""
        steps = 0
        ended, lengths, returns = (torch.zeros((), device=self.env.device) for _ in range(3))
        policy = RandomPolicy(self.env.full_action_spec) if phase is Phase.PREFILL else self.actor.acting
        for frames in collect_round(self.env, policy, self.env.task.max_steps, self.actor.frames_per_batch):
            self.learner.remember(frames)
            steps += frames.shape[-1]
            if phase is Phase.TRAIN:
                metrics.append(self.learner.learn(frames.shape[-1]))
            after = frames["next"]
            done = after["done"] & ~after.get("link_lost", torch.zeros_like(after["done"]))
            ended += done.sum()
            returns += (after["episode_reward"] * done).sum()
            lengths += (after["step_count"] * done).sum()
            self.callback.on_step(number, steps, phase)
            if self.signals.requested:
                raise InterruptedEpisodeError
        self.learner.end_episodes()
        count = max(1.0, float(ended))
        length, return_ = round(float(lengths) / count), float(returns) / count
        return Episode(number, phase, steps * self.env.batch_size.numel(), length, return_, None, numbers(metrics))

    def _evaluated(self, episode: Episode) -> Episode:
        """The episode with the mean return of an evaluation, unless its link broke. Saves the best checkpoint."""
        self.learner.finish(lambda: not self.signals.requested)  # the policy must not change meanwhile
        generator = torch.get_rng_state()
        reconnect = self._reconnect
        if reconnect is not None:
            reconnect.on_error = lambda _: None  # no episode of the run is affected
        config, reset_policy = self.config, self.actor.reset_policy
        try:
            played = list(play_episodes(self.env, self._exploit, config.eval_episodes, config.seed, reset_policy=reset_policy))
        except HubError:
            return episode
        finally:
            torch.set_rng_state(generator)  # an evaluation must not affect learning
        mean = sum(rollout.return_ for rollout in played) / len(played)
        if self.best is None or mean > self.best:
            self.best = mean
            self.learner.save(self.folder.best_path, run_state(self.identity, [*self.episodes, episode], mean))
        return replace(episode, evaluation=mean)

    def _exploit(self, tensordict: TensorDictBase) -> TensorDictBase:
        """The agent's best action, unless the run is to stop."""
        if self.signals.requested:
            raise InterruptedEpisodeError
        return self.actor.exploit(tensordict)

    def _is_over(self) -> bool:
        """Whether all episodes are done, or the agent is good enough."""
        if len(self.episodes) >= self.config.episodes:
            return True
        if self.config.stop_at is None or not self.episodes:
            return False
        if self.config.eval_every:
            evaluation = self.episodes[-1].evaluation
            return evaluation is not None and evaluation >= self.config.stop_at
        whole = [episode for episode in self.episodes if not episode.link_lost]
        recent = [episode.return_ for episode in whole[-WINDOW:] if episode.phase is Phase.TRAIN]
        return len(recent) == WINDOW and sum(recent) / WINDOW >= self.config.stop_at

    def save(self) -> None:
        """Write the checkpoint."""
        self._saved_at = self.learner.pace
        self.learner.save(self.folder.checkpoint_path, run_state(self.identity, self.episodes, self.best))

    def _updates_per_step(self, pace: LearningPace) -> float | None:
        """Updates per step that requires updates, or ``None`` without such steps."""
        return self.actor.updates_per_step * (pace.done / pace.asked) if pace.asked and self.actor.updates_per_step else None

    def _catch_up(self, before: LearningPace) -> int:
        """Finish pending updates and checkpoints. Returns the number of updates."""
        due = round((before.asked - before.done) * self.actor.updates_per_step)
        if due and not self.signals.requested:
            self.callback.on_catching_up(due)
        self.learner.finish(lambda: not self.signals.requested)
        updates = round((self.learner.pace.done - before.done) * self.actor.updates_per_step)
        if self.episodes and self.learner.pace != self._saved_at:
            self.save()
            self.learner.finish(lambda: False)
        return updates

    def _progress(self) -> Progress:
        recent = self.episodes[-WINDOW - 1 :]
        first_seconds, first_steps = (recent[0].seconds, recent[0].steps) if len(self.episodes) > WINDOW else (0.0, 0)
        count = min(len(self.episodes), WINDOW)
        seconds = max(recent[-1].seconds - first_seconds, 1e-9)
        left = self.config.episodes - len(self.episodes)
        return Progress(self.config.episodes, (recent[-1].steps - first_steps) / seconds, left * seconds / count)


def run_state(identity: dict[str, Any], episodes: list[Episode], best: float | None = None) -> dict[str, Any]:
    """State of a run in a checkpoint, without its agent."""
    generator: Tensor = torch.get_rng_state()
    return {"identity": identity, "episodes": [episode.to_dict() for episode in episodes], "generator": generator, "best": best}
