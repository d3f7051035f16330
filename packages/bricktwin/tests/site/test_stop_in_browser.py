"""Stop, which ends any program at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from in_page import open_program

if TYPE_CHECKING:
    from playwright.sync_api import Page

HEAD = "from pybricks.tools import wait\n"
STOP_S = 0.2
BESIDE_OTHERS_S = 1.0
"""The same on a computer whose cores run other tests."""


ENDLESS = [
    "while True:\n    pass\n",
    "while True:\n    print('on and on')\n",
    HEAD + "wait(1000000)\n",
    "x = 0\nfor i in range(10 ** 9):\n    x = i\n",
    "while True:\n    try:\n        wait(1)\n    except BaseException:\n        pass\n",
]


@pytest.mark.parametrize("source", ENDLESS)
def test_stop_ends_a_program_without_end(page: Page, source: str) -> None:
    assert stopped_after_s(page, source) < BESIDE_OTHERS_S


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("source", ENDLESS)
def test_stop_takes_a_moment(page: Page, source: str) -> None:
    assert stopped_after_s(page, source) < STOP_S


def stopped_after_s(page: Page, source: str) -> float:
    """Seconds from the press of Stop to the end of a program that has none."""
    open_program(page, source)
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.wait_for_timeout(500)
    took_ms = page.evaluate(
        """async () => {
            const state = document.querySelector("#state"), start = performance.now();
            document.querySelector("#stop").click();
            while (state.textContent === "running") await new Promise(requestAnimationFrame);
            return performance.now() - start;
        }"""
    )
    assert page.text_content("#state") == "stopped"
    assert (page.text_content("#console") or "").endswith("was stopped (SystemExit).\n")
    return float(took_ms) / 1000
