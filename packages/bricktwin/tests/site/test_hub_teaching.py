"""Teaching of a real robot, with a link and a place that are played: what is made again, and when
a person is asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.errors import HubError, HubProgramError, HubProtocolError, StoppedError
from brickhub.hub.interface import Pitch, Roll
from brickhub.hub.program.generate import TILT_DEG
from bricktwin.site.tab import hub_teaching
from bricktwin.site.tab.hub_teaching import HubTeaching
from bricktwin.site.tab.lessons import Record

WAY_BACK = (9.0,)


class PlayedLink:
    """A link whose trials end as they are told: with readings, ``None`` for lost ones, or an
    error."""

    def __init__(self, *results: Any) -> None:
        self.results = list(results)
        self.made: list[tuple[Sequence[float], int]] = []
        self.observed: list[Sequence[float]] = []
        self.opened = 0
        self.time_s = 0.0
        self.stopped = False

    def open(self) -> None:
        self.opened += 1

    def read(self) -> Any:
        values = self.observed.pop(0) if len(self.observed) > 1 else self.observed[0]
        return SimpleNamespace(values=values)

    def make_trial(self, numbers: Sequence[float], steps: int) -> Any:
        self.made.append((numbers, steps))
        if numbers == WAY_BACK:
            return []
        result = self.results.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    def now_s(self) -> float:
        return self.time_s

    def emergency_stop(self) -> None:
        self.stopped = True


class PlayedPlace:
    """A robot is there if its distance is 100 or more, and turned by less than 10 degrees."""

    def __init__(self, *, asks: bool = False, steps: int | None = None, heading: int | None = 1):
        self.asks_each_time = asks
        self.heading = heading
        self._steps = steps
        self.headings: list[float | None] = []

    def is_there(self, observed: Sequence[float], first_heading_deg: float | None) -> bool:
        self.headings.append(first_heading_deg)
        return observed[0] >= 100.0

    def way_from(self, observed: Sequence[float]) -> Any:
        return None if self._steps is None else (WAY_BACK, self._steps)

    def asked(self, observed: Sequence[float]) -> dict[str, float]:
        return {"distance_mm": observed[0]}


class Told:
    """A recorder that keeps what it is told, and does something at each post."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []
        self.posts = 0

    def tell(self, kind: str, **values: Any) -> None:
        self.events.append({"kind": kind, **values})

    def post(self) -> None:
        self.posts += 1

    def of_kind(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.events if event["kind"] == kind]


class PlayedSearch:
    """A search that asks for the number of what it was told."""

    def __init__(self) -> None:
        self.told: list[tuple[float, tuple[float, ...], bool]] = []

    def ask(self) -> tuple[float, ...]:
        return (float(len(self.told)),)

    def tell(self, score: float, *, numbers: tuple[float, ...], has_failed: bool) -> None:
        self.told.append((score, numbers, has_failed))

    def state(self) -> int:
        return len(self.told)


READY = [SimpleNamespace(values=(100.0 + step, 5.0, 0.0)) for step in range(4)]


def teaching(
    link: PlayedLink,
    place: PlayedPlace | None = None,
    score: Callable[[Record], float] = lambda record: 7.0,
    *,
    falls_late: bool = False,
    goes_on: bool = False,
) -> tuple[Any, Told]:
    made: Any = HubTeaching.__new__(HubTeaching)
    channels = (object(), Pitch(), Roll())
    made._lesson = SimpleNamespace(
        interface=SimpleNamespace(channels=channels),
        score=score,
        falls_late=falls_late,
        steps=50,
        step_ms=20,
    )
    made._place = place or PlayedPlace()
    made._robot = None
    made._link = link
    made._recorder = told = Told()
    made._has_gone_on = False
    made._first_heading_deg = None

    def wait(seconds: float) -> None:
        link.time_s += seconds
        if goes_on:
            made.go_on()

    made._transport = SimpleNamespace(pause=wait)
    link.observed = link.observed or [(150.0, 3.0, 0.0)]
    return made, told


@pytest.fixture(autouse=True)
def no_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_teaching, "program_by", lambda lesson, robot, numbers: str(numbers))


def test_a_trial_is_told_to_the_search_and_to_the_page() -> None:
    made, told = teaching(PlayedLink(READY, READY))
    search = PlayedSearch()
    made._one_trial(search, None)
    made._one_trial(search, [1.5, 2.0])
    assert search.told == [(7.0, (0.0,), False), (7.0, (1.5, 2.0), False)]
    first, second = told.of_kind("trial")
    assert first["numbers"] == (0.0,) and second["numbers"] == (1.5, 2.0)
    # Four readings are three steps of 20 ms.
    assert (first["score"], first["fell"], first["seconds"]) == (7.0, False, 0.06)
    assert (first["source"], first["state"], second["state"]) == ("(0.0,)", 1, 2)
    assert told.posts == 2 and [steps for _, steps in made._link.made] == [50, 50]


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "falls_late", "fell", "has_failed"),
    [
        (TILT_DEG, -TILT_DEG, False, False, False),
        (TILT_DEG + 0.1, 0.0, False, True, True),
        (0.0, -TILT_DEG - 0.1, False, True, True),
        # Where late is better than soon, a fall is as good as its score.
        (-TILT_DEG - 0.1, 0.0, True, True, False),
    ],
)
def test_a_robot_that_lies_at_the_end_has_fallen(
    pitch_deg: float, roll_deg: float, falls_late: bool, fell: bool, has_failed: bool
) -> None:
    last = SimpleNamespace(values=(999.0, pitch_deg, roll_deg))
    lying = SimpleNamespace(values=(0.0, 90.0, 90.0))
    made, told = teaching(PlayedLink([lying, last]), falls_late=falls_late)
    search = PlayedSearch()
    made._one_trial(search, None)
    assert told.of_kind("trial")[0]["fell"] is fell
    assert search.told[0][2] is has_failed


def test_a_score_that_nobody_knows_is_none_on_the_page() -> None:
    made, told = teaching(PlayedLink(READY), score=lambda record: math.nan)
    made._one_trial(PlayedSearch(), None)
    assert told.of_kind("trial")[0]["score"] is None


def test_a_trial_that_was_lost_with_the_link_is_made_again_five_times() -> None:
    link = PlayedLink(None, HubError("lost"), None, HubError("lost"), None, READY)
    made, told = teaching(link)
    made._one_trial(PlayedSearch(), None)
    assert [event["text"] for event in told.of_kind("lost")] == [
        "some of what the hub said of its trial was lost",
        "lost",
    ] * 2 + ["some of what the hub said of its trial was lost"]
    assert link.opened == 6 and told.posts == 6
    # All of them with the same numbers.
    assert {numbers for numbers, _ in link.made} == {(0.0,)}
    made, told = teaching(PlayedLink(*[HubError("lost")] * 6, READY))
    with pytest.raises(HubError, match="lost"):
        made._one_trial(PlayedSearch(), None)
    assert len(told.of_kind("lost")) == 5


@pytest.mark.parametrize("error", [HubProgramError("of the program"), HubProtocolError("odd")])
def test_what_the_hub_says_of_its_program_is_not_tried_again(error: HubError) -> None:
    link = PlayedLink(error, READY)
    made, told = teaching(link)
    with pytest.raises(type(error)):
        made._one_trial(PlayedSearch(), None)
    assert link.opened == 1 and told.events == []


def test_a_robot_drives_back_by_itself_three_times() -> None:
    link = PlayedLink(READY)
    link.observed = [(10.0, 3.0), (20.0, 3.0), (30.0, 3.0), (100.0, 3.0)]
    made, told = teaching(link, PlayedPlace(steps=255))
    made._one_trial(PlayedSearch(), None)
    # By as many steps as a trial has at most.
    assert link.made == [(WAY_BACK, 50)] * 3 + [((0.0,), 50)]
    assert told.of_kind("place") == []
    few = PlayedLink(READY)
    few.observed = [(10.0, 3.0), (100.0, 3.0)]
    made, _ = teaching(few, PlayedPlace(steps=2))
    made._one_trial(PlayedSearch(), None)
    assert few.made == [(WAY_BACK, 2), ((0.0,), 50)]


def test_a_person_is_asked_where_the_robot_does_not_get_back() -> None:
    link = PlayedLink(READY)
    link.observed = [(10.0, 3.0), (11.0, 3.0), (12.0, 3.0), (120.0, 8.0)]
    made, told = teaching(link, place := PlayedPlace(), goes_on=True)
    made._one_trial(PlayedSearch(), None)
    # It says that it is there too early once.
    assert [event["distance_mm"] for event in told.of_kind("place")] == [11.0, 12.0]
    assert link.time_s == 2.0 and link.made == [((0.0,), 50)]
    # Its heading is that of where it was put last.
    assert place.headings[0] == 3.0 and place.headings[-1] == 8.0
    assert made._first_heading_deg == 8.0


def test_some_places_ask_before_each_trial() -> None:
    link = PlayedLink(READY, READY)
    made, told = teaching(link, PlayedPlace(asks=True, heading=None), goes_on=True)
    for count in (1, 2):
        made._one_trial(PlayedSearch(), None)
        # Who has gone on once is asked again.
        assert len(told.of_kind("place")) == count
    assert made._first_heading_deg is None


def test_nobody_is_waited_for_longer_than_ten_minutes() -> None:
    link = PlayedLink(READY)
    link.observed = [(10.0, 3.0)]
    made, _ = teaching(link)
    with pytest.raises(HubError, match="nobody has put the robot back; do so, and go on"):
        made._wait_for_person()
    assert link.time_s == 600.0


def test_a_robot_that_is_stopped_by_hand_has_no_more_trials(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches: list[Any] = []

    class Search(PlayedSearch):
        def __init__(self, numbers: Any, seed: int) -> None:
            super().__init__()
            self.made_with = (numbers, seed)
            self.loaded: list[Any] = []
            searches.append(self)

        def load_state(self, state: Any) -> None:
            self.loaded.append(state)

        def begin_elsewhere(self) -> None:
            self.loaded.append("elsewhere")

    monkeypatch.setattr(hub_teaching, "BayesianSearch", Search)
    made, told = teaching(PlayedLink(READY, READY, StoppedError("by hand"), READY))
    made._lesson.structure = SimpleNamespace(numbers="numbers")
    made.run({"seed": 3, "state": None, "trials": 5, "numbers": None})
    assert len(told.of_kind("trial")) == 2
    made, told = teaching(PlayedLink(READY, READY))
    made._lesson.structure = SimpleNamespace(numbers="numbers")
    made.run({"seed": 4, "state": "state", "trials": 1, "numbers": [2.0], "elsewhere": True})
    assert len(told.of_kind("trial")) == 1
    assert [search.made_with for search in searches] == [("numbers", 3), ("numbers", 4)]
    assert [search.loaded for search in searches] == [[], ["state", "elsewhere"]]
    made.stop()
    assert made._link.stopped
