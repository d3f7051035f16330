"""A real EV3 Brick on the cable of a tab, without a browser: its other end is a simulated brick."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from played_cable import CablePage

from brickhub.hub.program.generate import generate_trials
from brickhub.hub.transports.profile import PybricksCommand
from brickhub.robot import Robot
from brickhub.virtual.body import Body
from bricktwin.robots import EV3_DRIVER
from bricktwin.site.tab import real_hub, run
from bricktwin.site.tab.hub_lessons import HUB_LESSONS
from bricktwin.site.tab.plain_values import plain
from bricktwin.site.tab.real_hub import LOST_EXIT_CODE, RealHub
from bricktwin.site.tab.run import REFUSED_EXIT_CODE, STOPPED_EXIT_CODE
from bricktwin.twin.make_body import make_body
from bricktwin.worlds import world

pytestmark = pytest.mark.realtime

DRIVE = (
    "from pybricks.ev3devices import Motor\nfrom pybricks.parameters import Port\n"
    "from pybricks.tools import wait\nMotor(Port.B).run(300)\nwhile True:\n    wait(10)\n"
)


class Tab:
    """A tab with a brick on its cable."""

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        self.robot = robot
        self.page = CablePage(robot, body)
        self.hub = self.page.hub
        self.python = RealHub(self.page, self.page)

    def do(self, doing: str, **request: Any) -> int:
        asked = {"hub": doing, "by": "cable", **request}
        return self.python.obey(json.dumps(asked), {"robot": plain(self.robot)})

    def run(self, source: str, stdin: str = "") -> int:
        self.hub.files["main.py"] = source
        return self.do("run", files={"main.py": source}, name="main.py", stdin=stdin)

    def stop_frame(self) -> bytes:
        """What the page was told to write to stop the hub."""
        known = [event for event in self.page.of("hub") if event["connected"]]
        return bytes.fromhex(known[-1]["stop"])


@pytest.fixture
def tab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tab]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for module in (run, real_hub):
        monkeypatch.setattr(module, "FOLDER", tmp_path / "programs")
    made = Tab(replace(EV3_DRIVER, sensors=()))
    yield made
    made.do("leave")
    made.page.close()


def test_a_program_runs_on_the_brick_with_its_input_and_its_output(tab: Tab) -> None:
    assert tab.do("connect") == 0
    (known,) = [event for event in tab.page.of("hub") if event["connected"]]
    assert (known["name"], known["type"], known["battery"]) == ("EV3", "ev3", "charged")
    assert tab.run("name = input()\nprint('hello', name)\n", "Ada\n") == 0
    assert tab.page.text().endswith("hello Ada\n")
    assert tab.page.text("err") == ""


def test_a_brick_that_does_not_say_what_it_is_is_known_by_the_browser(tab: Tab) -> None:
    tab.hub.tells_product = False
    assert tab.do("connect") == 0
    assert tab.page.of("hub")[-1]["type"] == "ev3"


def test_what_the_brick_cannot_run_is_refused_before_it_is_sent(tab: Tab) -> None:
    assert tab.run("x = (" + "12345678, " * 60_000 + ")\n") == REFUSED_EXIT_CODE
    assert "the ev3 hub takes" in tab.page.text("err")
    assert tab.hub.size == 0


def test_stop_ends_any_program_and_the_brick_stays_connected(tab: Tab) -> None:
    tab.page.later(0.4, lambda: tab.page.put({"kind": "stop"}))
    assert tab.run(DRIVE) == STOPPED_EXIT_CODE
    assert not tab.hub.is_driven and not tab.hub.is_running
    assert tab.run("print('again')\n") == 0
    assert tab.page.text().endswith("again\n")


def test_the_page_stops_the_brick_by_a_frame_that_it_was_given(tab: Tab) -> None:
    """Its answer is not taken for that of a command of Python's."""
    tab.do("connect")
    frame = tab.stop_frame()
    tab.page.later(0.4, lambda: tab.page.write(frame))
    # The program was stopped on the hub, by nobody here.
    tab.run(DRIVE)
    assert frame not in tab.page.written
    assert tab.hub.commands.count(PybricksCommand.STOP_USER_PROGRAM) == 1
    assert not tab.hub.is_driven
    assert tab.run("print('again')\n") == 0


def test_a_pulled_cable_is_told_and_the_brick_is_found_again(tab: Tab) -> None:
    tab.do("connect")
    tab.page.later(0.4, tab.hub.pull_the_cable)
    assert tab.run(DRIVE) == LOST_EXIT_CODE
    assert "the link to the hub is lost (its cable was pulled" in tab.page.text("err")
    assert tab.page.of("hub")[-1]["connected"] is False
    tab.hub.press_button()
    tab.hub.wait_until("is_running", value=False)
    tab.hub.is_plugged_in = True
    assert tab.run("print('again')\n") == 0


def test_a_cable_that_cannot_be_opened_says_what_to_do(
    tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bricktwin.site.tab.hub_transport._FIRST_SEARCH_S", 0.1)
    tab.hub.is_plugged_in = False
    assert tab.do("connect") == LOST_EXIT_CODE
    assert "plug the hub in, switch it on, and close other pages" in tab.page.text("err")


def test_a_robot_learns_on_its_cable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A trial is the same over a cable as over Bluetooth."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tab = Tab(EV3_DRIVER, make_body(EV3_DRIVER, scene=world("line-simple")))
    lesson = HUB_LESSONS["follow"](EV3_DRIVER).lesson
    interface, structure = lesson.interface, lesson.structure
    program = generate_trials(EV3_DRIVER, interface, structure.numbers, structure.hub_source())
    tab.hub.library.append(program.source)
    request = {"goal": "follow", "seed": 3, "state": None, "numbers": None}
    try:
        assert tab.do("teach", trials=1, **request) == 0
        (trial,) = tab.page.of("trial")
        assert trial["seconds"] == 4.0 and trial["score"] > 0.0
        assert not tab.hub.is_driven
    finally:
        tab.do("leave")
        tab.page.close()
