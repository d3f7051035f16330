"""Teaching in a tab: a robot tries numbers that a policy search proposes, or that a person gives,
and the page is told of each trial."""

import json
import math
from collections.abc import Sequence

from brickhub.search.bayesian_search import BayesianSearch
from brickhub.virtual.machine import Machine, Pace
from brickhub.virtual.run import ProgramStopped, interruptible, stop_program
from bricktwin.site.tab.lessons import LESSONS, Lesson
from bricktwin.site.tab.recorder import FRAME_MS, Page, Recorder
from bricktwin.site.tab.run import STOPPED_EXIT_CODE
from bricktwin.site.tab.trial import at_start, program_by, try_once
from bricktwin.twin.body import TwinBody


def teach_in_tab(
    request_text: str,
    page: Page,
    body: TwinBody,
) -> int:
    """Let a robot try numbers; returns the exit code. For each trial an event ``trial`` is posted,
    after the frames of it: see :func:`one_trial`.

    Args:
        request_text: JSON with the ``goal`` of the lesson, the ``seed`` of the search, its
            ``state`` or null, the number of ``trials``, and ``numbers``, those of a person, or
            null.
        page: the page.
        body: the robot.
    """
    request = json.loads(request_text)
    lesson = LESSONS[request["goal"]](body.robot)
    search = BayesianSearch(lesson.structure.numbers, seed=request["seed"])
    if request["state"]:
        search.load_state(request["state"])
    try:
        with interruptible():
            for _ in range(request["trials"]):
                one_trial(
                    lesson,
                    search,
                    body,
                    page,
                    request["numbers"],
                )
                _heed(page)
    except (KeyboardInterrupt, ProgramStopped):
        return STOPPED_EXIT_CODE
    return 0


def one_trial(
    lesson: Lesson,
    search: BayesianSearch,
    body: TwinBody,
    page: Page,
    numbers: Sequence[float] | None = None,
) -> None:
    """Try numbers ``[p]``, or those that a search asks for; tell the search and the page.

    The event has the ``numbers``, the ``score`` (null for a trial that was lost), whether the robot
    ``fell``, the robot's time in ``seconds``, the ``source`` of the program, and the ``state`` of
    the search. Raises ProgramStopped when the page says stop.
    """
    tried = search.ask() if numbers is None else tuple(numbers)
    source = program_by(lesson, body.robot, tried)
    recorder = Recorder(page)

    def attend(machine: Machine) -> None:
        machine.pace = _TrialPace(page, recorder)
        recorder.begin(machine)

    record = try_once(
        lesson,
        source,
        at_start(body),
        attend,
    )
    score = lesson.score(record)
    has_failed = record.has_fallen and not lesson.falls_late
    search.tell(score, numbers=tried, has_failed=has_failed)
    recorder.tell(
        "trial",
        numbers=tried,
        score=score if math.isfinite(score) else None,
        fell=record.has_fallen,
        seconds=(len(record.poses) - 1) * lesson.step_ms / 1000,
        source=source,
        state=search.state(),
    )
    recorder.post()


class _TrialPace(Pace):
    """Goes as fast as it can, and looks whether the page says stop."""

    def __init__(self, page: Page, recorder: Recorder) -> None:
        super().__init__()
        self._page = page
        self._recorder = recorder

    def keep(self, time_ms: float) -> None:
        if time_ms % FRAME_MS == 0:
            self._recorder.frame()
            _heed(self._page)


def _heed(page: Page) -> None:
    """Raise ProgramStopped if the page has said stop."""
    sent = page.take()
    if sent and any(message["kind"] == "stop" for message in json.loads(sent)):
        stop_program()
