"""A real hub from the page in Chromium: a simulated hub is its Bluetooth peripheral."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any

import pytest
from emulated_hub import EmulatedHub, connect, page_with
from hub_firmware import compiled
from in_page import ENDED

from brickhub.hub.program.compile import MAIN_MODULE, compile_mpy
from brickhub.hub.program.generate import generate_trials
from bricktwin.robots import TWO_WHEELER
from bricktwin.site.tab.hub_lessons import HUB_LESSONS
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene

if TYPE_CHECKING:
    from playwright.async_api import Page, Route

pytestmark = [pytest.mark.slow, pytest.mark.realtime, pytest.mark.timeout(600)]

LINES = 1000
OUTPUT = "".join(f"{number:05}{'x' * 94}\n" for number in range(LINES))
PRINTS = f"for number in range({LINES}):\n    print('%05d' % number + 94 * 'x')\n"
DRIVE = (
    "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
    "from pybricks.tools import wait\n"
    "Motor(Port.A).run(300)\nprint('it turns')\nwhile True:\n    wait(10)\n"
)
STOP_S = 0.5
ASLEEP_S = 10.0


def sized(size: int, name: str) -> str:
    """A program whose blob has so many bytes, of which its name is a part."""

    def program(last: int) -> str:
        lines = "".join(f"x = b'{number:05}{'a' * 95}'\n" for number in range(2540))
        return f"{lines}x = b'{'a' * last}'\nprint('the end')\n"

    def bytes_of(source: str) -> int:
        return 4 + len(f"{MAIN_MODULE}\0") + len(compile_mpy(source, name))

    last = 200 + size - bytes_of(program(200))
    # Lengths are numbers of one byte or two.
    for tried in (last, last - 1, last + 1):
        if bytes_of(program(tried)) == size:
            return program(tried)
    raise AssertionError(f"no program has {size} bytes")


async def run_on_hub(
    page: Page, hub: EmulatedHub, source: str, until: str = ENDED, name: str = "main.py"
) -> str:
    """Run a program on the hub; returns what is in the console."""
    file = {"name": name, "mimeType": "text/x-python", "buffer": source.encode()}
    await page.set_input_files("#file", files=[file])
    first_line = source.splitlines()[0]
    await page.locator(".cm-line", has_text=first_line).first.wait_for()
    name = await page.input_value("#programs")
    hub.files = {name: source}
    # Else the simulated hub would do so while it starts.
    compiled(source, name)
    await page.click("[data-real=run]")
    await page.locator("#state", has_text="on the hub").wait_for()
    await page.wait_for_selector(until)
    return await page.text_content("#console") or ""


def in_browser(scenario: Coroutine[Any, Any, None]) -> None:
    pytest.importorskip("playwright")
    asyncio.run(scenario)


def test_programs_run_are_stopped_and_survive_a_lost_link(address: str) -> None:
    async def scenario() -> None:
        hub = EmulatedHub(TWO_WHEELER)
        async with page_with(hub, address) as page:
            await connect(page)
            assert "prime, firmware 4.0.1" in (await page.text_content("[data-real=facts]") or "")
            assert await run_on_hub(page, hub, PRINTS) == OUTPUT
            largest = TWO_WHEELER.hub.model.program_bytes
            most = sized(largest, "most.py")
            assert await run_on_hub(page, hub, most, name="most.py") == "the end\n"
            shown = await run_on_hub(page, hub, sized(largest + 1, "more.py"), name="more.py")
            assert f"the prime hub takes {largest}" in shown
            await _stop(page, hub)
            await _lose(page, hub)

    in_browser(scenario())


async def _stop(page: Page, hub: EmulatedHub) -> None:
    await run_on_hub(page, hub, DRIVE, "#console:has-text('it turns')")
    assert hub.is_driven
    begin_s = time.monotonic()
    await page.click("[data-real=stop]")
    while hub.is_driven:
        await asyncio.sleep(0.01)
    assert time.monotonic() - begin_s < STOP_S
    await page.wait_for_selector("#state.stopped")


async def _lose(page: Page, hub: EmulatedHub) -> None:
    await run_on_hub(page, hub, DRIVE, "#console:has-text('it turns')")
    await hub.lose()
    await page.wait_for_selector(ENDED)
    assert "Your program goes on" in (await page.text_content("[data-real=status]") or "")
    assert hub.is_driven
    hub.press_button()
    await asyncio.sleep(1.0)
    await page.click("[data-real=again]")
    await page.locator("[data-real=facts]", has_text="firmware").wait_for()
    assert await run_on_hub(page, hub, "print('again')\n") == "again\n"


def test_a_robot_is_taught_while_its_page_sleeps(address: str) -> None:
    async def scenario() -> None:
        body = make_body(TWO_WHEELER, scene=Scene(wall_distance_mm=(600.0, 600.0)))
        hub = EmulatedHub(TWO_WHEELER, body)
        lesson = HUB_LESSONS["stop"](TWO_WHEELER).lesson
        program = generate_trials(
            TWO_WHEELER,
            lesson.interface,
            lesson.structure.numbers,
            lesson.structure.hub_source(),
        )
        hub.library.append(program.source)
        async with page_with(hub, address) as page:
            await page.select_option("#robot", "two-wheeler")
            await page.select_option("#world", "wall")
            await connect(page)
            await page.click("#teach-it")
            await page.click("[data-teach=learn]")
            while not hub.is_driven:
                await asyncio.sleep(0.02)
            before = await page.locator("[data-teach=curve] .dot").count()
            asleep = asyncio.create_task(_sleep(page, ASLEEP_S))
            still_s = await _still_s(hub, ASLEEP_S - 1.0)
            # Its trial of four seconds has ended by itself, and nobody has asked for the next one.
            assert still_s > 2.0
            await asleep
            dots = page.locator("[data-teach=curve] .dot")
            await dots.nth(before).wait_for()
            assert hub.connections == 1
            await page.click("[data-real=stop]")
            await page.wait_for_selector("#state.stopped")
            assert not hub.is_driven

    in_browser(scenario())


async def _sleep(page: Page, seconds: float) -> None:
    """Let the page do nothing at all for a time, which is worse than a tab that is hidden, whose
    timers are rare: amid a script, it waits for an answer."""

    async def answer(route: Route) -> None:
        await asyncio.sleep(seconds)
        await route.fulfill(body="")

    await page.route("**/late", answer)
    await page.evaluate(
        "() => { const late = new XMLHttpRequest(); late.open('GET', 'late', false); late.send(); }"
    )


async def _still_s(hub: EmulatedHub, seconds: float) -> float:
    """How long its motors stand at the end of a time, all of which passes."""
    end_s = time.monotonic() + seconds
    driven_s = time.monotonic()
    while time.monotonic() < end_s:
        if hub.is_driven:
            driven_s = time.monotonic()
        await asyncio.sleep(0.05)
    return end_s - driven_s
