"""A real hub from a tab, without a browser: its Bluetooth is played before a simulated hub."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from played_page import PlayedPage

from brickhub.errors import DescriptionError
from brickhub.hub.program.generate import generate_trials
from brickhub.hub.transports.connection import HubIdentity
from brickhub.hub.transports.profile import Capabilities, Feature, Status
from brickhub.robot import HubKind, Motor, Robot
from brickhub.virtual.body import Body
from bricktwin.robots import SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.site.tab import hub_lessons, lessons, real_hub, run
from bricktwin.site.tab.hub_lessons import HUB_LESSONS, approach_speed
from bricktwin.site.tab.plain_values import plain
from bricktwin.site.tab.real_hub import LOST_EXIT_CODE, RealHub
from bricktwin.site.tab.run import REFUSED_EXIT_CODE, STOPPED_EXIT_CODE
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene
from bricktwin.worlds import world

pytestmark = pytest.mark.realtime
EXAMPLES = Path(__file__).parents[4] / "examples"

WAIT = "from pybricks.tools import wait\n"
DRIVE = (
    f"{WAIT}from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
    "Motor(Port.A).run(300)\nwhile True:\n    wait(10)\n"
)


class Tab:
    """A tab with a hub in reach."""

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        self.robot = robot
        self.page = PlayedPage(robot, body)
        self.hub = self.page.hub
        self.python = RealHub(self.page, self.page)

    def do(self, doing: str, **request: Any) -> int:
        return self.python.obey(json.dumps({"hub": doing, **request}), {"robot": plain(self.robot)})

    def run(self, source: str, stdin: str = "") -> int:
        self.hub.files["main.py"] = source
        return self.do("run", files={"main.py": source}, name="main.py", stdin=stdin)

    def teach(
        self,
        trials: int,
        goal: str = "walk",
        numbers: tuple[float, ...] | None = None,
        state: dict[str, Any] | None = None,
    ) -> int:
        lesson = HUB_LESSONS[goal](self.robot).lesson
        program = generate_trials(
            self.robot,
            lesson.interface,
            lesson.structure.numbers,
            lesson.structure.hub_source(),
        )
        self.hub.library.append(program.source)
        request = {"goal": goal, "seed": 3, "state": state, "numbers": numbers}
        return self.do("teach", trials=trials, **request)

    def press(self, wish: str) -> None:
        self.page.put({"kind": wish})


@pytest.fixture
def tab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tab]:
    yield from opened(tmp_path, monkeypatch, TWO_WHEELER)


@pytest.fixture
def walker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tab]:
    """A Walker before a wall, whose trials take a second."""
    monkeypatch.setattr(lessons, "_STRIDE_STEPS", 4)
    body = make_body(WALKER, scene=Scene(wall_distance_mm=(1300.0, 1300.0)))
    yield from opened(tmp_path, monkeypatch, WALKER, body)


def opened(
    folder: Path, monkeypatch: pytest.MonkeyPatch, robot: Robot, body: Body | None = None
) -> Iterator[Tab]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    for module in (run, real_hub):
        monkeypatch.setattr(module, "FOLDER", folder / "programs")
    made = Tab(robot, body)
    yield made
    made.do("leave")
    made.page.close()


def test_a_program_runs_on_the_hub_with_its_input_and_its_output(tab: Tab) -> None:
    assert tab.do("connect") == 0
    (known,) = [event for event in tab.page.of("hub") if event["connected"]]
    assert (known["name"], known["type"], known["battery"]) == ("Pybricks Hub", "prime", "charged")
    source = "name = input()\nprint('hello', name)\nfor i in range(40):\n    print(i)\n"
    assert tab.run(source, "Ada\n") == 0
    expected = "hello Ada\n" + "".join(f"{i}\n" for i in range(40))
    assert tab.page.text().replace("Ada\n\n", "").endswith(expected)
    assert tab.page.text("err") == ""


def test_an_error_comes_in_the_hubs_own_words(tab: Tab) -> None:
    assert tab.run(f"{WAIT}print('before')\nx = 1 / 0\n") == 1
    assert tab.page.text() == "before\n"
    assert 'File "main.py", line 3' in tab.page.text("err")


def test_what_the_hub_cannot_run_is_refused_before_it_is_sent(tab: Tab) -> None:
    large = "x = (" + "12345678, " * 60_000 + ")\n"
    assert tab.run(large) == REFUSED_EXIT_CODE
    assert "the prime hub takes" in tab.page.text("err")
    assert tab.run("import numpy\n") == REFUSED_EXIT_CODE
    assert "the hub has no module 'numpy'" in tab.page.text("err")
    assert tab.hub.size == 0


def test_stop_ends_any_program_and_the_hub_stays_connected(tab: Tab) -> None:
    tab.page.later(0.6, lambda: tab.press("stop"))
    assert tab.run(DRIVE) == STOPPED_EXIT_CODE
    assert not tab.hub.is_driven and not tab.hub.is_running
    assert tab.run("print('again')\n") == 0
    assert tab.hub.connections == 1


def test_a_lost_link_is_told_and_the_hub_is_found_again(tab: Tab) -> None:
    tab.do("connect")
    tab.page.later(0.6, lambda: tab.hub.submit(tab.hub.lose()))
    assert tab.run(DRIVE) == LOST_EXIT_CODE
    assert "the link to the hub is lost (it is out of reach" in tab.page.text("err")
    assert tab.page.of("hub")[-1]["connected"] is False
    # A program of the user's knows no watchdog: a person ends it.
    assert tab.hub.is_driven
    tab.page.later(0.5, tab.hub.press_button)
    assert tab.run("print('again')\n") == 0


def test_a_write_without_an_answer_ends_with_the_link(tab: Tab) -> None:
    """A browser's promise may stay open for ever when the link is lost."""
    tab.do("connect")
    tab.page.is_mute = True
    tab.page.later(0.5, lambda: tab.hub.submit(tab.hub.lose()))
    begin_s = time.monotonic()
    assert tab.run("print('never')\n") == LOST_EXIT_CODE
    assert time.monotonic() - begin_s < 1.5
    assert "the link to the hub is lost" in tab.page.text("err")
    tab.page.is_mute = False
    assert tab.run("print('again')\n") == 0


def test_a_trial_whose_write_has_no_answer_is_tried_again(
    walker: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    from brickhub.hub.program import generate

    monkeypatch.setattr(generate, "END_MS", 500)
    walker.do("connect")

    def lose() -> None:
        walker.page.is_mute = True
        walker.hub.submit(walker.hub.lose())
        time.sleep(0.3)
        walker.page.is_mute = False

    # In the first try, and where the next one is asked for.
    walker.page.later(0.8, lose)
    assert walker.teach(1) == 0
    assert len(walker.page.of("trial")) == 1 and walker.hub.connections == 2


def test_refused_writes_are_tried_again_and_a_battery_that_falls_is_told(tab: Tab) -> None:
    tab.do("connect")
    tab.hub.refusals = 3
    tab.hub.battery = Status.BATTERY_LOW
    assert tab.run(f"{WAIT}print('there')\nwait(600)\n") == 0
    assert tab.page.text() == "there\n"
    assert tab.page.of("hub")[-1]["battery"] == "low"
    tab.hub.battery = Status.BATTERY_EMPTY
    time.sleep(0.7)
    tab.python.attend()
    assert tab.page.of("hub")[-1]["battery"] == "empty"


def test_a_robot_is_taught_and_measures_by_itself(walker: Tab) -> None:
    assert walker.teach(2) == 0
    first, second = walker.page.of("trial")
    assert first["seconds"] == 1.0 and first["fell"] is False
    assert isinstance(first["score"], float) and first["numbers"] != second["numbers"]
    assert len(second["state"]["scores"]) == 2
    assert "NUMBERS = (" in first["source"]
    assert not walker.hub.is_running and not walker.hub.is_driven


def test_a_search_goes_on_where_it_was(walker: Tab) -> None:
    walker.teach(1)
    (first,) = walker.page.of("trial")
    walker.teach(1, state=first["state"])
    *_, second = walker.page.of("trial")
    assert second["state"]["scores"][:1] == first["state"]["scores"]
    assert len(second["state"]["scores"]) == 2
    assert second["numbers"] != first["numbers"]


def test_a_trial_whose_link_is_lost_is_tried_again(
    walker: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    from brickhub.hub.program import generate

    # Else the hub takes ten seconds to advertise again.
    monkeypatch.setattr(generate, "END_MS", 500)
    walker.do("connect")
    walker.page.later(0.8, lambda: walker.hub.submit(walker.hub.lose()))
    assert walker.teach(1) == 0
    (lost,) = walker.page.of("lost")
    assert "the link to the hub is lost" in lost["text"]
    assert len(walker.page.of("trial")) == 1 and walker.hub.connections == 2


def test_an_emergency_stop_ends_a_trial_and_keeps_what_was_learned(walker: Tab) -> None:
    walker.do("connect")
    walker.page.later(1.8, lambda: walker.press("stop"))
    assert walker.teach(5) == STOPPED_EXIT_CODE
    assert len(walker.page.of("trial")) == 1
    assert not walker.hub.is_driven and not walker.hub.is_running
    assert walker.teach(1) == 0


def test_a_person_is_asked_to_put_the_robot_back(
    walker: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub_lessons, "_WALK_NEAREST_MM", 1350.0)
    asked: list[dict[str, Any]] = []

    def answer(event: dict[str, Any]) -> None:
        if event["kind"] == "place":
            asked.append(event)
            walker.press("stop" if len(asked) == 2 else "go on")

    walker.page.on_event = answer
    assert walker.teach(1) == STOPPED_EXIT_CODE
    assert walker.page.of("trial") == []
    assert asked[0]["wanted_mm"] == 1300.0 and 1200 < asked[0]["distance_mm"] < 1400


@pytest.fixture
def scout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tab]:
    """A robot at the edge of a line, whose trials take half a second."""
    monkeypatch.setattr(lessons, "_LINE_STEPS", 10)
    yield from opened(tmp_path, monkeypatch, SCOUT, make_body(SCOUT, scene=world("line-simple")))


def test_a_robot_that_has_lost_its_line_is_put_back(scout: Tab) -> None:
    asked: list[dict[str, Any]] = []

    def answer(event: dict[str, Any]) -> None:
        if event["kind"] == "place":
            asked.append(event)
            scout.press("stop")

    scout.page.on_event = answer
    # It turns to the wrong side, and away from the edge.
    assert scout.teach(2, "follow", (200.0, -5.0)) == STOPPED_EXIT_CODE
    (trial,) = scout.page.of("trial")
    assert 0 < trial["score"] < 60
    assert asked[0]["reflection_pct"] > 65 or asked[0]["reflection_pct"] < 10


@pytest.fixture
def balancer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tab]:
    """A robot on two wheels, held upright until its motors turn; its tries take two seconds."""
    monkeypatch.setattr(lessons, "_UPRIGHT_STEPS", 100)
    robot = robot_as_drawn(EXAMPLES / "drawings" / "balancer.ldr").robot
    body = make_body(robot, scene=Scene(held_deg=(1.0, 1.0)))
    yield from opened(tmp_path, monkeypatch, robot, body)


STANDS = (0.0, 25.0, 0.05, 0.02, 0.015)
FALLS = (0.0, 2.0, 0.0, 0.02, 0.015)


@pytest.mark.parametrize("numbers", [STANDS, FALLS])
def test_a_hand_holds_a_robot_before_each_try_to_keep_upright(
    balancer: Tab, numbers: tuple[float, ...]
) -> None:
    asked: list[dict[str, Any]] = []

    def answer(event: dict[str, Any]) -> None:
        if event["kind"] == "place":
            asked.append(event)
            balancer.press("stop" if len(asked) == 2 else "go on")

    balancer.page.on_event = answer
    # After the first try it is asked for again, whether it stands or lies.
    assert balancer.teach(2, "upright", numbers) == STOPPED_EXIT_CODE
    (tried,) = balancer.page.of("trial")
    assert tried["fell"] is (numbers is FALLS)
    assert (tried["score"] > 80.0) is (numbers is STANDS)
    assert abs(asked[0]["pitch_deg"]) <= 2
    assert not balancer.hub.is_driven


def test_speed_is_known_though_the_sensor_now_and_then_sees_nothing() -> None:
    lesson = HUB_LESSONS["walk"](WALKER).lesson
    way_mm = [1300.0 - 20.0 * step for step in range(11)]
    assert approach_speed(way_mm, lesson) == 80.0
    way_mm[4] = way_mm[8] = 2000.0
    way_mm[6] = 700.0
    assert approach_speed(way_mm, lesson) == pytest.approx(80.0, abs=1.0)
    assert approach_speed([2000.0] * 11, lesson) == 0.0


def identity(kind: HubKind) -> HubIdentity:
    return HubIdentity("hub", "page", kind, "4.0.0", (1, 5), Capabilities(512, Feature(0), 1, 1))


@pytest.mark.parametrize("kind", [HubKind.PRIME, HubKind.TECHNIC, HubKind.ESSENTIAL])
def test_a_robot_is_taken_as_built_on_the_hub_that_is_connected(kind: HubKind) -> None:
    motors = (Motor("left", "A"), Motor("right", "B"))
    drawn = Robot("cart", HubKind.PRIME, motors, needs_imu=True)
    built = real_hub._on_hub(drawn, identity(kind))
    assert built == replace(drawn, hub=kind)


@pytest.mark.parametrize(
    ("robot", "kind", "message"),
    [
        (SCOUT, HubKind.CITY, "a city hub has ports A, B"),
        (Robot("dizzy", HubKind.PRIME, needs_imu=True), HubKind.CITY, "a city hub has no IMU"),
        (Robot("drawn", HubKind.PRIME, plan="drawn.ldr"), HubKind.PRIME, "was not read"),
    ],
)
def test_a_connected_hub_that_lacks_what_the_robot_needs_is_refused(
    robot: Robot, kind: HubKind, message: str
) -> None:
    with pytest.raises(DescriptionError, match=message):
        real_hub._on_hub(robot, identity(kind))
