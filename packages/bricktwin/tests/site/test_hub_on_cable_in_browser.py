"""A real EV3 Brick on its cable, from the page in Chromium: a simulated brick is at the end of a
Web Serial that is played."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from emulated_hub import page_with
from hub_firmware import compiled
from hub_on_cable import HubOnCable
from in_page import ENDED

from bricktwin.robots import EV3_DRIVER

if TYPE_CHECKING:
    from playwright.async_api import Page

pytestmark = [pytest.mark.slow, pytest.mark.realtime, pytest.mark.timeout(240)]

LINES = 60
OUTPUT = "".join(f"{number:05}{'x' * 94}\n" for number in range(LINES))
PRINTS = f"for number in range({LINES}):\n    print('%05d' % number + 94 * 'x')\n"
DRIVE = (
    "from pybricks.ev3devices import Motor\nfrom pybricks.parameters import Port\n"
    "from pybricks.tools import wait\n"
    "Motor(Port.B).run(300)\nprint('it turns')\nwhile True:\n    wait(10)\n"
)
BUSY = DRIVE.replace("    wait(10)", "    print('on and on')\n    wait(1)")
STOP_S = 0.5


async def connect(page: Page) -> None:
    await page.click("#connect-cable")
    await page.locator("[data-real=facts]", has_text="firmware").wait_for()


async def run_on_hub(page: Page, hub: HubOnCable, source: str, until: str = ENDED) -> str:
    """Run a program on the brick; returns what is in the console."""
    file = {"name": "main.py", "mimeType": "text/x-python", "buffer": source.encode()}
    await page.set_input_files("#file", files=[file])
    first_line = source.splitlines()[0]
    await page.locator(".cm-line", has_text=first_line).first.wait_for()
    name = await page.input_value("#programs")
    hub.files = {name: source}
    # Else the simulated brick would do so while it starts.
    compiled(source, name)
    await page.click("[data-real=run]")
    await page.locator("#state", has_text="on the hub").wait_for()
    await page.wait_for_selector(until)
    return await page.text_content("#console") or ""


async def stop(page: Page, hub: HubOnCable, source: str) -> None:
    await run_on_hub(page, hub, source, "#console:has-text('it turns')")
    assert hub.is_driven
    begin_s = time.monotonic()
    await page.click("[data-real=stop]")
    while hub.is_driven:
        await asyncio.sleep(0.01)
    assert time.monotonic() - begin_s < STOP_S
    await page.wait_for_selector("#state.stopped")


async def pull(page: Page, hub: HubOnCable) -> None:
    await run_on_hub(page, hub, DRIVE, "#console:has-text('it turns')")
    hub.pull_the_cable()
    await page.wait_for_selector(ENDED)
    assert "its cable was pulled" in (await page.text_content("#console") or "")
    assert "Your program goes on" in (await page.text_content("[data-real=status]") or "")
    hub.press_button()
    while hub.is_running:
        await asyncio.sleep(0.01)
    hub.is_plugged_in = True
    await page.click("[data-real=again]")
    await page.locator("[data-real=facts]", has_text="firmware").wait_for()
    assert await run_on_hub(page, hub, "print('again')\n") == "again\n"


def test_programs_run_are_stopped_and_survive_a_pulled_cable(address: str) -> None:
    pytest.importorskip("playwright")

    async def scenario() -> None:
        hub = HubOnCable(replace(EV3_DRIVER, sensors=()))
        async with page_with(hub, address) as page:
            page.set_default_timeout(40_000)
            asked: set[str] = set()
            page.context.on("request", lambda request: asked.add(request.url))
            await connect(page)
            facts = await page.text_content("[data-real=facts]") or ""
            assert facts.startswith("ev3, firmware 4.1.0b4, battery charged")
            assert await run_on_hub(page, hub, PRINTS) == OUTPUT
            await stop(page, hub, DRIVE)
            await stop(page, hub, BUSY)
            await pull(page, hub)
            await page.click("[data-real=leave]")
            await page.locator("#connect-cable").wait_for()
            assert not hub.is_connected
            # Nothing but the site itself is asked for anything.
            origin = "/".join(address.split("/")[:3])
            assert not {url for url in asked if not url.startswith((address, f"blob:{origin}/"))}

    asyncio.run(scenario())
