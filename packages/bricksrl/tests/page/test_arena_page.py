"""Several robots on the page, driven by several visitors."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest
from browser import chromium, tab

from bricksrl.envs.arenas import get_arena_task, make_arena
from bricksrl.errors import StoppedError
from bricksrl.page.arena import ArenaPage, play_arena
from bricksrl.training.teams.groups import team_policy

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as started:
        yield started


def until(condition: Callable[[], bool], what: str) -> None:
    start_s = time.monotonic()
    while not condition():
        assert time.monotonic() - start_s < 60, what
        time.sleep(0.02)


@pytest.mark.slow
def test_two_visitors_drive_a_robot_each(browser: object) -> None:
    """A phone drives the runner, another browser the catcher; each moves its own robot alone."""
    task = dataclasses.replace(get_arena_task("Tag-v0"), max_steps=100_000)
    stop, errors = threading.Event(), list[BaseException]()
    with closing(make_arena(task, seed=3)) as env, ArenaPage(task) as page:
        policy = team_policy(env, {}, {"catcher": "chase", "runner": "flee"})

        def play() -> None:
            try:
                play_arena(env, page, policy, stop=stop)
            except StoppedError:
                pass
            except BaseException as error:  # noqa: BLE001  the test looks at it
                errors.append(error)

        def places_m() -> np.ndarray:
            return np.array([(pose.x_m, pose.y_m) for pose in env.world.poses()])

        def moved_m(since: np.ndarray) -> np.ndarray:
            return np.linalg.norm(places_m() - since, axis=1)

        def rest() -> np.ndarray:
            for _ in range(60):
                before = places_m()
                time.sleep(0.7)
                if moved_m(before).max() < 1e-3:
                    return places_m()
            raise AssertionError("they do not rest")

        thread = threading.Thread(target=play, daemon=True)
        thread.start()
        with tab(browser, page.url, 390, 844) as phone, tab(browser, page.url, 1280, 800) as other:
            for visitor, robot in ((phone, "runner"), (other, "catcher")):
                visitor.wait_for_selector("#scene[data-frames]")
                visitor.get_by_role("button", name=f"Drive the {robot}", exact=True).click()
                until(lambda robot=robot: page.drivers[robot].in_charge, "one drives")
            until(lambda: page._steps > 2, "they play")
            assert phone.evaluate("document.documentElement.scrollWidth") <= 390
            before = rest()
            phone.locator("#stick").scroll_into_view_if_needed()
            box = phone.locator("#stick").bounding_box()
            phone.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            phone.mouse.down()
            phone.mouse.move(box["x"] + box["width"] / 2, box["y"] + 5)
            until(lambda: moved_m(before)[1] > 0.03, "the phone drives the runner")
            phone.mouse.up()
            assert moved_m(before)[0] < 0.005, "and no other"
            before = rest()
            other.keyboard.down("ArrowUp")
            until(lambda: moved_m(before)[0] > 0.03, "the other one drives the catcher")
            other.keyboard.up("ArrowUp")
            phone.get_by_role("button", name="Drive the runner", exact=True).click()
            until(lambda: not page.drivers["runner"].in_charge, "the runner is given back")
            before = places_m()
            until(lambda: moved_m(before)[1] > 0.03, "and flees by itself")
            phone.get_by_role("button", name="EMERGENCY STOP").click()
            phone.locator("#state:text-is('STOPPED')").wait_for()
            rest()
        stop.set()
        page._press("reset", None)
        thread.join(60)
        assert not thread.is_alive() and not errors


def test_all_of_an_arena_is_seen_with_buttons_of_one_height(browser: object) -> None:
    task = get_arena_task("Tag-v0")
    half_x_m, half_y_m = task.arena.half_size_m
    with closing(make_arena(task, seed=3)) as env, ArenaPage(task) as page:
        page.attach(env)
        with tab(browser, page.url) as visitor:
            visitor.wait_for_selector("#scene[data-frames]")
            for width, height in ((390, 844), (844, 390), (1366, 768)):
                visitor.set_viewport_size({"width": width, "height": height})
                box = visitor.locator("#scene").bounding_box()
                view = page.view._current.drawing.view
                ratio = box["width"] / box["height"]
                pitch = np.radians(view.pitch_deg)
                focal = 1 / np.tan(0.65 / 2) * min(1.0, ratio / view.ratio)
                # The near corners, which are farthest outside in the picture.
                depth_m = view.distance_m - half_y_m * np.cos(pitch)
                assert half_x_m / depth_m * focal < ratio
                heights = [
                    visitor.get_by_role("button", name=f"Drive the {robot}").bounding_box()[
                        "height"
                    ]
                    for robot in ("catcher", "runner")
                ]
                assert heights[0] == pytest.approx(heights[1])


def test_return_that_is_shown_is_that_of_the_catcher_in_the_frames(
    browser: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = dataclasses.replace(get_arena_task("Tag-v0"), max_steps=12)
    rewards: list[float] = []
    with closing(make_arena(task, seed=3)) as env, ArenaPage(task) as page:
        step = env.step

        def recorded(state: object) -> object:
            frame = step(state)
            rewards.append(frame["next", "catcher", "reward"].sum().item())
            return frame

        monkeypatch.setattr(env, "step", recorded)
        policy = team_policy(env, {}, {"catcher": "chase", "runner": "flee"})
        stop = threading.Event()
        with tab(browser, page.url, 1280, 800) as visitor:
            visitor.wait_for_selector("#state")
            (returned,) = play_arena(env, page, policy, episodes=1, stop=stop)
            total = sum(rewards)
            assert len(rewards) > 5 and total != 0.0
            assert returned == pytest.approx(total)
            assert [list(row) for row in page.board.series["return"].rows] == [
                [pytest.approx(total)]
            ]
            visitor.locator("[data-fact='return of']:has-text('catcher')").wait_for()
            chart = "figure[data-series='return/0']"
            visitor.locator(f"{chart}[data-count='1']").wait_for()
            shown = float(visitor.locator(f"{chart} output").inner_text())
            assert shown == pytest.approx(total, rel=0.01)
