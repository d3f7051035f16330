"""Stop, which ends any program at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from in_page import open_program

if TYPE_CHECKING:
    from playwright.sync_api import Page

HEAD = "from pybricks.tools import wait\n"
STOP_S = 1.0
"""On a computer with other tests beside; alone it takes at most 0.2 s."""


@pytest.mark.parametrize(
    "source",
    [
        "while True:\n    pass\n",
        "while True:\n    print('on and on')\n",
        HEAD + "wait(1000000)\n",
        "x = 0\nfor i in range(10 ** 9):\n    x = i\n",
        "while True:\n    try:\n        wait(1)\n    except BaseException:\n        pass\n",
    ],
)
def test_stop_ends_a_program_without_end(page: Page, source: str) -> None:
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
    assert took_ms < 1000 * STOP_S
    assert (page.text_content("#console") or "").endswith("was stopped (SystemExit).\n")
