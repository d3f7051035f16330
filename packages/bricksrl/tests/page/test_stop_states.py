"""What the page says of an emergency stop, of its connection, and of who drives, in a real
browser."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from browser import TIMEOUT_MS, chromium, sleep, tab

from brickhub.entry import Entry
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import HubError
from bricksrl.page import server as page_server
from bricksrl.page.live import LivePage, PageDriver
from bricksrl.page.server import PageOptions

pytestmark = pytest.mark.realtime


class Robot(BricksEnv):
    """A robot of which only the stop is real."""

    batch_size = ()

    def __init__(self) -> None:
        self.stops, self.is_at_rest, self.error = 0, threading.Event(), ""

    def stop(self) -> None:
        self.stops += 1
        if self.error:
            raise HubError(self.error)

    @property
    def has_stopped(self) -> bool:
        return self.is_at_rest.is_set()


class Live(LivePage):
    """Page of the robot, which can be driven, and whose server can be frozen."""

    def __init__(self, robot: Robot, *, in_charge: bool = False, port: int | None = None) -> None:
        super().__init__("a robot", options=PageOptions(page_port=port))
        self.driver = PageDriver((Entry("drive_speed", -1.0, 1.0, "mm/s"),), in_charge=in_charge)
        self._can_give_back = not in_charge
        self.attach(robot)

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """As if its process were stopped, or the network were cut."""
        go_on = threading.Event()
        assert self._loop is not None
        self._loop.call_soon_threadsafe(go_on.wait, 60.0)
        try:
            yield
        finally:
            go_on.set()


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as started:
        yield started


def button(page: object, name: str) -> object:
    return page.get_by_role("button", name=name, exact=True)


def sees(page: object, place: str, text: str) -> None:
    page.locator(place).filter(has_text=text).wait_for(timeout=TIMEOUT_MS)


def test_stop_is_sent_then_confirmed_by_the_robot(browser: object) -> None:
    robot = Robot()
    with Live(robot) as live, tab(browser, live.url) as page, tab(browser, live.url) as other:
        other.get_by_label("Your name").fill("Ada")
        other.get_by_label("Your name").press("Enter")
        sees(page, "#others", "Ada")
        button(other, "EMERGENCY STOP").click()
        for one in (page, other):
            sees(one, "#stop-said", "not confirmed to be stopped yet")
        robot.is_at_rest.set()
        sees(other, "#stop-said.confirmed", "Confirmed: the motors are stopped.")
        sees(page, "#stop-said.confirmed", "Ada has stopped it. ")
        live.release()
        page.locator("#stop-said").wait_for(state="hidden")


@pytest.mark.parametrize("error", ["the link to the hub is lost", ""])
def test_stop_that_is_not_confirmed_says_what_to_do(
    browser: object, monkeypatch: pytest.MonkeyPatch, error: str
) -> None:
    monkeypatch.setattr(page_server, "CONFIRM_S", 0.3)
    robot = Robot()
    robot.error = error
    with Live(robot) as live, tab(browser, live.url) as page:
        button(page, "EMERGENCY STOP").click()
        sees(page, "#stop-said.unconfirmed", "press the button of the hub itself")
        sees(page, "#stop-said", error)


def test_frozen_server_is_noticed_and_the_stop_says_so(browser: object) -> None:
    robot = Robot()
    robot.is_at_rest.set()
    with Live(robot) as live, tab(browser, live.url) as page:
        sees(page, "#state", "running")
        with live.frozen():
            pressed_s = time.monotonic()
            page.keyboard.press("Space")
            sees(page, "#stop-said", "Stopping")
            sees(page, "#stop-said.silent", "No connection: press the button of the hub itself")
            assert 0.9 < time.monotonic() - pressed_s < 3.0
            sees(page, "#state.lost", "no connection")
            assert time.monotonic() - pressed_s < 6.0 and not robot.stops
        sees(page, "#stop-said.confirmed", "Confirmed")
        assert robot.stops, "it is sent again when the connection is back"
        sees(page, "#state", "STOPPED")


def test_page_that_is_frozen_silently_does_not_say_running(browser: object) -> None:
    with Live(Robot()) as live, tab(browser, live.url) as page:
        sees(page, "#state", "running")
        with live.frozen():
            sees(page, "#state.lost", "no connection")
            assert page.locator("body.lost").count() == 1
        sees(page, "#state", "running")
        sleep(page, 4.0)
        sees(page, "#state", "running")


def test_tab_of_an_ended_page_asks_no_more(browser: object) -> None:
    """Neither after the server's last word, nor where another page has its port."""
    with Live(Robot()) as live, tab(browser, live.url) as page:
        sees(page, "#state", "running")
        asked = []
        live.close()
        sees(page, "#state.finished", "the run has ended")
        page.on("websocket", lambda socket: asked.append(socket.url))
        page.wait_for_timeout(2_000)
        assert not asked


def test_tab_of_another_page_on_the_same_port_is_told(browser: object) -> None:
    with Live(Robot()) as live, tab(browser, live.url) as page:
        sees(page, "#state", "running")
        page.context.clear_cookies()  # to the later page, those of the former are none
        with live.frozen():
            sees(page, "#state.lost", "no connection")
        sees(page, "#state.finished", "this page has ended")


def test_stop_is_reached_by_keyboard_and_seen_at_each_size(browser: object) -> None:
    robot = Robot()
    with Live(robot) as live, tab(browser, live.url, 320, 568) as page:
        button(page, "EMERGENCY STOP").wait_for()
        page.evaluate("scrollTo(0, 3000)")
        page.keyboard.press("Tab")
        for _ in range(3):
            if page.evaluate("document.activeElement.id") == "stop":
                break
            page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.id") == "stop"
        page.keyboard.press("Enter")
        sees(page, "#stop-said", "The stop is sent")
        robot.is_at_rest.set()
        sees(page, "#stop-said.confirmed", "Confirmed")
        for width, height in ((1280, 800), (390, 844), (320, 568), (844, 390), (568, 320)):
            page.set_viewport_size({"width": width, "height": height})
            page.evaluate("scrollTo(0, 3000)")
            # Away from it, and back by the keyboard.
            page.keyboard.press("Tab")
            assert page.evaluate("document.activeElement.id") != "stop"
            page.keyboard.press("Shift+Tab")
            assert page.evaluate("document.activeElement.id") == "stop"
            for place in ("#stop", "#stop-said"):
                box = page.locator(place).bounding_box()
                assert box["x"] >= 0 and box["x"] + box["width"] <= width
                assert box["y"] >= 0 and box["y"] + box["height"] <= height / 2
            assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_space_in_a_name_stops_nothing(browser: object) -> None:
    robot = Robot()
    with Live(robot) as live, tab(browser, live.url) as page:
        page.get_by_label("Your name").fill("")
        page.get_by_label("Your name").type("Ada L")
        page.keyboard.press("Enter")
        sees(page, "#state", "running")
        limit_s = time.monotonic() + 30.0
        while live.visitors.here()[0].name != "Ada L":
            assert time.monotonic() < limit_s
            page.wait_for_timeout(50)
        assert not robot.stops
        page.keyboard.press("Space")
        sees(page, "#stop-said", "The stop is sent")


def test_visitors_ask_each_other_for_the_robot(browser: object) -> None:
    with (
        Live(Robot()) as live,
        tab(browser, live.url) as ada,
        tab(browser, live.url, 390, 844) as ben,
    ):
        for page, name in ((ada, "Ada"), (ben, "Ben")):
            page.get_by_label("Your name").fill(name)
            page.get_by_label("Your name").press("Enter")
        button(ada, "Take over").click()
        sees(ada, "#driver", "you drive")
        sees(ben, "#driver", "Ada drives")
        button(ben, "Pause").click()
        sees(ben, "#note", "Ada drives this robot; ask first.")
        for width, height in ((1366, 768), (844, 390), (390, 844)):
            ben.set_viewport_size({"width": width, "height": height})
            ben.evaluate("scrollTo(0, document.body.scrollHeight)")
            note, stop = (ben.locator(place).bounding_box() for place in ("#note", "#stop"))
            assert note["x"] >= 0 and note["x"] + note["width"] <= width
            assert stop["y"] + stop["height"] < note["y"] < height - note["height"]
        assert not live._paused
        button(ben, "Ask Ada").click()
        sees(ada, "[role=alertdialog]", "Ben asks for your robot")
        stop, question = (ada.locator(place).bounding_box() for place in ("#stop", ".question"))
        assert stop["y"] + stop["height"] < question["y"], "the stop is never covered"
        button(ada, "No").click()
        sees(ben, "#note", "Ada says no.")
        button(ben, "Ask Ada").click()
        button(ada, "Yes").click()
        sees(ben, "#driver", "you drive")
        sees(ada, "#driver", "Ben drives")
        sees(ada, "#note", "as you said yes")
        ben.reload()
        sees(ben, "#driver", "you drive")
        with_two = ben.context.new_page()
        with_two.goto(live.url)
        sees(with_two, "#driver", "you drive")


def test_who_left_is_not_asked(browser: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.page.visitors.AWAY_S", 0.5)
    with Live(Robot(), in_charge=True) as live, tab(browser, live.url) as ben:
        with tab(browser, live.url) as first:
            sees(first, "#title", "a robot")
        sees(ben, "#title", "a robot")
        sees(ben, "#driver", "you drive")
