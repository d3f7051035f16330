"""Training loop: collect, remember, learn, report; for one robot, copies or a fleet, with the
learner here or elsewhere.

Where a step comes from is `sources`' and `fleet`'s matter, where an update is made
`learner_side`'s.
"""

import math
import time
from dataclasses import InitVar, dataclass, replace
from typing import Any

from tensordict import TensorDictBase
from torchrl.envs import EnvBase

from brickhub.files import quoted
from brickhub.seed import episode_seed
from brickhub.user_files import without_folder
from bricksrl.agents.learner import means
from bricksrl.data.schema import describe
from bricksrl.envs.rollout import Driver, play_episodes
from bricksrl.envs.specs import given_specs
from bricksrl.envs.task import check_measures
from bricksrl.envs.transforms import base_of, unaffected
from bricksrl.errors import BricksError, DescriptionError, HubError
from bricksrl.training.callbacks import WINDOW, Callback, Episode, Phase, Progress, RunResult
from bricksrl.training.config import TrainConfig
from bricksrl.training.fleet.fleet_robots import Fleet
from bricksrl.training.fleet.schedule import FleetRobots
from bricksrl.training.learner_side import LearnerSide, LearningPace
from bricksrl.training.learners import check_weights
from bricksrl.training.recording import RunRecorder
from bricksrl.training.restore import run_state
from bricksrl.training.run_folder import DATA_FOLDER, RunFolder
from bricksrl.training.signals import InterruptedEpisodeError, StopSignals
from bricksrl.training.sources import Copies, Ended, Moved, OneRobot, Playing, Source, reconnect_of

STRIDE = 20  # updates from data between checks for a stop


@dataclass
class Loop:
    """A running training.

    Attributes:
        state: initial state of the run.
        driver: may choose actions instead of the agent.
    """

    config: TrainConfig
    env: EnvBase
    learner: LearnerSide
    callback: Callback
    signals: StopSignals
    state: InitVar[dict[str, Any]]
    driver: Driver | None = None

    def __post_init__(self, state: dict[str, Any]) -> None:
        self.actor = self.learner.actor
        # which is better than uniform actions
        is_taught = any((self.config.start, self.config.base, self.config.demonstrations))
        self.prefill_episodes = 0 if is_taught else self.actor.prefill_episodes
        # must be equal in a checkpoint and its run
        self.identity: dict[str, Any] = state["identity"]
        self.episodes = [Episode.from_dict(data) for data in state["episodes"]]  # complete ones
        self.best: float | None = state["best"]  # mean return of the best evaluation
        self.is_evaluation_due: bool = state["is_evaluation_due"]  # of the last episode
        self.recorded: int = state["recorded"]  # whole episodes in the dataset
        is_held = "observation" in given_specs(base_of(self.env))  # by a dataset
        make: type[FleetRobots | Copies | OneRobot]
        if isinstance(base_of(self.env), Fleet):
            make = FleetRobots
        elif self.env.batch_size:
            make = Copies
        else:
            make = OneRobot
        self.source: Source = make(
            env=self.env,
            learner=self.learner,
            callback=self.callback,
            signals=self.signals,
            driver=self.driver,
            next_episode=self._next_episode,
            hub=self.config.hub,
            patience_s=self.config.patience_s,
            is_recorded=self.config.record
            and is_held
            and not self.config.updates
            and not self.env.batch_size,
        )
        self._started = len(self.episodes)  # episodes, complete or not
        self._again = list[int]()  # numbers of those that were lost before their first step
        self._ended_s = 0.0  # time of the last one's end
        self._saved_at: LearningPace | None = None
        self._recorder: RunRecorder | None = None

    def run(self, folder: RunFolder) -> RunResult:
        """Train to the last episode or an interruption. Raises the errors of
        `bricksrl.training.train`."""
        self.folder = folder
        if self.source.is_recorded:
            description = describe(self.env, self.config.options, name=self.config.env)
            self._recorder = RunRecorder(folder.path / DATA_FOLDER, description, self.recorded)
        try:
            self.callback.on_start(self.config, folder.path, len(self.episodes))
            updates_per_step = None
            caught_up = 0
            try:
                if self.is_evaluation_due:  # the run was interrupted before or in it
                    self._evaluate()
                if not self._is_over() and not self.signals.requested:
                    self._collect()
                pace = self.learner.pace  # once, as learning continues meanwhile
                updates_per_step = pace.updates_per_step(self.actor)
                caught_up = self._catch_up(pace)
            except InterruptedEpisodeError:
                self.learner.finish(lambda: False)
            except (KeyboardInterrupt, BricksError):
                if not self.signals.requested:
                    check_weights(self.actor)  # rather than an error that follows from them
                    raise
            finally:
                with self.signals.held_back():
                    folder.draw_curve(self.config, self.episodes)
            is_interrupted = self.is_evaluation_due or not self._is_over()
            result = RunResult(
                folder.path, tuple(self.episodes), is_interrupted, updates_per_step, caught_up
            )
            self.callback.on_end(result)
        finally:
            if self._recorder is not None:
                with self._recorder:
                    for playing in self.source.playing.values():
                        self._record(playing, success=None, whole=False)
        return result

    def _collect(self) -> None:
        """Collect, remember and learn until the run is over, or stopped between two episodes."""
        for event in self.source.events():
            match event:
                case Moved():
                    self._moved(event)
                case Ended():
                    self._ended(event)
                    if self._is_over() or self.signals.requested:
                        return
            if self.signals.requested and not (isinstance(event, Moved) and event.is_last):
                raise InterruptedEpisodeError

    def _next_episode(self, being_played: int) -> Playing | None:
        """The next episode, after this one's share of the updates from data; ``None`` if the others
        are the last ones."""
        if len(self.episodes) + being_played >= self.config.episodes:
            return None
        if self._again:
            number = self._again.pop(0)
        else:
            self._started += 1
            number = self._started
        is_random = number <= self.prefill_episodes
        if self.config.updates:
            phase = Phase.OFFLINE
        elif is_random:
            phase = Phase.PREFILL
        else:
            phase = Phase.TRAIN
        policy = "random" if phase is Phase.PREFILL else without_folder(self.config.agent)
        # The seed is that of the number, so that a resumed run draws what the whole one would have.
        seed = episode_seed("training", self.config.seed, number)
        playing = Playing(number, phase, seed, policy)
        # a difference of rounded totals: all shares together are exactly the updates of the config
        total = self.config.updates
        episodes = self.config.episodes
        due = total * number // episodes - total * (number - 1) // episodes
        # in strides, as Ctrl-C waits for the end of one
        for start in range(0, due, STRIDE):
            playing.metrics.append(self.actor.make_updates(min(STRIDE, due - start)))
            if self.signals.requested:
                raise InterruptedEpisodeError
        return playing

    def _moved(self, moved: Moved) -> None:
        """Store a step, or a batch of copies, and learn from it."""
        playing = moved.playing
        frame = moved.frame
        if playing.phase is Phase.OFFLINE:
            return
        frames = frame if frame.batch_dims else frame[None]
        if not moved.is_lost and not frame.batch_dims:
            self.callback.on_transition(playing.number, playing.length, playing.phase, moved.own)
        self.learner.remember(frames, playing.robot)
        if playing.phase is Phase.TRAIN and not moved.is_lost:
            playing.metrics.append(self.learner.learn(frames.shape[-1]))
        self.callback.on_step(playing.number, playing.length, playing.phase)

    def _ended(self, ended: Ended) -> None:
        """Keep an episode that has ended, in dataset, metrics and checkpoint; then evaluate, if it
        is time."""
        playing = ended.playing
        episode = ended.episode
        if episode is None:
            self.learner.end_episodes(playing.robot)
            self._again.append(playing.number)
            return
        if not math.isfinite(episode.return_):
            raise DescriptionError(
                f"the return of episode {playing.number} is {episode.return_}: a reward of "
                f"{self.config.env} was not a number; "
                f"correct it, `bricksrl check {quoted(self.config.env)}` tries it"
            )
        with self.signals.held_back():
            # The dataset comes first, so that no failure of what follows loses an episode of a real
            # robot.
            whole = not (episode.link_lost or ended.is_cut)
            self._record(playing, success=None if ended.is_cut else episode.success, whole=whole)
            self.learner.end_episodes(playing.robot)
            self._keep(playing, episode)
        if self.is_evaluation_due:
            self._evaluate()
        else:
            self._report()

    def _keep(self, playing: Playing, episode: Episode) -> None:
        """Count an episode: write it into the metrics, and the checkpoint."""
        previous = self.episodes[-1] if self.episodes else None
        begun_s = max(playing.started_s, self._ended_s)
        self._ended_s = time.perf_counter()
        updates = {name: float(value) for name, value in means(playing.metrics).items()}
        measured_by = f"measures of the updates of {without_folder(self.config.agent)}"
        check_measures(updates, measured_by)
        if twice := sorted(updates.keys() & episode.measures.keys()):
            raise DescriptionError(
                f"{measured_by} have the name '{twice[0]}', as a metric of the task has; give it "
                "another one"
            )
        episode = replace(
            episode,
            episode=len(self.episodes) + 1,
            steps=episode.steps + (previous.steps if previous else 0),
            measures=episode.measures | updates,
            seconds=self._ended_s - begun_s + (previous.seconds if previous else 0.0),
            updates_per_step=self.learner.pace.updates_per_step(self.actor),
        )
        is_time = bool(self.config.eval_every) and episode.episode % self.config.eval_every == 0
        self.is_evaluation_due = is_time and not episode.link_lost
        self.episodes.append(episode)
        self.folder.append(episode)
        self.save()

    def _report(self) -> None:
        """Tell the callback of the last episode, which is complete."""
        self.callback.on_episode(
            self.episodes[-1], Progress.of(self.episodes, self.config.episodes)
        )

    def _record(self, playing: Playing, *, success: bool | None, whole: bool) -> None:
        """Write an episode into the dataset."""
        if self._recorder is not None and playing.about is not None:
            self._recorder.write(
                playing.steps, replace(playing.about, success=success, whole=whole)
            )
            self.recorded = self._recorder.whole

    def _evaluate(self) -> None:
        """Evaluate after the last episode, and save the best checkpoint; without a result if the
        link breaks again and again.

        Until its end the evaluation stays due, so that an interrupted run makes it when it is
        resumed.
        """
        # the policy must not change meanwhile
        self.learner.finish(lambda: not self.signals.requested)
        if (reconnect := reconnect_of(self.env)) is not None:
            reconnect.on_error = lambda _: None  # no episode of the run is affected
        player = play_episodes(
            self.env,
            self._exploit,
            self.config.eval_episodes,
            self.config.seed,
            kind="selection",
            reset_policy=self.actor.reset_policy,
        )
        mean = None
        try:
            with unaffected(self.env):
                played = list(player)
            mean = sum(rollout.return_ for rollout in played) / len(played)
        except HubError:
            pass  # the run goes on
        with self.signals.held_back():
            self.is_evaluation_due = False
            self.episodes[-1] = replace(self.episodes[-1], evaluation=mean)
            if mean is not None and (self.best is None or mean > self.best):
                self.best = mean
                self.learner.save(self.folder.best_path, self._state())
            self.folder.write_episodes(self.episodes)
            self.save()
        self._report()

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
        self.learner.save(self.folder.checkpoint_path, self._state())

    def _state(self) -> dict[str, Any]:
        """State of the run at the end of its last episode, without its agent."""
        progress = {
            "best": self.best,
            "is_evaluation_due": self.is_evaluation_due,
            "recorded": self.recorded,
        }
        return {**run_state(self.env, self.identity, self.episodes), **progress}

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
