"""Lessons on a real robot: where a trial may begin, and how good it was, by what the robot observes
alone."""

from __future__ import annotations

import asyncio
import json
import math
from collections import deque
from dataclasses import replace
from typing import Any

import pytest

from brickhub.errors import DescriptionError, HubBusyError, HubDisconnectedError
from brickhub.hub.interface import Distance, Heading
from bricktwin.robots import SCOUT, TWO_WHEELER, WALKER
from bricktwin.site.tab.hub_lessons import (
    HUB_LESSONS,
    AtEdge,
    Place,
    approach_speed,
    stop_at_wall,
    walk_to_wall,
)
from bricktwin.site.tab.lessons import GAP_MM, Record, nearness
from bricktwin.site.tab.mailbox_loop import MailboxRunner
from bricktwin.site.tab.web_port import WebPort

PLACE = Place(350.0, 1700.0, 1300.0, distance=0, heading=1)


@pytest.mark.parametrize(
    ("distance_mm", "heading_deg", "first_deg", "is_there"),
    [
        (350.0, 0.0, 0.0, True),
        (349.9, 0.0, 0.0, False),
        (1700.0, 0.0, 0.0, True),
        (1700.1, 0.0, 0.0, False),
        (500.0, 35.0, 0.0, True),
        (500.0, 35.1, 0.0, False),
        (500.0, -35.1, 0.0, False),
        (500.0, 715.0, 0.0, True),
        (500.0, -170.0, 170.0, True),
        (500.0, 90.0, None, True),
    ],
)
def test_a_trial_begins_at_a_distance_and_straight_ahead(
    distance_mm: float, heading_deg: float, first_deg: float | None, is_there: bool
) -> None:
    assert PLACE.is_there((distance_mm, heading_deg), first_deg) is is_there
    no_matter = replace(PLACE, heading=None)
    assert no_matter.is_there((500.0, heading_deg), first_deg)


def test_a_robot_gets_back_by_itself_if_it_can_and_sees_something() -> None:
    assert PLACE.way_from((500.0, 0.0)) is None and PLACE.way_from((2000.0, 0.0)) is None
    drives = replace(PLACE, way_back=(600.0, 1.5))
    assert drives.way_from((2000.0, 0.0)) == ((600.0, 1.5), 255)
    legs = replace(PLACE, another_posture=(0.4, 0.0))
    assert legs.way_from((1989.9, 0.0)) is None
    assert legs.way_from((1990.0, 0.0)) == ((0.4, 0.0), 2)
    assert PLACE.asked((712.4, 0.0)) == {"distance_mm": 712, "wanted_mm": 1300.0}


def test_along_a_line_a_trial_begins_at_its_edge() -> None:
    edge = AtEdge(reflection=1, edge_pct=45.0)
    seen = [edge.is_there((0.0, 45.0 + off), None) for off in (0, 24.9, 25.0, -24.9, -25.0)]
    assert seen == [True, True, False, True, False]
    assert edge.asked((0.0, 12.6)) == {"reflection_pct": 13}
    assert edge.way_from((0.0, 0.0)) is None


def test_the_speed_to_the_wall_is_the_median_of_all_slopes() -> None:
    lesson = walk_to_wall(WALKER).lesson
    settle, step_ms = lesson.settle_steps, lesson.step_ms

    def speed(*distances_mm: float) -> float:
        return approach_speed([0.0] * settle + list(distances_mm), lesson)

    per_step = 1000 / step_ms
    assert speed(900, 880, 860, 840, 820) == pytest.approx(20 * per_step)
    assert speed(900, 880, 300, 840, 820) == pytest.approx(20 * per_step), "one odd reading"
    assert speed(800, 810, 820) == pytest.approx(-10 * per_step)
    # Half of the readings are enough, fewer are not.
    assert speed(900, 2000, 860, 1990) == pytest.approx(20 * per_step)
    assert speed(900, 2000, 2000, 2000) == 0.0
    assert speed(900) == 0.0
    assert speed(900, 880, 870) == pytest.approx(15 * per_step)


def test_a_lesson_on_a_robot_s_hub_measures_with_its_own_sensors() -> None:
    walk = walk_to_wall(WALKER)
    *_, distance, heading = walk.lesson.interface.channels
    assert isinstance(distance, Distance) and isinstance(heading, Heading)
    channels = walk.lesson.interface.channels
    assert isinstance(walk.place, Place)
    assert channels[walk.place.distance] is distance
    assert walk.place.heading is not None and channels[walk.place.heading] is heading
    assert walk.place.another_posture is not None
    assert len(walk.place.another_posture) == len(walk.lesson.structure.numbers)
    blind = walk_to_wall(replace(WALKER, needs_imu=False))
    assert isinstance(blind.place, Place) and blind.place.heading is None
    record = Record()
    at = walk.place.distance
    for number in range(walk.lesson.settle_steps + 6):
        record.observed.append([0.0] * at + [1000.0 - 10.0 * number, 0.0])
    assert walk.lesson.score(record) == pytest.approx(10 * 1000 / walk.lesson.step_ms)
    stop = stop_at_wall(TWO_WHEELER).place
    assert isinstance(stop, Place)
    assert (stop.nearest_mm, stop.wanted_mm, stop.farthest_mm) == (510.0, 600.0, 690.0)
    assert stop.way_back is not None and stop.way_back[0] == stop.wanted_mm
    assert isinstance(HUB_LESSONS["follow"](SCOUT).place, AtEdge)
    with pytest.raises(DescriptionError, match="cannot measure how far it walks; give it an ultra"):
        walk_to_wall(replace(WALKER, sensors=()))


def test_who_is_soon_before_the_wall_and_stays_has_most() -> None:
    def score(*distances_mm: float) -> float:
        record = Record()
        record.observed = [(0.0,), *((distance_mm,) for distance_mm in distances_mm)]
        return nearness(record)

    assert score(GAP_MM, GAP_MM) == pytest.approx(100.0)
    near, nearer = score(GAP_MM + 200.0), score(GAP_MM + 100.0)
    assert 0 < near < nearer < 100.0 and nearer**2 == pytest.approx(100.0 * near)
    assert score(GAP_MM - 10.0) < score(GAP_MM + 10.0), "who is too near may have hit it"
    assert score(GAP_MM, GAP_MM + 200.0) == pytest.approx((100.0 + near) / 2)
    assert math.isnan(score())


class PlayedPage:
    """A page whose answers are given beforehand, one an operation."""

    def __init__(self, *answers: dict[str, Any]) -> None:
        self.answers = deque(answers)
        self.asked: list[tuple[str, str, str]] = []
        self.letters: list[dict[str, Any]] = []

    def ask(self, number: int, operation: str, characteristic: str, data: str) -> None:
        self.asked.append((operation, characteristic[:8], data))
        # One that nobody waits for comes first.
        self.letters.append({"kind": "answer", "number": 0})
        self.letters.append({"kind": "answer", "number": number, **self.answers.popleft()})

    def take(self) -> str:
        taken, self.letters = self.letters, []
        return json.dumps(taken) if taken else ""

    def wait(self, longest_ms: float) -> None:
        raise AssertionError("everything has come")


def test_bytes_go_through_the_page_and_events_come_back() -> None:
    page = PlayedPage({"name": "Hub", "id": "x1"}, {"value": "0aff"}, {}, {}, {})
    port = WebPort(page)
    runner = MailboxRunner(page, port.take)
    heard: list[bytes] = []
    lost: list[str] = []

    async def use() -> bytes:
        await port.open(heard.append, lost.append)
        read = await port.read("c5f50003-")
        await port.subscribe()
        await port.write(b"\x01\x02", "start the program")
        port.take({"kind": "event", "data": "0102ff"})
        port.take({"kind": "lost"})
        await port.close()
        port.take({"kind": "event", "data": "03"})
        return read

    assert runner.run(use(), 5.0, "use the hub") == b"\n\xff"
    assert not runner.is_running
    assert (port.name, port.address) == ("Hub", "x1")
    assert [asked[0] for asked in page.asked] == ["connect", "read", "subscribe", "write", "close"]
    assert page.asked[1][1] == "c5f50003" and page.asked[3][2] == "0102"
    assert heard == [b"\x01\x02\xff"] and lost == ["it is out of reach, or was switched off"]
    runner.close()


@pytest.mark.parametrize(
    ("operation", "error", "kind"),
    [
        ("write", "NotSupportedError", HubBusyError),
        ("write", "NetworkError", HubDisconnectedError),
        ("write", "InvalidStateError", HubDisconnectedError),
        ("read", "NotSupportedError", HubDisconnectedError),
    ],
)
def test_a_browser_s_error_is_one_of_ours(
    operation: str, error: str, kind: type[Exception]
) -> None:
    page = PlayedPage({"error": error, "message": "GATT  operation\nfailed"})
    port = WebPort(page)
    runner = MailboxRunner(page, port.take)
    doing = port.write(b"\x01", "stop it") if operation == "write" else port.read("c5f50003")
    with pytest.raises(kind, match=r"could not .*\(GATT operation failed\); ") as caught:
        runner.run(doing, 5.0, "use the hub")
    assert type(caught.value) is kind
    runner.close()


def test_a_closed_link_and_one_that_takes_too_long_are_errors_of_ours() -> None:
    from brickhub.errors import HubError, HubTimeoutError

    class Silent(PlayedPage):
        def wait(self, longest_ms: float) -> None:
            assert 0 < longest_ms <= 1000

    page = Silent()
    runner = MailboxRunner(page, lambda message: None)
    with pytest.raises(HubTimeoutError, match="could not look within 0.02 s; switch the hub off"):
        runner.run(asyncio.sleep(9), 0.02, "look")
    runner.close()
    runner.close()
    with pytest.raises(HubError, match="could not look: the link is closed; open it again"):
        runner.run(asyncio.sleep(0), 1.0, "look")
