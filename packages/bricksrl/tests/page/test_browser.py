"""The page in a real browser: buttons, tabs, reload, foreign pages, phone."""

from __future__ import annotations

import http.server
import io
import itertools
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from browser import chromium, sleep, tab
from PIL import Image

import bricksrl
from bricksrl.envs.registry import get_task
from bricksrl.envs.rollout import play
from bricksrl.page.board import Board
from bricksrl.page.live import LivePage
from bricksrl.page.play import play_on_page, resting_player
from bricksrl.page.program import ProgramPage
from bricksrl.page.server import PageServer
from bricksrl.policies.policy import random_player
from bricktwin.twin.make_body import make_body
from bricktwin.twin.objects import COLORS, Field, Line, Mark
from bricktwin.twin.scene import Scene
from bricktwin.view.drawing_of_body import View
from bricktwin.view.mirror import Mirror

pytestmark = pytest.mark.realtime

BOUND_S = 120.0


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as started:
        yield started


class Played(threading.Thread):
    """A virtual two-wheeler on a page, in a thread."""

    def __init__(self, env_id: str, *, by_hand: bool = False) -> None:
        super().__init__(daemon=True)
        self.env = bricksrl.make(env_id, seed=0)
        self.error: BaseException | None = None
        names = ("by hand",) if by_hand else ("resting", "random")
        self.page = LivePage(
            env_id, "a test", task=self.env.task, in_charge=by_hand, policies=names, speed="1x"
        )
        self.players = {
            "random": lambda: random_player(self.env, 0),
            "resting": lambda: resting_player(self.env),
            "by hand": lambda: resting_player(self.env),
        }

    def run(self) -> None:
        try:
            play_on_page(self.env, self.page, self.players)
        except _EndedError:
            pass
        except BaseException as error:  # noqa: BLE001  the test looks at it
            self.error = error

    def end(self) -> None:
        """End the thread's loop at the next step."""

        def leave(*_: object) -> None:
            raise _EndedError

        self.page.show_step = leave
        self.page._press("resume", None)
        self.page._press("reset", None)
        self.join(BOUND_S)
        assert not self.is_alive() and self.error is None, self.error

    @property
    def steps(self) -> int:
        return self.page.board.series["reward"].count

    @property
    def is_driven(self) -> bool:
        return any(servo.control.is_active for servo in self.env.twin.machine.servos.values())


class _EndedError(Exception):
    """End of the test."""


@contextmanager
def playing(env_id: str, *, by_hand: bool = False) -> Iterator[Played]:
    played = Played(env_id, by_hand=by_hand)
    with played.page:
        played.start()
        yield played
        played.end()


@pytest.fixture
def played() -> Iterator[Played]:
    with playing("Spinning-v0") as one:
        yield one


def until(condition: Callable[[], bool], what: str) -> None:
    start_s = time.monotonic()
    while not condition():
        assert time.monotonic() - start_s < BOUND_S, what
        time.sleep(0.02)


def at_rest(played: Played) -> int:
    """The number of steps once the robot rests."""
    count = -1
    for _ in range(20):
        if count == (count := played.steps):
            return count
        time.sleep(0.5)
    raise AssertionError("it goes on")


def state_is(page: object, state: str) -> None:
    page.locator(f"#state:text-is('{state}')").wait_for()


def button(page: object, name: str) -> object:
    return page.get_by_role("button", name=name, exact=True)


def test_every_button(browser: object, played: Played) -> None:
    with tab(browser, played.page.url) as page:
        page.wait_for_selector("#scene[data-frames]")
        assert "token" not in page.url, "the token is in a cookie now"
        until(lambda: played.steps > 2, "it plays")
        button(page, "Pause").click()
        state_is(page, "paused")
        count = at_rest(played)
        button(page, "Step").click()
        until(lambda: played.steps == count + 1, "one step")
        state_is(page, "paused")
        button(page, "Resume").click()
        state_is(page, "running")
        until(lambda: played.steps > count + 2, "it goes on")
        for name in ("max", "10x", "1x"):
            button(page, name).click()
            page.locator(f"#speeds button[aria-pressed=true]:text-is('{name}')").wait_for()
            assert played.page._speed == name
        page.get_by_role("combobox", name="Policy").select_option("resting")
        until(lambda: played.page.policy == "resting", "another policy")
        count = played.page.board.series["reward"].count
        page.get_by_role("combobox", name="Policy").select_option("random")
        until(lambda: played.page.policy == "random", "and back")
        button(page, "EMERGENCY STOP").click()
        state_is(page, "STOPPED")
        until(lambda: not played.is_driven, "motors are at rest")
        count = at_rest(played)
        page.get_by_role("alert").get_by_text("stopped by hand").wait_for()
        button(page, "Reset").click()
        state_is(page, "running")
        until(lambda: played.steps > count, "it starts again")
        page.locator("figure[data-series='reward/0']").wait_for()
        page.locator("[data-fact=return]").wait_for()
        page.get_by_text("battery").wait_for()


def test_robot_at_rest_is_drawn_with_all_pixels(browser: object, played: Played) -> None:
    """A processor that draws slowly draws fewer pixels while the robot moves."""
    with tab(browser, played.page.url, 1600, 1000, is_sharp=True) as page:
        until(lambda: played.steps > 2, "it plays")
        missing_px = (
            "(scene => scene.clientWidth * Math.min(devicePixelRatio, 2) - "
            "scene.width)(document.querySelector('#scene'))"
        )
        end_s = time.monotonic() + 3.0  # on a fast computer nothing is missing
        while abs(page.evaluate(missing_px)) < 1 and time.monotonic() < end_s:
            page.wait_for_timeout(50)
        button(page, "Pause").click()
        state_is(page, "paused")
        until(lambda: abs(page.evaluate(missing_px)) < 1, "it is drawn with all pixels")


def test_space_bar_stops_with_any_focus(browser: object, played: Played) -> None:
    with tab(browser, played.page.url) as page:
        until(lambda: played.steps > 1, "it plays")
        button(page, "Resume" if played.page._paused else "Pause").focus()
        page.keyboard.press("Space")
        state_is(page, "STOPPED")
        assert not played.page._paused, "the button that had the focus was not pressed"
        until(lambda: not played.is_driven, "motors are at rest")


def test_two_tabs_and_reload_during_run(browser: object, played: Played) -> None:
    with tab(browser, played.page.url) as first, tab(browser, played.page.url) as second:
        for page in (first, second):
            page.wait_for_selector("#scene[data-frames]")
        button(first, "Pause").click()
        state_is(second, "paused")
        button(second, "Resume").click()
        state_is(first, "running")
        until(lambda: played.steps > 5, "it plays")
        first.reload()
        first.wait_for_selector("#scene[data-frames]")
        shown = first.locator("figure[data-series='reward/0']")
        shown.wait_for()
        first.wait_for_function(
            "document.querySelector(\"figure[data-series='reward/0']\").dataset.count >= 5"
        )
        state_is(first, "running")
    count = played.steps
    until(lambda: played.steps > count + 2, "closing all tabs changes nothing")


def pull_forward(page: object) -> None:
    """Pull the stick over its rim."""
    stick = page.locator("#stick")
    stick.hover()
    page.mouse.down()
    box = stick.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] - 10)


def test_human_drives_then_rests(browser: object) -> None:
    with playing("Spinning-v0", by_hand=True) as played, tab(browser, played.page.url) as page:
        page.wait_for_selector("#scene[data-frames]")
        slider = page.get_by_role("slider").first
        slider.focus()
        for _ in range(8):
            page.keyboard.press("ArrowRight")
        until(lambda: played.page.driver.pushes[0] > 0.35, "the slider is heard")
        pull_forward(page)
        until(lambda: min(played.page.driver.pushes) > 0.8, "forward")
        start_m = played.env.twin.body.data.qpos[0].item()
        until(
            lambda: abs(played.env.twin.body.data.qpos[0].item() - start_m) > 0.02,
            "the robot drives",
        )
        page.mouse.up()
        until(lambda: played.page.driver.pushes == [0.0, 0.0], "let go")
        pull_forward(page)
        until(lambda: min(played.page.driver.pushes) > 0.8, "forward")
        page.close()
        until(
            lambda: played.page.driver.pushes == [0.0, 0.0],
            "a driver whose tab is gone pushes nothing",
        )


def test_page_that_slept_does_not_drive_on(browser: object) -> None:
    with playing("Spinning-v0", by_hand=True) as played, tab(browser, played.page.url) as page:
        slider = page.get_by_role("slider").first
        slider.focus()
        for _ in range(8):
            page.keyboard.press("ArrowRight")
        until(lambda: played.page.driver.pushes[0] > 0.35, "the slider is heard")
        sleep(page, 3.0)
        time.sleep(1.0)
        assert played.page.driver.pushes == [0.0, 0.0]
        until(lambda: slider.input_value() == "0", "the slider shows it")
        page.keyboard.press("ArrowRight")
        until(lambda: played.page.driver.pushes[0] > 0.0, "who is there again drives again")


def test_page_on_phone(browser: object, played: Played) -> None:
    with tab(browser, played.page.url, 390, 844) as page:
        page.wait_for_selector("#scene[data-frames]")
        stop, view = (page.locator(name).bounding_box() for name in ("#stop", "#view"))
        assert (
            stop["width"] > 340 and stop["y"] < 130 and view["width"] > 360 and view["height"] > 250
        )
        page.wait_for_selector("#facts span")
        facts = page.locator("#facts").bounding_box()
        assert facts["y"] > view["y"] + view["height"] / 2, "below the robot"
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, (
            "nothing lies beside the screen"
        )
        page.evaluate("scrollTo(0, 3000)")
        assert page.locator("#stop").bounding_box()["y"] < 130, "the stop button stays"
        button(page, "EMERGENCY STOP").click()
        state_is(page, "STOPPED")


def test_foreign_page_cannot_press_buttons(browser: object, played: Played) -> None:
    """Even with port and token in an address, neither scripts nor frames get access."""
    port = played.page.url.split(":")[2].split("/")[0]
    asks = f"""<script>
    window.done = [];
    for (const host of ["127.0.0.1:{port}", "localhost:{port}"]) {{
      const socket = new WebSocket(`ws://${{host}}/ws?{played.page.url.split("?")[1]}`);
      socket.onopen = () => {{ socket.send('{{"press": "stop"}}'); window.done.push("in"); }};
      socket.onerror = () => window.done.push("out");
    }}
    </script>"""

    class Foreign(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(asks.encode())

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Foreign) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        page = browser.new_page()
        page.goto(played.page.url)  # the browser has the cookie
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        page.wait_for_function("window.done.length === 2")
        assert page.evaluate("window.done") == ["out", "out"]
        page.close()
        server.shutdown()
        thread.join()
    assert not played.page.is_stopped


def test_access_without_token_is_denied(played: Played) -> None:
    base = played.page.url.partition("?")[0]
    requests = [
        urllib.request.Request(base),
        urllib.request.Request(f"{base}drawing.json"),
        urllib.request.Request(f"{base}page.js"),
    ]
    requests.append(urllib.request.Request(f"{base}?token=wrong"))
    requests.append(urllib.request.Request(played.page.url, headers={"Host": "evil.example"}))
    requests.append(
        urllib.request.Request(played.page.url, headers={"Origin": "http://evil.example"})
    )
    for request in requests:
        with pytest.raises(urllib.error.HTTPError, match="403") as caught:
            urllib.request.urlopen(request)
        assert b"the terminal shows" in caught.value.read()
        caught.value.close()
    with urllib.request.urlopen(played.page.url) as answer:
        assert (
            answer.status == 200
            and "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
        )
    for name in ("../server.py", "%2e%2e/server.py", "nothing.js"):
        with pytest.raises(urllib.error.HTTPError, match="404") as caught:
            urllib.request.urlopen(f"{base}{name}?{played.page.url.partition('?')[2]}")
        caught.value.close()


def test_memory_does_not_grow(browser: object, played: Played) -> None:
    """`benchmarks/page_memory.py` takes ten minutes."""
    with tab(browser, played.page.url) as page:
        page.wait_for_selector("#scene[data-frames]")
        button(page, "max").click()
        until(lambda: played.steps > 410, "it plays")
        series = played.page.board.series
        assert len(series["reward"].rows) == 400 == len(series["channels"].rows)
        assert page.evaluate("document.querySelectorAll('*').length") < 250


def test_goal_scores_and_curve_are_beside_the_robot(browser: object, played: Played) -> None:
    with tab(browser, played.page.url, 1280, 800) as page:
        page.wait_for_selector("#scene[data-frames]")
        assert page.locator("#goal p").inner_text() == played.env.task.summary
        for name in ("random", "by hand", "paper's SAC"):
            page.locator(f'#goal dt:text-is("{name}")').wait_for()
        curve, view = (
            page.locator(name).bounding_box()
            for name in ("figure[data-series='return/0']", "#view")
        )
        assert curve["y"] + curve["height"] <= 800 and curve["y"] >= view["y"] + view["height"]


def test_robot_is_on_the_screen_of_a_phone_held_across(browser: object, played: Played) -> None:
    with tab(browser, played.page.url, 740, 360) as page:
        page.wait_for_selector("#scene[data-frames]")
        view, stop = (page.locator(name).bounding_box() for name in ("#view", "#stop"))
        assert view["height"] > 200 and view["y"] + view["height"] <= 360 and stop["y"] < 60
        page.evaluate("scrollTo(0, 3000)")
        assert page.locator("#view").bounding_box()["y"] >= 0, (
            "it stays while one scrolls to the sliders"
        )
        assert page.evaluate("document.documentElement.scrollWidth") <= 740


HIDE_WHAT_LIES_OVER_THE_SCENE = (
    "for (const over of document.querySelectorAll('#view > :not(#scene)')) "
    "over.style.visibility = 'hidden'"
)


@pytest.mark.parametrize(("width", "height"), [(844, 390), (667, 375)])
def test_phone_held_across_shows_card_stop_button_and_floor(
    browser: object, width: int, height: int
) -> None:
    """All at once, without a finger that scrolls."""
    with (
        playing("LineFollow-v0") as played,
        tab(browser, played.page.url, width, height, is_sharp=True) as page,
    ):
        page.wait_for_selector("#scene[data-frames]")
        until(lambda: played.steps > 1, "it plays")
        button(page, "Pause").click()
        state_is(page, "paused")
        at_rest(played)
        assert page.locator("#goal p").inner_text() == played.env.task.summary
        for name in ("#goal", "#stop", "#scene", "#state"):
            box = page.locator(name).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= width, name
            assert box["y"] >= 0 and box["y"] + box["height"] <= height, name
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        body = played.env.twin.body
        x_m, y_m, _ = body.data.xpos[body.chassis].tolist()
        view = View((x_m, y_m, 0.05))
        page.evaluate(HIDE_WHAT_LIES_OVER_THE_SCENE)
        marks = played.env.task.scene.marks
        until(lambda: are_seen(page, marks, view, 5), "what lies on the floor is seen")
        button(page, "EMERGENCY STOP").click()
        state_is(page, "STOPPED")


def test_no_floor_is_drawn_before_the_robot(browser: object, played: Played) -> None:
    """Poses may come first: a scene has megabytes."""
    context = browser.new_context()
    page = context.new_page()
    held = []

    def hold(route: object) -> None:
        held.append(route)

    page.route("**/drawing.json*", hold)
    page.goto(played.page.url)
    page.wait_for_selector("#facts span")
    page.wait_for_timeout(1_500)  # poses come with the facts
    assert page.locator("#scene").get_attribute("data-frames") is None
    held[0].continue_()
    page.wait_for_selector("#scene[data-frames]")
    context.close()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844), (844, 390)])
def test_robot_is_pulled_as_long_as_it_is_held(browser: object, width: int, height: int) -> None:
    """The same robot with the same seed stays where it is without."""
    with (
        playing("Spinning-v0", by_hand=True) as played,
        tab(browser, played.page.url, width, height) as page,
    ):
        page.wait_for_selector("#scene[data-frames]")
        box = page.locator("#scene").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 60, y + 10, steps=4)
        page.locator("#pull").wait_for()

        def place_m(env: object) -> object:
            return env.twin.body.data.qpos[:2].copy()

        steps = played.steps
        until(lambda: played.steps > steps + 10, "it is pulled")
        assert page.locator("#hint").is_hidden(), "who knows it is not told again"
        page.mouse.up()
        until(lambda: not played.env.twin.body.data.xfrc_applied.any(), "let go")
        count, there = played.steps, place_m(played.env)
        with closing(bricksrl.make("Spinning-v0", seed=0)) as alone:
            list(
                itertools.islice(
                    play(alone, resting_player(alone).act, alone.reset()), min(count, 50)
                )
            )
            assert np.linalg.norm(place_m(alone)) < 0.002 < 0.04 < np.linalg.norm(there)
        page.mouse.move(box["x"] + 12, box["y"] + box["height"] - 12)
        page.mouse.down()
        page.mouse.move(box["x"] + 80, box["y"] + box["height"] - 12)
        assert page.locator("#pull").is_hidden(), "beside the robot, the view turns"
        page.mouse.up()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844), (844, 390)])
def test_wall_is_pulled_against_the_robot(browser: object, width: int, height: int) -> None:
    """The same robot with the same seed stays where it is without."""
    with (
        playing("RunAway-v0", by_hand=True) as played,
        tab(browser, played.page.url, width, height) as page,
    ):
        page.wait_for_selector("#scene[data-frames]")
        until(lambda: played.steps > 0, "the episode has begun")
        data = played.env.twin.body.data
        wall_m, start_m = data.mocap_pos[0].copy(), data.qpos[:2].copy()
        box = page.locator("#scene").bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.wheel(0, 600)  # farther away, so that more of the wall is seen
        number = [body.name for body in played.page.view._current.drawing.bodies].index("wall")
        for y in np.arange(0.15, 0.95, 0.04):
            page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + y * box["height"])
            page.mouse.down()
            page.wait_for_timeout(150)
            if (played.page.view.hand._pull or [-1])[0] == number:
                break
            page.mouse.up()
        page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + y * box["height"], steps=4)
        until(lambda: np.linalg.norm(data.mocap_pos[0] - wall_m) > 0.3, "the wall comes")
        until(lambda: np.linalg.norm(data.qpos[:2] - start_m) > 0.05, "it pushes the robot")
        page.mouse.up()
        count, there_m = played.steps, data.qpos[:2].copy()
        with closing(bricksrl.make("RunAway-v0", seed=0)) as alone:
            list(
                itertools.islice(
                    play(alone, resting_player(alone).act, alone.reset()), min(count, 20)
                )
            )
            rests_m = alone.twin.body.data.qpos[:2]
            assert (
                np.linalg.norm(rests_m - start_m) < 0.005 < 0.04 < np.linalg.norm(there_m - rests_m)
            )


def test_program_prints_on_its_page_which_stays(browser: object) -> None:
    with ProgramPage("main.py") as program, tab(browser, program.url) as page:
        program.tell("hello\n")
        program.tell("world\n")
        page.locator("#console:has-text('hello')").wait_for()
        staying = threading.Thread(target=program.stay, args=(0.0,))
        staying.start()
        state_is(page, "finished")
        page.locator("#message.note:has-text('has ended')").wait_for()
        assert (
            page.locator("#console").inner_text() == "hello\nworld\n"
            and page.locator("#stop").is_hidden()
        )
        page.wait_for_timeout(1_000)
        assert staying.is_alive(), "as long as somebody looks"
        page.goto("about:blank")
        staying.join(30)
        assert not staying.is_alive()


def test_arrow_keys_and_gamepad_drive(browser: object) -> None:
    with playing("Spinning-v0", by_hand=True) as played, tab(browser, played.page.url) as page:
        page.wait_for_selector("#scene[data-frames]")
        page.keyboard.down("ArrowUp")
        until(lambda: min(played.page.driver.pushes) > 0.8, "forward")
        page.keyboard.up("ArrowUp")
        until(lambda: played.page.driver.pushes == [0.0, 0.0], "let go")
        page.keyboard.down("ArrowLeft")
        until(
            lambda: played.page.driver.pushes[0] < -0.8 < 0.8 < played.page.driver.pushes[1], "left"
        )
        page.keyboard.up("ArrowLeft")
        until(lambda: played.page.driver.pushes == [0.0, 0.0], "let go")
        page.evaluate("navigator.getGamepads = () => [null, { axes: [0.05, -1, 0, 0] }]")
        until(lambda: min(played.page.driver.pushes) > 0.8, "the gamepad: forward")
        page.evaluate("navigator.getGamepads = () => [null, { axes: [0.05, 0, 0, 0] }]")
        until(lambda: played.page.driver.pushes == [0.0, 0.0], "let go")


def test_good_news_is_not_red(browser: object, played: Played) -> None:
    with tab(browser, played.page.url) as page:
        until(lambda: played.steps > 0, "it plays")
        played.page.finish("Done. It has learned.")
        page.locator("#message.note:has-text('Done.')").wait_for()


MAT = (
    Field((600, 0), (2360, 1140), "white"),
    Field((250, 50), (400, 400), "red"),
    Field((250, 50), (260, 260), "white"),
    Field((250, 50), (120, 120), "blue", round=True),
    *(Field((-200 + 30 * i, -250), (20, 100), ("green", "black")[i % 2]) for i in range(14)),
    Line(((0, 0), (900, -100), (900, 400)), color="black"),
)


def hits(pixels: np.ndarray, marks: Sequence[Mark], view: View) -> tuple[int, int]:
    """How many pixels of a picture show the mark that lies uppermost there, and how many are to.
    Around the robot none are."""
    height, width, _ = pixels.shape
    yaw, pitch = np.radians((view.yaw_deg, view.pitch_deg))
    back = np.array((np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)))
    right = np.array((-np.sin(yaw), np.cos(yaw), 0.0))
    focal = 1 / np.tan(0.65 / 2) * min(1.0, 0.9 * width / height)
    rows, columns = np.mgrid[4 : height - 60 : 3, 4 : width - 4 : 3].reshape(2, -1)
    across, up = (
        (2 * columns + 1 - width) / height / focal,
        (height - 2 * rows - 1) / height / focal,
    )
    rays = across[:, None] * right + up[:, None] * np.cross(back, right) - back
    target = np.array(view.target)
    eye = target + view.distance_m * back
    with np.errstate(divide="ignore"):
        floor_mm = 1000 * (eye + rays * (-eye[2] / rays[:, 2:]))[:, :2]
    is_ahead = (rays[:, 2] < -0.05) & (np.linalg.norm(floor_mm - 1000 * target[:2], axis=1) > 250)
    uppermost = np.full(len(rows), -1)
    for number, mark in enumerate(marks):
        around = [
            [mark.beyond_mm(x, y) <= 0.0 for x, y in (floor_mm + shift).tolist()]
            for shift in ((0, 0), (6, 0), (-6, 0), (0, 6), (0, -6))
        ]
        uppermost[np.logical_or.reduce(around)] = -1  # an edge
        uppermost[np.logical_and.reduce(around)] = number
    expected = is_ahead & (uppermost >= 0)
    colours = np.array([COLORS[mark.color] for mark in marks] + [(0.86, 0.87, 0.885)])
    seen = pixels[rows, columns, None] / 255
    lit = np.minimum(
        1.0, colours * np.where(np.arange(len(colours)) < len(marks), 1.2, 1.0)[:, None]
    )
    nearest = np.abs(seen - lit).sum(-1).argmin(1)
    is_right = np.abs(lit[nearest] - lit[uppermost]).sum(-1) < 0.05
    return int((is_right & expected).sum()), int(expected.sum())


def are_seen(page: object, marks: Sequence[Mark], view: View, least: int) -> bool:
    """Whether the page shows marks where they lie, at more than so many points; a picture may be
    of a moment before."""
    picture = Image.open(io.BytesIO(page.locator("#scene").screenshot())).convert("RGB")
    right, count = hits(np.asarray(picture, float), marks, view)
    return count > least and right > 0.9 * count


@pytest.mark.parametrize("name", ["LineFollow-v0", "mat"])
def test_what_lies_on_the_floor_is_seen_wherever_the_robot_is(browser: object, name: str) -> None:
    task = get_task("LineFollow-v0")
    marks = MAT if name == "mat" else task.scene.marks
    mirror, board = Mirror(make_body(task.robot, scene=Scene(objects=marks))), Board()
    qpos = mirror.body.data.qpos.copy()
    qpos[:2] = 0.217, -0.331
    with (
        PageServer(board, lambda *_: None, on_stop=lambda: None) as server,
        tab(browser, server.url, is_sharp=True) as page,
    ):
        page.evaluate(HIDE_WHAT_LIES_OVER_THE_SCENE)
        for number, (width, height) in enumerate([(1366, 768), (390, 844), (844, 390)]):
            page.set_viewport_size({"width": width, "height": height})
            view = View((0.217, -0.331, 0.05), 0.75, -55.0 + 40 * number, 25.0)
            board.show_drawing(replace(mirror.drawing, view=view), mirror.poses(qpos))
            seen = partial(are_seen, page, marks, view, 100)
            until(seen, f"what lies on the floor is seen in a window of {width} x {height}")
