"""Run loop of a fleet: one learner, and robots with independent episodes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from tensordict import TensorDict

from brickhub.seed import derive_seed
from brickhub.user_files import without_folder
from bricksrl.errors import HubError, RunError
from bricksrl.training.callbacks import Episode, Phase
from bricksrl.training.fleet.robot_state import RobotState
from bricksrl.training.recording import open_recorder
from bricksrl.training.run_loop import InterruptedEpisodeError, RunLoop, numbers

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor

    from bricksrl.data import About, Step
    from bricksrl.data.recorder import Recorder
    from bricksrl.training.fleet.fleet_robots import Event, Fleet, Member

_POLL_S = 0.1


@dataclass
class RunningEpisode:
    """The current episode of a robot.

    Attributes:
        robot: name.
        number: in order of start; determines seed and phase.
        length: complete steps.
        about, steps: for the dataset; ``None`` before the first step.
    """

    robot: str
    number: int
    phase: Phase
    length: int = 0
    return_: float = 0.0
    metrics: list[dict[str, Tensor]] = field(default_factory=list)
    about: About | None = None
    steps: list[Step] = field(default_factory=list)


@dataclass
class FleetLoop(RunLoop):
    """A running training of several robots; episodes are numbered by their end.

    Attributes:
        env: the robots.
        recorder: of their common dataset, or ``None``.
    """

    env: Fleet
    recorder: Recorder | None = None
    _running: dict[int, RunningEpisode] = field(default_factory=dict)
    _episodes_started: int = 0
    _is_started: bool = False
    _ended_s: float = 0.0

    def reset(self) -> TensorDictBase | None:
        """Start the robots and wait for the first one; the others follow. Raises HubError if no robot can be reached."""
        self._start()
        with self.signals.at_once():
            while not any(member.state is RobotState.ACTING for member in self.env.members):
                self._handle(self.env.next_event(_POLL_S))
                self._check_reach()
                if self.signals.requested:
                    raise KeyboardInterrupt
        return None

    def _start(self) -> None:
        if self._is_started:
            return
        self._is_started = True
        self._episodes_started = len(self.episodes)
        self.learner.end_episodes()  # those that ran when the fleet was stopped do not go on
        self.env.start()
        weights = self.learner.new_weights()
        if weights is not None:
            self.env.send_weights(weights)

    @contextmanager
    def _recorded(self) -> Iterator[None]:
        with open_recorder(self.config, self.env, self.folder.path) as self.recorder:
            try:
                yield
            finally:  # the current episodes
                for running in list(self._running.values()):
                    self._record(running, success=None, whole=False)
                self._running.clear()

    def _episode(self, start: TensorDictBase | None) -> None:
        """Handle all robots until an episode ends, and save it.

        Raises:
            HubError: all robots were out of reach for too long.
            RunError: a robot failed for good, or all were given up.
            InterruptedEpisodeError: the run is to stop; the current episodes are recorded.
        """
        self._start()
        while not self.signals.requested:
            episode = self._handle(self.env.next_event(_POLL_S))
            if episode is not None:
                episode = self._with_totals(episode, self._ended_s)
                self._ended_s = time.perf_counter()
                self._save(episode)
                return
            self._check_reach()
        raise InterruptedEpisodeError

    def _check_reach(self) -> None:
        """Raise `RunError` if all robots were given up, `HubError` if all have been out of reach for too long."""
        last = max(self.env.members, key=lambda member: member.since_s)
        if all(member.state is RobotState.GIVEN_UP for member in self.env.members):
            reason = f"no robot of the fleet is left; the last one, {last.name}, was given up: {last.reason}"
            raise RunError(f"{reason}; correct it and resume the run")
        is_out = all(member.is_out for member in self.env.members)
        if is_out and time.monotonic() - last.since_s >= self.config.patience_s:
            raise HubError(f"no robot of the fleet can be reached; the last error, of {last.name}: {last.reason}")

    def _handle(self, event: Event | None) -> Episode | None:
        """Handle an event of a robot. Returns the episode that it ended."""
        if event is None:
            return None
        member, kind, content = event
        match kind:
            case "ready":
                self.env.begin_sending(member)
                self._assign_idle()
            case "place":
                self._set_state(member, RobotState.PLACED)
            case "unplaced":
                raise content if isinstance(content, Exception) else RunError("the robots cannot be placed; start again")
            case "begun":
                self._set_state(member, RobotState.ACTING)
                self._ended_s = self._ended_s or time.perf_counter()  # the run's time begins
                self._running[member.number].about = content
            case "frame":
                self._frame(member, *content)
            case "out":
                running = self._running.get(member.number)
                self._set_state(member, RobotState.LEFT, content)
                error = HubError(f"{member.name}: {content}")
                self.callback.on_link_lost(len(self.episodes) + 1, running.length if running else 0, error)
                self._reassign()
            case "failed":
                self._failed(member, *content)
            case "ended":
                return self._ended(member, *content)
            case "gone" | "given up":
                self._set_state(member, RobotState.LEFT if kind == "gone" else RobotState.GIVEN_UP, content)
                episode = self._ended(member, None, True, False)
                self._assign_idle(0 if episode is None else 1)
                return episode
        return None

    def _failed(self, member: Member, error_type: str, message: str) -> None:
        """Raise the permanent failure of a robot as a `RunError`."""
        raise RunError(f"{member.name} failed ({error_type}: {message}); correct it and resume the run")

    def _set_state(self, member: Member, state: RobotState, reason: str = "") -> None:
        before, was_out = member.state, member.is_out
        member.state, member.reason = state, reason
        if member.is_out is not was_out:
            member.since_s = time.monotonic()
        if state is not before:
            self.callback.on_robot(member.name, state, reason)

    def _assign_idle(self, ended: int = 0) -> None:
        """Assign first episodes once all processes have started or failed, so that all begin together."""
        members = self.env.members
        if all(member.is_ready or member.is_out for member in members):
            for member in members:
                if member.is_ready and member.number not in self._running and member.state is not RobotState.DONE:
                    self._assign(member, ended)

    def _assign(self, member: Member, ended: int = 0) -> None:
        """Assign the next episode, unless all remaining ones are running; ``ended`` are not counted yet."""
        working = sum(1 for other in self.env.members if other.number in self._running and not other.is_out)
        if len(self.episodes) + ended + working >= self.config.episodes:
            self._set_state(member, RobotState.DONE)
            return
        self._episodes_started += 1
        if member.state is RobotState.DONE:
            self._set_state(member, RobotState.STARTING)
        number = self._episodes_started
        phase = Phase.PREFILL if number <= self.prefill_episodes else Phase.TRAIN
        self._running[member.number] = RunningEpisode(member.name, number, phase)
        is_random = phase is Phase.PREFILL
        assignment = {"seed": derive_seed(self.config.seed, "episode", number), "is_random": is_random}
        self.env.order(member, {**assignment, "policy": "random" if is_random else without_folder(self.config.agent)})

    def _frame(self, member: Member, rows: dict[str, Any], step: Step | None) -> None:
        """Store a step, learn from it, and distribute the weights."""
        running = self._running[member.number]
        frame = TensorDict(rows).unflatten_keys(".")
        lost = bool(frame["next"].get("link_lost", False))
        if not lost:
            running.length += 1
            running.return_ += float(frame["next", "reward"])
            if step is not None:
                running.steps.append(step)
            self.callback.on_transition(running.number, running.length, running.phase, frame)
        self.learner.remember(frame[None], member.number)
        if running.phase is Phase.TRAIN and not lost:
            running.metrics.append(self.learner.learn(1))
        weights = self.learner.new_weights()
        if weights is not None:
            self.env.send_weights(weights)
        self.env.go_on(member)
        self.callback.on_step(running.number, running.length, running.phase)

    def _ended(self, member: Member, success: bool | None, lost: bool, is_cut: bool) -> Episode | None:
        """End a robot's episode, ``is_cut`` by a pause; ``None`` without a complete step."""
        running = self._running.pop(member.number, None)
        self.learner.end_episodes(member.number)
        episode = None
        has_steps = running is not None and running.length > 0
        if member.process is not None:  # first, as a robot need not wait for the disk
            self._assign(member, int(has_steps))
        else:
            self._reassign(int(has_steps))
        if running is not None and has_steps:
            self._record(running, success=None if is_cut else success, whole=not (lost or is_cut))
            length, metrics = running.length, numbers(running.metrics)
            episode = Episode(
                len(self.episodes) + 1,
                running.phase,
                length,
                length,
                running.return_,
                success,
                metrics,
                link_lost=lost,
                robot=member.name,
            )
            if member.process is not None:  # else the episode is not complete
                member.deaths = 0
        return episode

    def _reassign(self, ended: int = 0) -> None:
        """Let idle robots take over the episodes of one that left."""
        for other in self.env.members:
            if other.state is RobotState.DONE:
                self._assign(other, ended)

    def _record(self, running: RunningEpisode, *, success: bool | None, whole: bool) -> None:
        if self.recorder is None or running.about is None or not running.steps:
            return
        self.recorder.begin(replace(running.about, robot=running.robot))
        for step in running.steps:
            self.recorder.add(step)
        self.recorder.commit(success=success, whole=whole)
