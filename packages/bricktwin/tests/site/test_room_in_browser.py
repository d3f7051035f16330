"""Several hubs in one room, in a browser: what they print is what a terminal shows of them."""

from __future__ import annotations

import io
import random
import re
import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import any_browser
import numpy as np
import pytest
from browser import TIMEOUT_MS
from in_page import ENDED, open_program
from radio_programs import random_program
from test_room_in_tab import DRIVER, FOLLOWER, LISTENER, SENDER

from brickhub.virtual.room import HubProgramFile, Room
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.scene import OPEN_FLOOR
from bricktwin.view.around import view_around
from bricktwin.view.body_drawing import drawing_of
from bricktwin.worlds import world as world_of

if TYPE_CHECKING:
    from conftest import Site
    from playwright.sync_api import Browser, Page

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


PUT_TOGETHER = """async ([robots, world]) => {
    const [{ together }, { fetchPacked }] = await Promise.all([import("./together.js"), import("./packed.js")]);
    const read = async (name) => (await fetchPacked(`robots/together/${name}.json`)).json();
    const parts = { robots: await Promise.all(robots.map(read)), world: await read(world) };
    const { drawing, start } = together(parts);
    const bodies = drawing.bodies.map((body, i) => ({ ...body, pose: start.slice(7 * i, 7 * i + 7) }));
    return { ...drawing, meshes: drawing.meshes.length, bodies };
}"""  # noqa: E501


def test_robots_are_drawn_where_they_stand_on_a_computer(room: Page) -> None:
    """Each body by its number in the model, at its place, in its colours."""
    drawn = room.evaluate(PUT_TOGETHER, [["two-wheeler", "scout"], "world-table"])
    world = ArenaWorld(side_by_side((TWO_WHEELER, SCOUT), world_of("table")))
    world.place(np.random.default_rng(0))
    world.bodies[0].update_visuals()
    expected = drawing_of(world.bodies[0]).described()
    data = world.bodies[0].data
    assert drawn["spinners"] == expected["spinners"] and drawn["rods"] == expected["rods"]
    numbers = [body["model_body"] for body in drawn["bodies"] if body["model_body"]]
    assert numbers == [body["model_body"] for body in expected["bodies"] if body["model_body"]]
    colours = {body["model_body"]: body["shapes"] for body in expected["bodies"]}
    for body in drawn["bodies"]:
        number = body["model_body"]
        x, y, z, *turn = body["pose"]
        assert [x, y, z] == pytest.approx(data.xpos[number].tolist(), abs=1e-3), body["name"]
        assert abs(float(np.dot(turn, data.xquat[number]))) == pytest.approx(1.0, abs=1e-4)
        if number:
            shapes = [shape["colour"] for shape in colours[number]]
            for shape, colour in zip(body["shapes"], shapes, strict=True):
                assert shape["colour"] == pytest.approx(colour, abs=1e-6)
    view = asdict(view_around([body.pose() for body in world.bodies]))
    assert drawn["view"].pop("target") == pytest.approx(view.pop("target"))
    assert drawn["view"] == pytest.approx(view)


def numbers_agree(shown: str, expected: str, most: int) -> None:
    """Two outputs are the same but for numbers, as MuJoCo is of another version in a tab."""
    number = re.compile(r"-?\d+")
    assert number.sub("", shown) == number.sub("", expected)
    found = [int(angle) for angle in number.findall(shown)]
    assert found == pytest.approx([int(angle) for angle in number.findall(expected)], abs=most)


def mark_of(line: str) -> str:
    """Name of the program that has printed a line."""
    return line.partition(": ")[0]


def test_robots_share_a_world(room: Page, tmp_path: Path) -> None:
    programs = open_on_hubs(room, DRIVER, FOLLOWER)
    room.select_option("#robot", "scout")
    room.locator("#hubs [role=tab]").first.click()
    # The other hub has got the same robot.
    assert room.input_value("#robot") == "scout"
    room.select_option("#robot", "two-wheeler")
    for name in ("open floor", "table"):
        room.select_option("#world", name)
        scene = OPEN_FLOOR if name == "open floor" else world_of(name)
        world = ArenaWorld(side_by_side((TWO_WHEELER, SCOUT), scene))
        world.place(np.random.default_rng(0))
        shown, state = run_room(room)
        assert state == "finished"
        expected, _ = printed(tmp_path, programs, world)
        numbers_agree(shown, expected, most=2)
    assert room.evaluate("Number(document.querySelector('#scene').dataset.frames)") >= 2


def test_three_robots_share_a_world_and_what_cannot_be_is_said(room: Page, tmp_path: Path) -> None:
    """The world and the robots of the test before are there still."""
    room.click("#add-hub")
    tabs = room.locator("#hubs [role=tab]")
    assert tabs.count() == 3
    # The new hub has the robot of the first one, in the same world.
    assert [room.input_value(name) for name in ("#robot", "#world")] == ["two-wheeler", "table"]
    offered = room.locator("#world option").all_text_contents()
    assert "wall" not in offered and "table" in offered
    third = open_program(room, FOLLOWER, "third.py")
    names = [text.split(": ")[1] for text in tabs.all_text_contents()]
    assert names[2] == third
    programs = dict(zip(names, (DRIVER, FOLLOWER, FOLLOWER), strict=True))
    robots = (TWO_WHEELER, SCOUT, TWO_WHEELER)
    world = ArenaWorld(side_by_side(robots, world_of("table")))
    world.place(np.random.default_rng(0))
    terminal, _ = printed(tmp_path, programs, world)
    shown, state = run_room(room)
    assert state == "finished"
    # What two robots print in the same control loop comes in another order in a terminal.
    by_hub = [sorted(out.splitlines(), key=mark_of) for out in (shown, terminal)]
    numbers_agree("\n".join(by_hub[0]), "\n".join(by_hub[1]), most=2)
    # One on a bench is three on benches.
    room.select_option("#robot", "bench")
    tabs.first.click()
    assert room.input_value("#robot") == "bench"
    tabs.nth(2).click()
    room.click("#remove-hub")
    assert tabs.count() == 2


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


@pytest.mark.slow
def test_an_address_of_an_example_for_two_hubs_opens_both(address: str, browser: Browser) -> None:
    """And runs them, at the first visit."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.goto(f"{address}#example=hear.py")
    page.select_option("#rate", "fast")
    tabs = page.locator("#hubs [role=tab]")
    tabs.nth(1).wait_for()
    assert tabs.all_text_contents() == ["Hub 1: hear.py", "Hub 2: tell.py"]
    page.wait_for_selector(ENDED)
    heard = [line.split(" at ")[0] for line in (page.text_content("#console") or "").splitlines()]
    assert heard == [f"hear: number {number}" for number in range(4)]
    assert page.text_content("#state") == "finished"
    context.close()


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("browser_name", any_browser.NAMES)
def test_two_hubs_hear_each_other_in_each_browser(
    site: Site, browser_name: str, tmp_path: Path
) -> None:
    """Two robots in one world, in real time."""
    shutil.copy(Path(__file__).with_name("run_room.js"), site.folder)
    page = (site.folder / "index.html").read_text(encoding="utf-8")
    script = '<script type="module" src="run_room.js"></script>\n</head>'
    with_script = page.replace("</head>", script)
    (site.folder / "run_room.html").write_text(with_script, encoding="utf-8")
    while not site.told.empty():
        site.told.get()
    address = f"{site.address}run_room.html#example=hear.py"
    with any_browser.opened(browser_name, address, tmp_path / "profile"):
        told = site.told.get(timeout=500)
    assert "failed" not in told, told["failed"]
    assert (told["isIsolated"], told["state"]) == (True, "finished"), told
    if not told["hasMemory"]:
        # WebKitGTK shares none; Safari does, which cannot be tried here.
        assert browser_name == "webkit"
        assert told["opened"] == []
        assert "no way into a running program" in told["note"]
        return
    assert told["opened"] == ["Hub 1: hear.py", "Hub 2: tell.py"]
    assert told["shown"] == ["hear.py", "tell.py"]
    heard = [line.split(" at ")[0] for line in told["printed"].splitlines()]
    assert heard == [f"hear: number {number}" for number in range(4)]
    assert told["robot"] == "two-wheeler"
    # Firefox has no WebGL on a computer without a screen.
    assert told["isDrawn"] or browser_name == "firefox"
