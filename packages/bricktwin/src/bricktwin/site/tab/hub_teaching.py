"""Teaching of a real robot: its hub makes the trials by itself, and a lost link loses no more than
one of them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from brickhub.errors import HubError, HubProgramError, HubProtocolError, StoppedError
from brickhub.hub.interface import Pitch, Roll
from brickhub.hub.link.robot_link import Reading
from brickhub.hub.link.trial_link import TrialLink
from brickhub.hub.program.generate import TILT_DEG
from brickhub.robot import Robot
from brickhub.search.bayesian_search import BayesianSearch
from bricktwin.site.tab.hub_lessons import HubLesson
from bricktwin.site.tab.hub_transport import WebTransport
from bricktwin.site.tab.lessons import Record
from bricktwin.site.tab.recorder import Recorder
from bricktwin.site.tab.trial import program_by

_MOST_LOSSES = 5
"""Losses in a row after which the link is given up."""
_MOST_WAYS_BACK = 3
"""Times that the robot tries to get back by itself before a person is asked."""
_LOOK_S = 1.0
"""Time between two looks at where the robot is, while a person puts it back."""
_LONGEST_PAUSE_S = 600.0


class HubTeaching:
    """Teaching of one robot.

    Args:
        hub_lesson: what it learns.
        robot: its description.
        transport: to its hub.
        recorder: told of each trial (as in `bricktwin.site.tab.teach`), of a lost link (``lost``)
            and of a robot that has to be put back (``place``).
    """

    def __init__(
        self,
        hub_lesson: HubLesson,
        robot: Robot,
        transport: WebTransport,
        recorder: Recorder,
    ) -> None:
        self._lesson = hub_lesson.lesson
        self._place = hub_lesson.place
        self._robot = robot
        self._transport = transport
        self._recorder = recorder
        structure = self._lesson.structure
        self._link = TrialLink(
            transport,
            robot,
            self._lesson.interface,
            structure.numbers,
            structure.hub_source(),
        )
        self._has_gone_on = False
        self._first_heading_deg: float | None = None

    def stop(self) -> None:
        """Stop the motors at once; may be called while `run` waits."""
        self._link.emergency_stop()

    def go_on(self) -> None:
        """The person says that the robot is where it should be."""
        self._has_gone_on = True

    def run(self, request: Mapping[str, Any]) -> None:
        """Make trials, as the request of :func:`~bricktwin.site.tab.teach.teach_in_tab` says; with
        ``elsewhere``, the state of its search is of another robot, such as the virtual one.

        Raises:
            HubError: the link is lost for good, or the program raised.
        """
        search = BayesianSearch(self._lesson.structure.numbers, seed=request["seed"])
        if request["state"]:
            search.load_state(request["state"])
        if request.get("elsewhere"):
            search.begin_elsewhere()
        try:
            for _ in range(request["trials"]):
                self._one_trial(search, request["numbers"])
        # It was stopped by hand, and stands.
        except StoppedError:
            return

    def _one_trial(self, search: BayesianSearch, numbers: Sequence[float] | None) -> None:
        """Try numbers, or those that a search asks for; tell the search and the page."""
        tried = search.ask() if numbers is None else tuple(numbers)
        record = self._tried(tried)
        score = self._lesson.score(record)
        has_failed = record.has_fallen and not self._lesson.falls_late
        search.tell(score, numbers=tried, has_failed=has_failed)
        self._recorder.tell(
            "trial",
            numbers=tried,
            score=score if math.isfinite(score) else None,
            fell=record.has_fallen,
            seconds=(len(record.observed) - 1) * self._lesson.step_ms / 1000,
            source=program_by(self._lesson, self._robot, tried),
            state=search.state(),
        )
        self._recorder.post()

    def _tried(self, numbers: Sequence[float]) -> Record:
        """Record of a trial; one that was lost with the link is made again. Raises HubError if the
        link is lost for good."""
        losses = 0
        while True:
            try:
                self._link.open()
                self._get_in_place()
                readings = self._link.make_trial(numbers, self._lesson.steps)
                if readings is not None:
                    return self._record(readings)
                raise HubError("some of what the hub said of its trial was lost")
            # What the hub says of its program does not change by itself.
            except (HubProgramError, HubProtocolError):
                raise
            except HubError as error:
                losses += 1
                if losses > _MOST_LOSSES:
                    raise
                self._recorder.tell("lost", text=str(error))
                self._recorder.post()

    def _record(self, readings: list[Reading]) -> Record:
        """What happened in a trial."""
        record = Record()
        record.observed = [reading.values for reading in readings]
        last = record.observed[-1]
        for index, channel in enumerate(self._lesson.interface.channels):
            if isinstance(channel, Pitch | Roll):
                record.has_fallen |= abs(last[index]) > TILT_DEG
        return record

    def _get_in_place(self) -> None:
        """Wait until the robot is where a trial may begin."""
        observed = self._link.read().values
        if self._first_heading_deg is None:
            self._begin_here(observed)
        if self._place.asks_each_time or not self._arrives(observed):
            self._wait_for_person()

    def _arrives(self, observed: Sequence[float]) -> bool:
        """Whether the robot is where a trial may begin, or gets there by itself."""
        for _ in range(_MOST_WAYS_BACK):
            if self._place.is_there(observed, self._first_heading_deg):
                return True
            way = self._place.way_from(observed)
            if way is None:
                return False
            numbers, steps = way
            self._link.make_trial(numbers, min(steps, self._lesson.steps))
            observed = self._link.read().values
        return self._place.is_there(observed, self._first_heading_deg)

    def _wait_for_person(self) -> None:
        """Ask a person to put the robot back, and wait. Raises HubError if nobody does."""
        self._has_gone_on = False
        observed = self._link.read().values
        end_s = self._link.now_s() + _LONGEST_PAUSE_S
        while self._link.now_s() < end_s:
            self._recorder.tell("place", **self._place.asked(observed))
            self._recorder.post()
            self._transport.pause(_LOOK_S)
            # This keeps the program alive, too.
            observed = self._link.read().values
            if self._has_gone_on:
                self._begin_here(observed)
                if self._arrives(observed):
                    return
                self._has_gone_on = False
        raise HubError("nobody has put the robot back; do so, and go on")

    def _begin_here(self, observed: Sequence[float]) -> None:
        heading = self._place.heading
        self._first_heading_deg = None if heading is None else observed[heading]
