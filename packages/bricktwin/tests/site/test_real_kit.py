"""Real devices of LEGO's kits from the tab: LEGO's package and its Web Bluetooth transport before
virtual devices, in a played browser and in Chromium."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from emulated_hub import page_with
from emulated_kit import EmulatedKit
from in_page import ENDED

from bricktwin.robots import CART
from bricktwin.twin.make_body import make_body

if TYPE_CHECKING:
    from playwright.async_api import Page

pytest.importorskip("legoeducation")

KITS = Path(__file__).parents[3] / "brickhub" / "tests" / "kits"
SCRIPT = Path(__file__).with_name("kits_on_real_devices.py")
STOP_S = 1.0
HEAD = "import time\nimport legoeducation as le\nm = le.DoubleMotor()\nm.connect()\n"


def test_programs_run_on_devices_of_the_page() -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(KITS)},
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    ran: dict[str, dict[str, Any]] = {one.pop("name"): one for one in lines}
    assert ran["drives"]["said"] == "it drove\nTrue\n"
    assert ran["drives"]["code"] == 0
    # The Color Sensor has no motors to stop.
    assert ran["drives"]["stops"] == ["a8", ""]
    # The program leaves its motors running: they are stopped before the link ends.
    assert ran["drives"]["asked"][-3:] == ["send", "close", "close"]
    said = ran["nobody chooses"]["said"]
    assert "Could not find device" in said and said.endswith("False\n")
    assert "ZeroDivisionError" in ran["fails"]["said"] and ran["fails"]["code"] == 1
    assert ran["is stopped"]["code"] == 130
    assert ran["is stopped"]["said"] == "The program was stopped (SystemExit).\n"
    assert ran["is stopped"]["asked"][-2:] == ["send", "close"]


async def open_program(page: Page, source: str) -> None:
    file = {"name": "main.py", "mimeType": "text/x-python", "buffer": source.encode()}
    await page.set_input_files("#file", files=[file])
    await page.locator("#run-on-kit").wait_for(state="visible")


async def run_on_kit(page: Page, source: str, until: str = ENDED) -> str:
    """Run a program on the device, which is chosen; returns what is in the console."""
    await open_program(page, source)
    await page.click("#run-on-kit")
    await page.click("[data-kit=choose]")
    await page.wait_for_selector(until)
    return await page.text_content("#console") or ""


def in_browser(scenario: Coroutine[Any, Any, None]) -> None:
    pytest.importorskip("playwright")
    asyncio.run(scenario)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(300)
def test_a_program_drives_a_device_in_chromium(address: str) -> None:
    async def scenario() -> None:
        body = make_body(CART)
        async with page_with(EmulatedKit(body), address) as page:
            drives = f"{HEAD}m.movement_move_for_time(1000)\nprint('it drove')\n"
            assert await run_on_kit(page, drives) == "it drove\n"
            assert body.pose().x_m > 0.05

    in_browser(scenario())


# Chromium's emulation keeps a connection whose reads have no answer: each program has a browser.
@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(300)
@pytest.mark.parametrize("waits", ["time.sleep(0.05)", "pass"])
def test_the_page_stops_a_device_whatever_the_program_does(address: str, waits: str) -> None:
    async def scenario() -> None:
        kit = EmulatedKit(make_body(CART))
        async with page_with(kit, address) as page:
            endless = f"while True:\n    {waits}\n"
            source = f"{HEAD}m.movement_move()\nprint('on and on')\n{endless}"
            await run_on_kit(page, source, "#console:has-text('on and on')")
            while not kit.is_driven:
                await asyncio.sleep(0.01)
            begin_s = time.monotonic()
            await page.click("[data-kit=stop]")
            while kit.is_driven:
                await asyncio.sleep(0.01)
            assert time.monotonic() - begin_s < STOP_S
            await page.wait_for_selector("#state.stopped")

    in_browser(scenario())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_who_chooses_no_device_is_told(address: str) -> None:
    async def scenario() -> None:
        async with page_with(EmulatedKit(make_body(CART)), address) as page:
            await open_program(page, f"{HEAD}print(m.connected)\n")
            await page.click("#run-on-kit")
            await page.locator("[data-kit=status]", has_text="looks for a Double Motor").wait_for()
            await page.click("[data-kit=none]")
            await page.wait_for_selector(ENDED)
            said = await page.text_content("#console") or ""
            assert "Could not find device" in said and said.endswith("False\n")

    in_browser(scenario())
