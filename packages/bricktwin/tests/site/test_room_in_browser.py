"""Several hubs in one room, in a browser: what they print is what a terminal shows of them."""

from __future__ import annotations

import io
import random
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from in_page import ENDED, open_program
from radio_programs import random_program
from test_room_in_tab import DRIVER, FOLLOWER, LISTENER, SENDER

from brickhub.virtual.room import HubProgramFile, Room
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.site.storing import read_packed_json
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.mujoco_arena import ArenaWorld

if TYPE_CHECKING:
    from conftest import Site
    from playwright.sync_api import Page

BLINK = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Button
from pybricks.tools import wait
hub = PrimeHub()
hub.display.char("{letter}")
while Button.LEFT not in hub.buttons.pressed():
    wait(10)
print("pressed")
while True:
    wait(10)
"""


def printed(
    folder: Path, programs: dict[str, str], world: ArenaWorld | None = None
) -> tuple[str, str]:
    """Output and errors of programs that run together in a terminal."""
    paths = []
    for name, source in programs.items():
        (folder / name).write_text(source, encoding="utf-8")
        paths.append(folder / name)
    out, err = io.BytesIO(), io.StringIO()
    bodies = [None] * len(paths) if world is None else world.bodies
    files = [HubProgramFile(path, body) for path, body in zip(paths, bodies, strict=True)]
    room = Room(files, stdout=out, stderr=err)
    if world is not None:
        room = Room(files, stdout=out, stderr=err, distance_m=world.distance_m)
        world.runners = [partial(room.run_until, number) for number in range(len(paths))]
    room.run()
    return out.getvalue().decode(), err.getvalue()


@pytest.fixture(scope="module")
def room(page: Page) -> Page:
    """The page with two hubs in one room."""
    page.click("#add-hub")
    assert page.locator("#hubs [role=tab]").count() == 2
    return page


def open_on_hubs(page: Page, *sources: str) -> dict[str, str]:
    """Open a program on each hub; returns them by the names that they have in the page."""
    programs = {}
    for number, (name, source) in enumerate(zip(("left.py", "right.py"), sources, strict=True)):
        page.locator("#hubs [role=tab]").nth(number).click()
        programs[open_program(page, source, name)] = source
    return programs


def run_room(page: Page, rate: str = "fast") -> tuple[str, str]:
    """Run all programs to their ends; returns the console and the state."""
    page.select_option("#rate", rate)
    # Workers of hubs that were added start meanwhile.
    page.click("#run")
    page.wait_for_selector(ENDED)
    return page.text_content("#console") or "", page.text_content("#state") or ""


def test_benches_print_what_they_print_in_a_terminal(room: Page, tmp_path: Path) -> None:
    """In the order of a terminal, to the last character. Errors, which a terminal has in a stream
    of their own, are where they happened."""
    programs = open_on_hubs(room, SENDER, LISTENER)
    shown, state = run_room(room)
    out, err = printed(tmp_path, programs)
    assert err in shown
    assert shown.replace(err, "") == out
    assert state == "error"
    # The second hub is shown, whose program has failed.
    assert room.text_content("#error") == "Line 12: ZeroDivisionError: divide by zero"
    room.locator("#hubs [role=tab]").first.click()
    assert room.locator(".cm-lintRange-error").count() == 0


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_random_pairs_print_what_they_print_in_a_terminal(room: Page, tmp_path: Path) -> None:
    rng = random.Random(59)
    told = 0
    for _ in range(100):
        programs = open_on_hubs(room, random_program(rng, 0), random_program(rng, 1))
        shown = run_room(room)
        assert shown == (printed(tmp_path, programs)[0], "finished")
        told += "(" in shown[0]
    assert told > 20, "some of them hear each other"


def test_robots_are_shown_where_they_start(site: Site) -> None:
    path = site.folder / "robots" / "together" / "two-wheeler_and_scout.json"
    file = read_packed_json(path)
    names = [body["name"] for body in file["drawing"]["bodies"]]
    places = []
    for name in ("robot1/chassis", "robot2/chassis"):
        first = 7 * names.index(name)
        places.append(file["start"][first : first + 2])
    assert places == [pytest.approx([0.0, 0.0], abs=1e-3), pytest.approx([0.0, 0.5], abs=1e-3)]


def test_robots_share_a_world(room: Page, tmp_path: Path) -> None:
    programs = open_on_hubs(room, DRIVER, FOLLOWER)
    room.select_option("#robot", "scout")
    room.locator("#hubs [role=tab]").first.click()
    # The other hub has got the same robot.
    assert room.input_value("#robot") == "scout"
    room.select_option("#robot", "two-wheeler")
    world = ArenaWorld(side_by_side((TWO_WHEELER, SCOUT)))
    world.place(np.random.default_rng(0))
    shown, state = run_room(room)
    assert state == "finished"
    expected, _ = printed(tmp_path, programs, world)
    number = re.compile(r"-?\d+")
    assert number.sub("", shown) == number.sub("", expected)
    # MuJoCo is of another version in a tab.
    angles_deg = [int(angle) for angle in number.findall(shown)]
    assert angles_deg == pytest.approx([int(angle) for angle in number.findall(expected)], abs=2)
    assert room.evaluate("Number(document.querySelector('#scene').dataset.frames)") >= 2
    room.select_option("#robot", "bench")


def test_each_hub_has_its_panel_and_stop_stops_all(room: Page) -> None:
    left, _ = open_on_hubs(room, BLINK.format(letter="L"), BLINK.format(letter="R"))
    room.select_option("#rate", "1")
    room.click("#run")
    room.wait_for_selector("#hub .display[aria-label='Display: R']")
    room.locator("#hubs [role=tab]").first.click()
    room.wait_for_selector("#hub .display[aria-label='Display: L']")
    room.get_by_role("button", name="Left button").hover()
    room.mouse.down()
    room.wait_for_selector("#console:has-text('pressed')")
    room.mouse.up()
    assert room.text_content("#console") == f"{left.removesuffix('.py')}: pressed\n"
    room.click("#stop")
    room.wait_for_selector("#state.stopped")
    lines = (room.text_content("#console") or "").splitlines()
    stopped = "The program was stopped (SystemExit)."
    assert sorted(line.split(": ", 1)[1] for line in lines) == [stopped, stopped, "pressed"]


@pytest.mark.parametrize("width", [1280, 390])
def test_a_room_is_no_wider_than_the_screen(room: Page, width: int) -> None:
    room.set_viewport_size({"width": width, "height": 800})
    assert room.evaluate("document.documentElement.scrollWidth") <= width
    room.set_viewport_size({"width": 1280, "height": 800})


def test_a_hub_goes_and_the_other_one_is_alone(room: Page) -> None:
    open_on_hubs(room, "print('left')\n", "print('right')\n")
    room.click("#remove-hub")
    assert room.locator("#hubs [role=tab]").count() == 0
    assert run_room(room) == ("left\n", "finished")


def test_an_example_for_two_hubs_opens_both(room: Page) -> None:
    room.select_option("#examples", label="Two hubs: one does what it hears")
    tabs = room.locator("#hubs [role=tab]")
    assert tabs.all_text_contents() == ["Hub 1: hear.py", "Hub 2: tell.py"]
    assert room.input_value("#robot") == "two-wheeler"
    shown, state = run_room(room)
    assert state == "finished"
    heard = [line.split(" at ")[0] for line in shown.splitlines()]
    assert heard == [f"hear: number {number}" for number in range(4)]
