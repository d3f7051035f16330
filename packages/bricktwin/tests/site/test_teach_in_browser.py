"""Teaching on the page: the robot tries, is stopped, a person tries, a program is made of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from browser import TIMEOUT_MS
from in_page import ENDED

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STOP_S = 0.2
DOTS = "[data-teach=curve] .dot"


@pytest.mark.slow
@pytest.mark.realtime
def test_a_robot_is_taught_and_what_it_learned_is_a_program(page: Page) -> None:
    page.select_option("#robot", "two-wheeler")
    page.wait_for_selector("#teach-it", state="hidden")
    page.select_option("#world", "wall")
    page.click("#teach-it")
    page.wait_for_selector("#state.learning")
    # Not by a text of a script, which the page's policy forbids.
    page.locator(DOTS).nth(2).wait_for(state="attached")
    took_ms = page.evaluate(
        """async () => {
            const state = document.querySelector("#state"), start = performance.now();
            document.querySelector("[data-teach=halt]").click();
            while (state.textContent === "learning") await new Promise(requestAnimationFrame);
            return performance.now() - start;
        }"""
    )
    assert took_ms < 1000 * STOP_S
    assert page.text_content("#state") == "stopped"
    before = page.locator(DOTS).count()
    # Numbers that a person knows to be good.
    for place, value in enumerate(("160", "2.4")):
        page.locator("[data-teach=sliders] input").nth(place).fill(value)
    page.click("[data-teach=try]")
    page.wait_for_selector(f"{DOTS}.mine, {DOTS}.best[r='5.5']")
    page.wait_for_selector("#state.finished")
    assert page.locator(DOTS).count() == before + 1
    assert "points" in (page.text_content("[data-teach=status]") or "")
    page.click("[data-teach=export]")
    assert page.input_value("#programs") == "stop.py"
    page.select_option("#rate", "fast")
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.wait_for_timeout(1000)
    page.click("#stop")
    page.wait_for_selector(ENDED)
    assert "0 574" in (page.text_content("#console") or "")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_new_visitor_teaches_a_robot_by_one_click(address: str, browser: Browser) -> None:
    """While the first example runs."""
    context = browser.new_context()
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.goto(address)
    page.wait_for_selector("#state.running")
    page.click("#teach-it")
    page.wait_for_selector("#state.learning")
    page.wait_for_selector("#state.finished")
    assert page.locator(DOTS).count() == 35
    said = page.text_content("[data-teach=status]") or ""
    assert said.startswith("It has learned: ") and float(said.split()[3]) > 65
    context.close()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_line_is_learned(page: Page) -> None:
    page.select_option("#robot", "scout")
    page.select_option("#world", "line-simple")
    page.locator("#teach-it", has_text="follow the line").click()
    page.wait_for_selector("#state.learning")
    page.wait_for_selector("#state.finished")
    said = page.text_content("[data-teach=status]") or ""
    assert float(said.removeprefix("It has learned: ").split()[0]) > 90
    page.click("[data-teach=export]")
    assert page.input_value("#programs") == "follow.py"
