"""The site as plain files: a robot at once, links, programs that are kept, without a network."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from in_page import ENDED, open_program, run_program

if TYPE_CHECKING:
    from playwright.sync_api import Page

DRIVE = (
    "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Direction, Port\n"
    "from pybricks.robotics import DriveBase\n"
    "left, right = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A)\n"
    "DriveBase(left, right, 56, 130).straight({mm})\nprint(round(left.angle()))\n"
)


def test_page_and_worker_share_memory_on_a_plain_file_server(page: Page) -> None:
    assert page.evaluate("crossOriginIsolated")


def test_a_robot_drives_and_is_drawn(page: Page) -> None:
    page.select_option("#robot", "two-wheeler")
    page.select_option("#world", "open floor")
    _, shown, state = run_program(page, DRIVE.format(mm=200))
    assert state == "finished"
    # 200 mm on wheels of 56 mm are 409 degrees.
    assert abs(int(shown) - 409) <= 3
    assert page.evaluate("Number(document.querySelector('#scene').dataset.frames)") >= 2
    page.select_option("#robot", "bench")


def test_a_run_is_looked_at_again(page: Page) -> None:
    run_program(page, "from pybricks.tools import wait\nwait(2000)\nprint('end')\n")
    assert page.input_value("#scrub") == page.get_attribute("#scrub", "max") == "2000"
    page.evaluate(
        """() => {
            const scrub = document.querySelector("#scrub");
            scrub.value = 500;
            scrub.dispatchEvent(new Event("input"));
        }"""
    )
    page.wait_for_selector("#clock:text('0.5 s')")


def test_a_link_holds_the_program(page: Page) -> None:
    """Which is looked at before it runs."""
    name = open_program(page, "print('from a friend: ä')\n", "friend.py")
    page.locator("#more summary").click()
    page.get_by_role("button", name="Copy a link to it").click()
    page.wait_for_selector("#note:not([hidden])")
    link = page.evaluate(
        """async () => {
            const { linkOf, programOf } = await import("./programs.js");
            const { files, current } = JSON.parse(localStorage["bricks-programs"]);
            const link = await linkOf({ name: current, source: files[current] });
            return [link.split("#")[0], await programOf(new URL(link).hash)];
        }"""
    )
    assert link == [page.url, {"name": name, "source": "print('from a friend: ä')\n"}]


def test_programs_are_kept_and_the_site_works_without_a_network(page: Page) -> None:
    source = "print('kept')\n"
    name = open_program(page, source, "kept.py")
    listed = page.evaluate("fetch('files.json').then((answer) => answer.json())")["files"]
    # The page fetches the rest of the site when it is at work.
    page.evaluate(
        """async (names) => {
            const kept = async (name) => Boolean(await caches.match(new URL(name, location).href));
            for (const name of names) {
                while (!(await kept(name))) await new Promise((done) => setTimeout(done, 100));
            }
        }""",
        [file for file in listed if not file.endswith(".py")],
    )
    page.context.set_offline(True)
    try:
        page.reload()
        page.wait_for_selector("#state.ready")
        assert page.input_value("#programs") == name
        page.select_option("#rate", "fast")
        page.click("#run")
        page.wait_for_selector(ENDED)
        assert page.text_content("#console") == "kept\n"
    finally:
        page.context.set_offline(False)


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_screen(page: Page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_each_control_has_a_name(page: Page) -> None:
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input, textarea, summary")]
            .filter((element) => element.offsetParent !== null)
            .filter((element) => !(element.ariaLabel || element.textContent.trim()
                || element.labels?.length || element.title))
            .map((element) => element.outerHTML)"""
    )
    assert nameless == []
