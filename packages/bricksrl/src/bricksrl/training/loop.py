"""Training loop: collect, remember, learn, report; for one robot, copies (simulated robots in one
batch) or a fleet (several robots), with the learner here or in another process.

Steps come from `sources` and `fleet`; updates are made in `learner_side`.

    run -> _collect -> Moved: remember, learn
                    -> Ended: record, keep, evaluate
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
from bricksrl.agents.gradient_descent import means
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

STRIDE = 20
"""Updates from data between two checks for a stop: Ctrl-C waits for at most so many."""


@dataclass
class Loop:
    """A running training.

    Attributes:
        state: initial state of the run.
        driver: a human who may choose actions instead of the agent.
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

        # An agent that was taught, or adds to a frozen policy (`--base`), acts better than at
        # random from the start.
        is_taught = any((self.config.start, self.config.base, self.config.demonstrations))
        self.prefill_episodes = 0 if is_taught else self.actor.prefill_episodes

        # The fields up to `recorded` come from `state`: that of a checkpoint, or of a new run. The
        # identity (environment, agent, seed, settings, layout) must be the same in a checkpoint and
        # its run.
        self.identity: dict[str, Any] = state["identity"]
        # Only complete episodes are listed, because an interrupted run begins its last one anew.
        self.episodes = [Episode.from_dict(data) for data in state["episodes"]]
        self.best: float | None = state["best"]
        # This belongs to the last episode: the run may have ended before its evaluation.
        self.is_evaluation_due: bool = state["is_evaluation_due"]
        self.recorded: int = state["recorded"]

        # The fields from here on are not in a checkpoint. Episodes count from their start, complete
        # or not.
        self._started = len(self.episodes)
        # Episodes that were lost before their first step keep their numbers, and are played again.
        self._numbers_again = list[int]()
        self._last_end_s = 0.0
        self._saved_at: LearningPace | None = None
        self._recorder: RunRecorder | None = None
        self.source = self._make_source()

    def _make_source(self) -> Source:
        """Source of the steps: robots of a fleet, copies, or one robot."""
        make: type[FleetRobots | Copies | OneRobot]
        if isinstance(base_of(self.env), Fleet):
            make = FleetRobots
        elif self.env.batch_size:
            make = Copies
        else:
            make = OneRobot
        # A dataset holds the vector "observation", so an environment without one cannot be
        # recorded.
        fits_dataset = "observation" in given_specs(base_of(self.env))
        learns_on_robots = not self.config.updates and not self.env.batch_size
        return make(
            env=self.env,
            learner=self.learner,
            callback=self.callback,
            signals=self.signals,
            driver=self.driver,
            next_episode=self._next_episode,
            hub=self.config.hub,
            patience_s=self.config.patience_s,
            is_recorded=self.config.record and fits_dataset and learns_on_robots,
        )

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
                # The run that is resumed was interrupted before this evaluation, or in it.
                if self.is_evaluation_due:
                    self._evaluate()
                if not self._is_over() and not self.signals.requested:
                    self._collect()
                # This is read only once, because another process may learn on meanwhile. The ratio
                # is that of the robot's work, and later updates catch up.
                pace = self.learner.pace
                updates_per_step = pace.updates_per_step(self.actor)
                caught_up = self._catch_up(pace)
            except InterruptedEpisodeError:
                # The checkpoints are still to be written, but further updates are not waited for.
                self.learner.finish(lambda: False)
            except (KeyboardInterrupt, BricksError):
                # After Ctrl-C an error is not reported, because the user wanted the end.
                if not self.signals.requested:
                    # A robot that is told to move by NaN fails too, so the cause is named instead.
                    check_weights(self.actor)
                    raise
            finally:
                # A run that failed gets its curve too.
                with self.signals.held_back():
                    folder.draw_curve(self.config, self.episodes)
            is_interrupted = self.is_evaluation_due or not self._is_over()
            result = RunResult(
                folder.path,
                tuple(self.episodes),
                is_interrupted,
                updates_per_step,
                caught_up,
            )
            self.callback.on_end(result)
        finally:
            # A run that failed also closes its dataset, because its episodes are complete.
            self._record_unfinished()
        return result

    def _collect(self) -> None:
        """Collect, remember and learn until the run is over, or stopped between two episodes."""
        for event in self.source.events():
            match event:
                case Moved():
                    self._moved(event)
                case Ended():
                    self._ended(event)
                    # A stop loses nothing here, wherever it was asked for.
                    if self._is_over() or self.signals.requested:
                        return
            # An episode whose last step is made is complete, because its end comes with the next
            # event.
            is_last_step = isinstance(event, Moved) and event.is_last
            if self.signals.requested and not is_last_step:
                raise InterruptedEpisodeError

    def _next_episode(self, being_played: int) -> Playing | None:
        """The next episode, after this one's share of the updates from data; ``None`` if those
        being played are the last ones."""
        if len(self.episodes) + being_played >= self.config.episodes:
            return None

        # An episode that was lost before its first step keeps its number, which decides whether it
        # is random and which seed it has.
        if self._numbers_again:
            number = self._numbers_again.pop(0)
        else:
            self._started += 1
            number = self._started

        if self.config.updates:
            phase = Phase.OFFLINE
        elif number <= self.prefill_episodes:
            phase = Phase.PREFILL
        else:
            phase = Phase.TRAIN
        policy = "random" if phase is Phase.PREFILL else without_folder(self.config.agent)
        # The seed depends on the number, so that a resumed run draws what the whole one would have
        # drawn.
        seed = episode_seed("training", self.config.seed, number)
        playing = Playing(number, phase, seed, policy)

        # Learning from data comes before the episode, which shows what was learned.
        updates = self._updates_before(number)
        for start in range(0, updates, STRIDE):
            count = min(STRIDE, updates - start)
            playing.metrics.append(self.actor.make_updates(count))
            if self.signals.requested:
                raise InterruptedEpisodeError
        return playing

    def _updates_before(self, number: int) -> int:
        """An episode's share of the updates from data."""
        # The share is a difference of rounded totals, so that all shares together are exactly the
        # updates of the config.
        total = self.config.updates
        episodes = self.config.episodes
        to_here = total * number // episodes
        to_previous = total * (number - 1) // episodes
        return to_here - to_previous

    def _moved(self, moved: Moved) -> None:
        """Store a step, or a batch of copies, and learn from it."""
        playing = moved.playing
        frame = moved.frame
        # Such episodes only show what was learned from data.
        if playing.phase is Phase.OFFLINE:
            return

        is_batch = bool(frame.batch_dims)
        if not is_batch and not moved.is_lost:
            self.callback.on_transition(
                playing.number,
                playing.length,
                playing.phase,
                moved.own_frame,
            )
        frames = frame if is_batch else frame[None]  # [copies, time] or [1]
        # A frame in which the link broke is remembered too: its outcome is left out, but the replay
        # buffer knows that the next step does not follow on it.
        self.learner.remember(frames, playing.robot)
        if playing.phase is Phase.TRAIN and not moved.is_lost:
            steps = frames.shape[-1]
            playing.metrics.append(self.learner.learn(steps))
        self.callback.on_step(playing.number, playing.length, playing.phase)

    def _ended(self, ended: Ended) -> None:
        """Keep an episode that has ended, in dataset, metrics and checkpoint; then evaluate, if it
        is time."""
        playing = ended.playing
        episode = ended.episode
        # The episode was lost before its first step, so there is nothing to keep.
        if episode is None:
            self.learner.end_episodes(playing.robot)
            self._numbers_again.append(playing.number)
            return
        # This comes before anything is written, so that a checkpoint never holds what cannot be
        # learned from.
        if not math.isfinite(episode.return_):
            raise DescriptionError(
                f"the return of episode {playing.number} is {episode.return_}: a reward of "
                f"{self.config.env} was not a number; "
                f"correct it, `bricksrl check {quoted(self.config.env)}` tries it"
            )
        with self.signals.held_back():
            # The dataset comes first, so that no later failure loses an episode of a real robot.
            is_whole = not episode.link_lost and not ended.is_cut
            # An episode that a pause cut short was not judged to its end.
            success = None if ended.is_cut else episode.success
            self._record(playing, success=success, whole=is_whole)
            # This comes before the checkpoint, in which no transition may lead from this episode
            # into the next.
            self.learner.end_episodes(playing.robot)
            self._keep(playing, episode)
        # `_evaluate` reports the episode too, with the result of the evaluation.
        if self.is_evaluation_due:
            self._evaluate()
        else:
            self._report()

    def _keep(
        self,
        playing: Playing,
        episode: Episode,
    ) -> None:
        """Count an episode: write it into the metrics, and the checkpoint."""
        steps_before = self.episodes[-1].steps if self.episodes else 0
        seconds_before = self.episodes[-1].seconds if self.episodes else 0.0
        # Episodes of a fleet overlap. Each counts only the time since the last end, so that the
        # total is that of the clock.
        begun_s = max(playing.started_s, self._last_end_s)
        self._last_end_s = time.perf_counter()
        number = len(self.episodes) + 1
        counted = replace(
            episode,
            episode=number,
            steps=episode.steps + steps_before,
            measures=episode.measures | self._update_measures(playing, episode),
            seconds=self._last_end_s - begun_s + seconds_before,
            updates_per_step=self.learner.pace.updates_per_step(self.actor),
        )
        is_time = bool(self.config.eval_every) and number % self.config.eval_every == 0
        # After a lost link the robot may not be back yet, so the evaluation waits for the next
        # time.
        self.is_evaluation_due = is_time and not counted.link_lost
        self.episodes.append(counted)
        # The checkpoint comes last: resuming writes the metrics anew from it, so they may be ahead
        # of it but never behind.
        self.folder.append(counted)
        self.save()

    def _update_measures(
        self,
        playing: Playing,
        episode: Episode,
    ) -> dict[str, float]:
        """Means over an episode's updates, by names that are not the task's."""
        measures = {name: float(value) for name, value in means(playing.metrics).items()}
        measured_by = f"measures of the updates of {without_folder(self.config.agent)}"
        check_measures(measures, measured_by)
        # Both kinds of measures are columns of one table, so a name must not be in both.
        twice = sorted(measures.keys() & episode.measures.keys())
        if twice:
            raise DescriptionError(
                f"{measured_by} have the name '{twice[0]}', as a metric of the task has; give it "
                "another one"
            )
        return measures

    def _report(self) -> None:
        """Tell the callback of the last episode, which is complete."""
        progress = Progress.of(self.episodes, self.config.episodes)
        self.callback.on_episode(self.episodes[-1], progress)

    def _record(
        self,
        playing: Playing,
        *,
        success: bool | None,
        whole: bool,
    ) -> None:
        """Write an episode into the dataset."""
        # A robot of a fleet may have been assigned an episode that it has not begun yet.
        if self._recorder is None or playing.about is None:
            return
        about = replace(playing.about, success=success, whole=whole)
        self._recorder.write(playing.steps, about)
        self.recorded = self._recorder.whole

    def _record_unfinished(self) -> None:
        """Record the episodes that the run's end cut short, as far as they went, and close the
        dataset."""
        if self._recorder is None:
            return
        with self._recorder:
            for playing in self.source.playing.values():
                self._record(playing, success=None, whole=False)

    def _evaluate(self) -> None:
        """Evaluate after the last episode, and save the best checkpoint; without a result if the
        link breaks again and again.

        Until its end the evaluation stays due, so that an interrupted run makes it when it is
        resumed.
        """
        # An asynchronous learner finishes first, because the policy must not change during the
        # evaluation.
        self.learner.finish(lambda: not self.signals.requested)
        reconnect = reconnect_of(self.env)
        if reconnect is not None:
            # A link that breaks here breaks in no episode of the run, so nobody is told.
            reconnect.on_error = lambda _: None
        rollouts = play_episodes(
            self.env,
            self._exploit,
            self.config.eval_episodes,
            self.config.seed,
            kind="selection",
            reset_policy=self.actor.reset_policy,
        )
        mean = None
        try:
            # Statistics and random draws are restored afterwards, so that training goes on as it
            # would have.
            with unaffected(self.env):
                returns = [rollout.return_ for rollout in rollouts]
            mean = sum(returns) / len(returns)
        except HubError:
            # The run goes on, because one evaluation is worth less than a run.
            pass
        with self.signals.held_back():
            self.is_evaluation_due = False
            self.episodes[-1] = replace(self.episodes[-1], evaluation=mean)
            is_best = mean is not None and (self.best is None or mean > self.best)
            if is_best:
                self.best = mean
                self.learner.save(self.folder.best_path, self._state())
            # All rows are written, because the evaluation belongs into the last one, which is
            # already there.
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
        # Evaluations count if there are any, because returns of training include exploration.
        if self.config.eval_every:
            evaluation = self.episodes[-1].evaluation
            return evaluation is not None and evaluation >= self.config.stop_at
        # An episode that a lost link cut short says little about the agent.
        whole = [episode for episode in self.episodes if not episode.link_lost]
        returns = [episode.return_ for episode in whole[-WINDOW:] if episode.phase is Phase.TRAIN]
        if len(returns) < WINDOW:
            return False
        return sum(returns) / WINDOW >= self.config.stop_at

    def save(self) -> None:
        """Write the checkpoint."""
        self._saved_at = self.learner.pace
        self.learner.save(self.folder.checkpoint_path, self._state())

    def _state(self) -> dict[str, Any]:
        """State of the run at the end of its last episode, without its agent."""
        state = run_state(self.env, self.identity, self.episodes)
        state["best"] = self.best
        state["is_evaluation_due"] = self.is_evaluation_due
        state["recorded"] = self.recorded
        return state

    def _catch_up(self, before: LearningPace) -> int:
        """Finish pending updates and checkpoints. Returns the number of updates."""
        steps_behind = before.asked - before.done
        updates_due = round(steps_behind * self.actor.updates_per_step)
        if updates_due and not self.signals.requested:
            self.callback.on_catching_up(updates_due)
        self.learner.finish(lambda: not self.signals.requested)
        steps_caught_up = self.learner.pace.done - before.done
        # The last checkpoint was made before these updates.
        if self.episodes and self.learner.pace != self._saved_at:
            self.save()
            self.learner.finish(lambda: False)
        return round(steps_caught_up * self.actor.updates_per_step)
