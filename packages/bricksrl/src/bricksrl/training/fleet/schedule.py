"""Schedule of a fleet: which robot plays which episode, and what its robots report."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from tensordict import TensorDict

from bricksrl.envs.transforms import base_of, transform_state
from bricksrl.errors import HubError, RunError
from bricksrl.training.callbacks import Episode, Phase, RobotState
from bricksrl.training.fleet.fleet_robots import Event, Fleet, Member
from bricksrl.training.sources import Ended, Moved, Source

_POLL_S = 0.1
"""Time of waiting for a robot's report, between looks at restarts, reach and a stop."""


@dataclass
class FleetRobots(Source):
    """The robots of a fleet, each with its own episodes."""

    env: Fleet
    _is_started: bool = False
    _unsaved: int = 0
    """Episodes that have ended and are not counted by the run yet."""

    def start(self) -> None:
        """Start the robots and wait for the first one; the others follow. Raises HubError if no
        robot can be reached."""
        self._start()
        with self.signals.at_once():
            while not self._is_any_acting():
                event = self.env.next_event(_POLL_S)
                # A run needs to know of nothing that happens before the first step.
                self._handle(event)
                self._check_reach()
                # Another thread may stop the run, and raises nothing in this one.
                if self.signals.requested:
                    raise KeyboardInterrupt

    def _is_any_acting(self) -> bool:
        return any(member.state is RobotState.ACTING for member in self.env.members)

    def _start(self) -> None:
        # A new run starts its robots before its folder is created, and a resumed one with its
        # events.
        if self._is_started:
            return
        self._is_started = True
        # Episodes that ran when the fleet was stopped do not go on.
        self.learner.end_episodes()
        robots = base_of(self.env)
        # This comes before the processes start, which get it with their first message.
        robots.kept = transform_state(self.env)
        robots.start()
        self._send_weights()

    def events(self) -> Iterator[Moved | Ended | None]:
        """Reports of the robots, in the order of their arrival. Raises HubError if all robots were
        out of reach for too long, RunError if a robot failed for good, or all were given up."""
        self._start()
        while True:
            report = self.env.next_event(_POLL_S)
            event = self._handle(report)
            # The run learns while this generator waits, and counts an episode that has ended.
            yield event
            if isinstance(event, Moved):
                # Weights go first, so that a robot that waits makes its next step with them.
                self._send_weights()
                if self.env.is_paced:
                    member = self.env.members[event.playing.robot]
                    self.env.tell(member, "go")
            elif isinstance(event, Ended):
                self._unsaved = 0
            else:
                self._check_reach()

    def play(
        self,
        playing: Any,
        start: Any,
    ) -> Iterator[Moved | Ended]:
        # The processes of the robots play, and not this one.
        raise NotImplementedError

    def _send_weights(self) -> None:
        weights = self.learner.new_weights()
        if weights is not None:
            self.env.send_weights(weights)

    def _check_reach(self) -> None:
        """Raise `RunError` if all robots were given up, `HubError` if all have been out of reach
        for too long."""
        members = self.env.members
        # Since the last robot has left, there has been none.
        last = max(members, key=lambda member: member.since_s)
        # Waiting does not help, because robots that were given up are not retried.
        if all(member.state is RobotState.GIVEN_UP for member in members):
            reason = (
                f"no robot of the fleet is left; the last one, {last.name}, was given up: "
                f"{last.reason}"
            )
            raise RunError(f"{reason}; correct it and resume the run")
        are_all_out = all(member.is_out for member in members)
        out_s = time.monotonic() - last.since_s
        if are_all_out and out_s >= self.patience_s:
            raise HubError(
                f"no robot of the fleet can be reached; the last error, of {last.name}: "
                f"{last.reason}"
            )

    def _handle(self, event: Event | None) -> Moved | Ended | None:
        """Handle a report. Returns what the run needs to know."""
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
                # Ctrl-C at a prompt and the like end a thread, but must not be raised in this one.
                if isinstance(content, Exception):
                    raise content
                raise RunError("the robots cannot be placed; start again")
            case "begun":
                self._set_state(member, RobotState.ACTING)
                playing = self.playing[member.number]
                # A process knows its hub, but not its name in the fleet.
                playing.about = replace(content, robot=member.name)
                playing.started_s = time.perf_counter()
            case "frame":
                return self._frame(member, *content)
            case "out":
                self._set_state(member, RobotState.LEFT, content)
                lost = self.playing.get(member.number)
                # The link may break before the robot has an episode.
                number = 0 if lost is None else lost.number
                length = 0 if lost is None else lost.length
                error = HubError(f"{member.name}: {content}")
                self.callback.on_link_lost(number, length, error)
                self._reassign()
            case "failed":
                error_type, message = content
                raise RunError(
                    f"{member.name} failed ({error_type}: {message}); correct it and resume the run"
                )
            case "ended":
                return self._ended(member, *content)
            case "gone" | "given up":
                is_retried = kind == "gone"
                state = RobotState.LEFT if is_retried else RobotState.GIVEN_UP
                self._set_state(member, state, content)
                ended = self._ended(
                    member,
                    success=None,
                    measures={},
                    is_lost=True,
                    is_cut=False,
                )
                # Other robots may be waiting for this one, because all begin together.
                self._assign_idle()
                return ended
        return None

    def _set_state(
        self,
        member: Member,
        state: RobotState,
        reason: str = "",
    ) -> None:
        before = member.state
        was_out = member.is_out
        member.state = state
        member.reason = reason
        if member.is_out is not was_out:
            member.since_s = time.monotonic()
        if state is not before:
            self.callback.on_robot(member.name, state, reason)

    def _assign_idle(self) -> None:
        """Assign first episodes once all processes have started or failed, so that all begin
        together."""
        members = self.env.members
        have_all_answered = all(member.is_ready or member.is_out for member in members)
        if not have_all_answered:
            return
        for member in members:
            is_idle = member.is_ready and member.number not in self.playing
            if is_idle and member.state is not RobotState.DONE:
                self._assign(member)

    def _assign(self, member: Member) -> None:
        """Assign the next episode, unless all remaining ones are being played."""
        # The episode of a robot that is out may never be completed, so another robot may take its
        # place.
        working = sum(
            1 for other in self.env.members if other.number in self.playing and not other.is_out
        )
        playing = self.next_episode(working + self._unsaved)
        if playing is None:
            self._set_state(member, RobotState.DONE)
            return
        # This robot was done, and takes over for another one.
        if member.state is RobotState.DONE:
            self._set_state(member, RobotState.STARTING)
        playing.robot = member.number
        self.playing[member.number] = playing
        order = {
            "seed": playing.seed,
            "is_random": playing.phase is Phase.PREFILL,
            "policy": playing.policy,
        }
        self.env.tell(member, "episode", order)

    def _reassign(self) -> None:
        """Let idle robots take over the episodes of one that left."""
        for other in self.env.members:
            if other.state is RobotState.DONE:
                self._assign(other)

    def _frame(
        self,
        member: Member,
        columns: list[dict[str, Any]],
        steps: list[Any],
        rewards: list[float],
    ) -> Moved:
        """A step of a robot: its frame behind the transforms, and the last one of the environment
        itself where it is another; the rows for the dataset, and the rewards."""
        playing = self.playing[member.number]
        frames = [TensorDict(flat).unflatten_keys(".") for flat in columns]
        is_lost = bool(frames[0]["next"].get("link_lost", False))
        playing.length += len(rewards)
        # Rewards are added one by one in the order of the steps, because sums of floats depend on
        # it.
        for reward in rewards:
            playing.return_ += reward
        playing.steps += steps
        return Moved(
            playing,
            frames[0],
            own_frame=frames[-1],
            is_lost=is_lost,
        )

    def _ended(
        self,
        member: Member,
        success: bool | None,
        measures: dict[str, float],
        is_lost: bool,
        is_cut: bool,
    ) -> Ended | None:
        """End a robot's episode, and assign the next one: a robot need not wait for the disk."""
        playing = self.playing.pop(member.number, None)
        # The run counts the episode only after this, and the next one must not be one too many.
        self._unsaved = int(playing is not None and playing.length > 0)
        has_process = member.process is not None
        if has_process:
            self._assign(member)
        else:
            self._reassign()
        if playing is None:
            return None
        if not playing.length:
            return Ended(playing, None)
        # If its process has died, the episode was cut short, which counts.
        if has_process:
            member.deaths = 0
        episode = Episode(
            playing.number,
            playing.phase,
            steps=playing.length,
            length=playing.length,
            return_=playing.return_,
            success=success,
            measures=measures,
            link_lost=is_lost,
            robot=member.name,
        )
        return Ended(playing, episode, is_cut)
