"""Several hubs in one room, in a browser: what they print is what a terminal shows of them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from in_page import ENDED, open_program
from test_room_in_tab import DRIVER, FOLLOWER, LISTENER, SENDER

from brickhub.virtual.room import HubProgramFile, Room
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.mujoco_arena import ArenaWorld

if TYPE_CHECKING:
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


def printed(folder: Path, programs: dict[str, str], world: ArenaWorld | None = None) -> str:
    """What programs print together in a terminal."""
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
    return out.getvalue().decode() + err.getvalue()


def open_room(page: Page, *sources: str) -> dict[str, str]:
    """Open programs on a hub each; returns them by the names that they have in the page."""
    programs = {open_program(page, sources[0], "left.py"): sources[0]}
    for name, source in zip(("right.py", "third.py"), sources[1:], strict=False):
        page.click("#add-hub")
        programs[open_program(page, source, name)] = source
    assert page.locator("#hubs [role=tab]").count() == len(sources)
    return programs


def run_room(page: Page, rate: str = "fast") -> tuple[str, str]:
    """Run all programs to their ends; returns the console and the state."""
    page.select_option("#rate", rate)
    # Workers of hubs that were added start meanwhile.
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.wait_for_selector(ENDED)
    return page.text_content("#console") or "", page.text_content("#state") or ""


@pytest.fixture(autouse=True)
def alone_again(page: Page) -> Iterator[None]:
    yield
    while page.is_visible("#remove-hub"):
        page.click("#remove-hub")
    page.select_option("#robot", "bench")


def test_benches_print_what_they_print_in_a_terminal(page: Page, tmp_path: Path) -> None:
    """Three hubs, one of which ends with an error, in the order of a terminal to the last
    character."""
    programs = open_room(page, SENDER, LISTENER, LISTENER.replace("900", "300"))
    shown, state = run_room(page)
    expected = printed(tmp_path, programs)
    # A terminal's streams are two; on the page an error is where it happened.
    lines = shown.splitlines()
    errors = [line for line in lines if line not in expected.split("Traceback")[0]]
    assert sorted(lines) == sorted(expected.splitlines())
    kept = [line for line in lines if "Traceback" not in line and "Error" not in line]
    kept = [line for line in kept if 'File "' not in line]
    assert kept == [line for line in expected.splitlines() if line in kept]
    assert state == "error" and errors


def test_robots_share_a_world(page: Page, tmp_path: Path) -> None:
    programs = open_room(page, DRIVER, FOLLOWER)
    page.select_option("#robot", "scout")
    page.click("#hubs [role=tab]:first-child")
    page.select_option("#robot", "two-wheeler")
    world = ArenaWorld(side_by_side((TWO_WHEELER, SCOUT)))
    world.place(np.random.default_rng(0))
    shown, state = run_room(page)
    assert state == "finished"
    assert shown == printed(tmp_path, programs, world)
    frames = page.evaluate("Number(document.querySelector('#scene').dataset.frames)")
    assert frames >= 2


def test_each_hub_has_its_panel_and_stop_stops_all(page: Page) -> None:
    open_room(page, BLINK.format(letter="L"), BLINK.format(letter="R"))
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#hub .display[aria-label='Display: R']")
    page.click("#hubs [role=tab]:first-child")
    page.wait_for_selector("#hub .display[aria-label='Display: L']")
    left = page.get_by_role("button", name="Left button")
    left.hover()
    page.mouse.down()
    page.wait_for_function("document.querySelector('#console').textContent.includes('pressed')")
    page.mouse.up()
    assert page.text_content("#console") == "left: pressed\n"
    page.click("#stop")
    page.wait_for_selector("#state.stopped")
    ends = [line.split(": ", 1)[1] for line in (page.text_content("#console") or "").splitlines()]
    assert ends == ["pressed", *["The program was stopped (SystemExit)."] * 2]


@pytest.mark.parametrize("width", [1280, 390])
def test_a_room_is_no_wider_than_the_screen(page: Page, width: int) -> None:
    open_room(page, "print(1)\n", "print(2)\n", "print(3)\n")
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.set_viewport_size({"width": 1280, "height": 800})
