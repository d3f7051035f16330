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
            while not any(member.state is RobotState.ACTING for member in self.env.members):
                self._handle(self.env.next_event(_POLL_S))
                self._check_reach()
                if self.signals.requested:
                    raise KeyboardInterrupt

    def _start(self) -> None:
        if self._is_started:
            return
        self._is_started = True
        self.learner.end_episodes()  # those that ran when the fleet was stopped do not go on
        robots = base_of(self.env)
        robots.kept = transform_state(self.env)
        robots.start()
        self._send_weights()

    def events(self) -> Iterator[Moved | Ended | None]:
        """What the robots report, in the order of its arrival. Raises HubError if all robots were
        out of reach for too long, RunError if a robot failed for good, or all were given up."""
        self._start()
        while True:
            event = self._handle(self.env.next_event(_POLL_S))
            yield event
            if isinstance(event, Moved):
                self._send_weights()
                if self.env.is_paced:
                    self.env.tell(self.env.members[event.playing.robot], "go")
            elif isinstance(event, Ended):
                self._unsaved = 0
            else:
                self._check_reach()

    def play(self, playing: Any, start: Any) -> Iterator[Moved | Ended]:
        raise NotImplementedError  # in the robots' processes

    def _send_weights(self) -> None:
        weights = self.learner.new_weights()
        if weights is not None:
            self.env.send_weights(weights)

    def _check_reach(self) -> None:
        """Raise `RunError` if all robots were given up, `HubError` if all have been out of reach
        for too long."""
        last = max(self.env.members, key=lambda member: member.since_s)
        if all(member.state is RobotState.GIVEN_UP for member in self.env.members):
            reason = (
                f"no robot of the fleet is left; the last one, {last.name}, was given up: "
                f"{last.reason}"
            )
            raise RunError(f"{reason}; correct it and resume the run")
        is_out = all(member.is_out for member in self.env.members)
        if is_out and time.monotonic() - last.since_s >= self.patience_s:
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
                raise (
                    content
                    if isinstance(content, Exception)
                    else RunError("the robots cannot be placed; start again")
                )
            case "begun":
                self._set_state(member, RobotState.ACTING)
                playing = self.playing[member.number]
                playing.about = replace(content, robot=member.name)
                playing.started_s = time.perf_counter()
            case "frame":
                return self._frame(member, *content)
            case "out":
                self._set_state(member, RobotState.LEFT, content)
                left = self.playing.get(member.number)
                number, length = (0, 0) if left is None else (left.number, left.length)
                self.callback.on_link_lost(number, length, HubError(f"{member.name}: {content}"))
                self._reassign()
            case "failed":
                error_type, message = content
                raise RunError(
                    f"{member.name} failed ({error_type}: {message}); correct it and resume the run"
                )
            case "ended":
                return self._ended(member, *content)
            case "gone" | "given up":
                self._set_state(
                    member, RobotState.LEFT if kind == "gone" else RobotState.GIVEN_UP, content
                )
                ended = self._ended(member, None, {}, True, False)
                self._assign_idle()
                return ended
        return None

    def _set_state(self, member: Member, state: RobotState, reason: str = "") -> None:
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
        if all(member.is_ready or member.is_out for member in members):
            for member in members:
                if (
                    member.is_ready
                    and member.number not in self.playing
                    and member.state is not RobotState.DONE
                ):
                    self._assign(member)

    def _assign(self, member: Member) -> None:
        """Assign the next episode, unless all remaining ones are being played."""
        working = sum(
            1 for other in self.env.members if other.number in self.playing and not other.is_out
        )
        playing = self.next_episode(working + self._unsaved)
        if playing is None:
            self._set_state(member, RobotState.DONE)
            return
        if member.state is RobotState.DONE:
            self._set_state(member, RobotState.STARTING)
        playing.robot = member.number
        self.playing[member.number] = playing
        is_random = playing.phase is Phase.PREFILL
        self.env.tell(
            member,
            "episode",
            {"seed": playing.seed, "is_random": is_random, "policy": playing.policy},
        )

    def _reassign(self) -> None:
        """Let idle robots take over the episodes of one that left."""
        for other in self.env.members:
            if other.state is RobotState.DONE:
                self._assign(other)

    def _frame(
        self, member: Member, rows: list[dict[str, Any]], steps: list[Any], rewards: list[float]
    ) -> Moved:
        playing = self.playing[member.number]
        frames = [TensorDict(part).unflatten_keys(".") for part in rows]
        is_lost = bool(frames[0]["next"].get("link_lost", False))
        playing.length += len(rewards)
        for reward in rewards:
            playing.return_ += reward
        playing.steps += steps
        return Moved(playing, frames[0], frames[-1], is_lost)

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
        self._unsaved = int(playing is not None and playing.length > 0)
        if member.process is not None:
            self._assign(member)
        else:
            self._reassign()
        if playing is None:
            return None
        if not playing.length:
            return Ended(playing, None)
        if member.process is not None:  # else the episode is not complete
            member.deaths = 0
        done = (playing.number, playing.phase, playing.length, playing.length, playing.return_)
        episode = Episode(*done, success, measures, link_lost=is_lost, robot=member.name)
        return Ended(playing, episode, is_cut)
