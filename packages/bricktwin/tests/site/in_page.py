"""What somebody does in a page of the site."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

ENDED = "#state.finished, #state.error, #state.stopped, #state.failed"

HEAD = "from pybricks.tools import wait\n"
ENDLESS = [
    "while True:\n    pass\n",
    "while True:\n    print('on and on')\n",
    HEAD + "wait(1000000)\n",
    "x = 0\nfor i in range(10 ** 9):\n    x = i\n",
    "while True:\n    try:\n        wait(1)\n    except BaseException:\n        pass\n",
]
"""Programs that only a stop ends."""


def open_program(page: Page, source: str, name: str = "main.py") -> str:
    """Open a program as a file; returns the name that it has in the page."""
    content = source.encode()
    file = {"name": name, "mimeType": "text/x-python", "buffer": content}
    page.set_input_files("#file", files=[file])
    page.evaluate(
        """async (source) => {
            const kept = () => JSON.parse(localStorage["bricks-programs"] ?? "{}");
            const isThere = () => kept().files?.[kept().current] === source;
            while (!isThere()) await new Promise(requestAnimationFrame);
        }""",
        source,
    )
    return page.input_value("#programs")


def run_program(page: Page, source: str, name: str = "main.py") -> tuple[str, str, str]:
    """Run a program as fast as it goes, to its end; returns its name, what is in the console, and
    the state that the page names."""
    shown_name = open_program(page, source, name)
    page.select_option("#rate", "fast")
    page.click("#run")
    page.wait_for_selector(ENDED)
    return shown_name, page.text_content("#console") or "", page.text_content("#state") or ""


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
