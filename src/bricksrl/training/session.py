"""A run under way: episode after episode, across lost links, to its last one or to an interruption."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bricksrl.errors import BricksError, HubError
from bricksrl.training.config import TrainConfig
from bricksrl.training.curve import draw_learning_curve
from bricksrl.training.interrupt import Interruption
from bricksrl.training.observer import Episode, Observer, Phase, Progress, RunResult
from bricksrl.training.run import RunFolder

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.data.collect import Driver
    from bricksrl.training.learner import Learner, Pace
    from bricksrl.training.online import Rollout

RATE_WINDOW = 5
"""Episodes that the rate of a run is taken over."""

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 15.0


@dataclass
class _Gap:
    """The time without a robot: since when, and how often it was tried to reach it again."""

    since_s: float
    attempts: int = 0

    def next_pause_s(self) -> float:
        """Nothing at first, then twice as long each time, up to a limit."""
        self.attempts += 1
        return 0.0 if self.attempts == 1 else min(_FIRST_PAUSE_S * 2.0 ** (self.attempts - 2), _LONGEST_PAUSE_S)


@dataclass
class Session:
    """A run under way.

    Attributes:
        updates_per_step: what the settings ask for; 0 for an agent that does not learn.
        identity: what must be equal for a checkpoint to belong to the run.
        driver: who may choose the action in the place of the agent.
    """

    config: TrainConfig
    folder: RunFolder
    env: EnvBase
    learner: Learner
    updates_per_step: int
    identity: dict[str, Any]
    observer: Observer
    interruption: Interruption
    episodes: list[Episode] = field(default_factory=list)
    driver: Driver | None = None
    _gap: _Gap | None = None
    _saved_at: Pace | None = None

    def go_on(self, state: TensorDictBase | None) -> RunResult:
        """Train from ``state``, the reset of the next episode, to the last episode or to an interruption.

        Raises:
            HubError: the robot was out of reach for longer than the run's patience.
            LearnerError: the process that learns failed.
        """
        self.observer.on_start(self.config, self.folder.path, len(self.episodes))
        reached, caught_up = None, 0
        try:
            while state is not None and self._one_episode(state):
                state = self._next_start() if len(self.episodes) < self.config.episodes else None
            pace = self.learner.pace  # once: learning goes on meanwhile
            reached = self._reached(pace)
            caught_up = self._catch_up(pace)
        except (KeyboardInterrupt, BricksError):
            if not self.interruption.requested:
                raise
        finally:
            with self.interruption.held_back():
                title = f"{self.config.env} · {self.config.agent} · seed {self.config.seed}"
                draw_learning_curve(self.folder.curve_path, self.episodes, title)
        interrupted = len(self.episodes) < self.config.episodes
        result = RunResult(self.folder.path, tuple(self.episodes), interrupted, reached, caught_up)
        self.observer.on_end(result)
        return result

    def save(self) -> None:
        """Have the checkpoint written."""
        self._saved_at = self.learner.pace
        self.learner.save(self.folder.checkpoint_path, run_state(self.identity, self.episodes))

    def _one_episode(self, state: TensorDictBase) -> bool:
        """Run an episode and save it; false when it was interrupted, and then nothing of it stays."""
        from bricksrl.training.online import EpisodeStoppedError, run_episode

        started_s = time.perf_counter()
        number = len(self.episodes) + 1
        phase = Phase.PREFILL if number <= self.learner.prefill_episodes else Phase.TRAIN

        def on_step(step: int) -> bool:
            self._gap = None
            self.observer.on_step(number, step, phase)
            return not self.interruption.requested

        def on_transition(step: int, transition: TensorDictBase) -> None:
            self.observer.on_transition(number, step, phase, transition)

        try:
            rollout = run_episode(self.env, self.learner, state, phase, on_step, on_transition, self.driver)
        except EpisodeStoppedError:
            return False
        error = rollout.link_error
        if error is not None:
            self.observer.on_link_lost(number, rollout.length, error)
        if rollout.length:
            self._keep(number, phase, rollout, time.perf_counter() - started_s)
        if error is not None:
            self._pause(error)
        return not self.interruption.requested

    def _keep(self, number: int, phase: Phase, rollout: Rollout, seconds: float) -> None:
        """Write down an episode that has ended."""
        from bricksrl.training.online import is_success

        before = self.episodes[-1] if self.episodes else None
        lost = rollout.link_error is not None
        episode = Episode(
            episode=number,
            phase=phase,
            steps=rollout.length + (before.steps if before else 0),
            length=rollout.length,
            return_=rollout.return_,
            success=None if lost else is_success(self.env, rollout),
            losses=rollout.losses,
            seconds=seconds + (before.seconds if before else 0.0),
            link_lost=lost,
            updates_per_step=self._reached(self.learner.pace),
        )
        with self.interruption.held_back():
            self.episodes.append(episode)
            self.folder.append(episode)
            self.save()
        self.observer.on_episode(episode, self._progress())

    def _next_start(self) -> TensorDictBase:
        """The reset of the next episode, tried again with growing pauses where the robot is out of reach."""
        while True:
            try:
                return reset(self.env, self.config, len(self.episodes) + 1, self.interruption)
            except HubError as error:
                self.observer.on_link_lost(len(self.episodes) + 1, 0, error)
                self._pause(error)

    def _pause(self, error: HubError) -> None:
        """Wait before the robot is tried again, or give up."""
        now_s = time.monotonic()
        if self._gap is None:
            self._gap = _Gap(now_s)
        pause_s = self._gap.next_pause_s()
        if now_s + pause_s - self._gap.since_s >= self.config.patience_s:
            raise error
        self.interruption.wait(pause_s)

    def _reached(self, pace: Pace) -> float | None:
        share = pace.share
        return None if share is None or not self.updates_per_step else share * self.updates_per_step

    def _catch_up(self, before: Pace) -> int:
        """Have what is due made and written; returns the number of updates."""
        due = (before.asked - before.done) * self.updates_per_step
        if due and not self.interruption.requested:
            self.observer.on_catching_up(due)
        self.learner.finish(lambda: not self.interruption.requested)
        made = (self.learner.pace.done - before.done) * self.updates_per_step
        whole = len(self.episodes) == self.config.episodes  # else the learner knows steps of an episode that does not count
        if whole and self.learner.pace != self._saved_at:
            self.save()
            self.learner.finish(lambda: False)
        return made

    def _progress(self) -> Progress:
        recent = self.episodes[-RATE_WINDOW - 1 :]
        first_seconds, first_steps = (recent[0].seconds, recent[0].steps) if len(self.episodes) > RATE_WINDOW else (0.0, 0)
        counted = min(len(self.episodes), RATE_WINDOW)
        seconds = max(recent[-1].seconds - first_seconds, 1e-9)
        left = self.config.episodes - len(self.episodes)
        return Progress(self.config.episodes, (recent[-1].steps - first_steps) / seconds, left * seconds / counted)


def run_state(identity: dict[str, Any], episodes: list[Episode]) -> dict[str, Any]:
    """What a checkpoint holds of a run, beside its agent."""
    import torch

    return {
        "identity": identity,
        "episodes": [episode.to_dict() for episode in episodes],
        "generator": torch.get_rng_state(),
    }


def reset(env: EnvBase, config: TrainConfig, episode: int, interruption: Interruption) -> TensorDictBase:
    """Start an episode, which depends on nothing but the config, its number and the actions."""
    from bricksrl.training.online import seed_episode

    with interruption.at_once():  # a reset may wait for a hub or for a hand, and nothing is lost in it
        seed_episode(env, config.seed, "episode", episode)
        return env.reset()
