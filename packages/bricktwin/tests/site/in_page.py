"""What somebody does in a page of the site."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

ENDED = "#state.finished, #state.error, #state.stopped, #state.failed"


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
