"""Headless Chromium for page tests: the system's or Playwright's."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
)
TIMEOUT_MS = 120_000
"""Timeout of all waits in the browser."""


def chromium_path(own: str) -> str:
    """Path of the system's browser, or of Playwright's ``own``; skips the test without either."""
    found = next((path for name in _NAMES if (path := shutil.which(name))), None)
    found = found or shutil.which(own)
    if found is None:
        pytest.skip("no Chromium is on this computer; install one (Debian: apt install chromium)")
    return found


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser; skips the test without one."""
    from playwright.sync_api import sync_playwright

    with ExitStack() as ends:
        try:
            playwright = ends.enter_context(sync_playwright())
        except Exception as error:  # noqa: BLE001 - Playwright raises no narrower one
            # Its driver is a Node.js of its own, which wants a library that a bare Debian lacks.
            pytest.skip(f"the driver of Playwright does not start ({error})")
        path = chromium_path(playwright.chromium.executable_path)
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


def sleep(page: Page, seconds: float) -> None:
    """Let a page do nothing for a time, as one that gets no processor time: amid a script, it waits
    for an answer. (A loop would take processor time.)"""

    def answer(route: Route) -> None:
        time.sleep(seconds)
        route.fulfill(body="")

    page.route("**/late", answer)
    page.evaluate(
        "() => { const late = new XMLHttpRequest(); "
        "late.open('GET', '/late', false); late.send(); }"
    )


# Without a graphics card each pixel of a robot is computed, for as long as a tab is open.
_FEW_PIXELS = "Object.defineProperty(window, 'devicePixelRatio', { get: () => 0.2 })"


@contextmanager
def tab(
    browser: Browser,
    url: str,
    width: int = 840,
    height: int = 560,
    *,
    is_sharp: bool = False,
) -> Iterator[Page]:
    """A tab that must show no script errors and contact no other host. Robots and charts have few
    pixels if it is not sharp; all else is as it is."""
    context = browser.new_context(viewport={"width": width, "height": height})
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    if not is_sharp:
        page.add_init_script(_FEW_PIXELS)
    errors: list[str] = []
    asked: set[str] = set()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: asked.add(request.url.split("/")[2]))
    page.goto(url)
    yield page
    context.close()
    assert not errors
    assert asked == {url.split("/")[2]}
