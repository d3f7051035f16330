"""A site on a plain file server, in a folder below its top, and a page of it in one browser."""

from __future__ import annotations

import functools
import http.server
import json
import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from browser import TIMEOUT_MS, chromium

from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.site.build import build_site
from bricktwin.site.packages import SiteError

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).parents[4]
SUB_PATH = "school/class-7"


@dataclass
class Site:
    """A served site.

    Attributes:
        folder, address: of the site.
        told: what pages of tests have posted.
    """

    folder: Path
    address: str = ""
    told: queue.Queue[dict[str, Any]] = field(default_factory=queue.Queue)


class _PlainFiles(http.server.SimpleHTTPRequestHandler):
    """No headers but those of a file server; takes what a page of a test posts."""

    def __init__(self, *arguments: Any, site: Site, **options: Any) -> None:
        self._site = site
        super().__init__(*arguments, **options)

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self._site.told.put(json.loads(content))

    def log_message(self, *arguments: object) -> None:
        """Quiet."""


def _build(folder: Path) -> None:
    try:
        build_site(
            folder,
            (TWO_WHEELER, SCOUT),
            worlds=("wall", "table", "line-simple"),
            has_kits=find_spec("legoeducation") is not None,
        )
    except SiteError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A site on a file server. Skips without what it is made of."""
    top = tmp_path_factory.mktemp("web")
    with pytest.MonkeyPatch.context() as patch:
        # What npm fetches is the same each time; it stays until `make clean`.
        patch.setenv("XDG_CACHE_HOME", str(ROOT / "build" / "site-cache"))
        _build(top / SUB_PATH)
    site = Site(top / SUB_PATH)
    handler = functools.partial(_PlainFiles, directory=str(top), site=site)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    site.address = f"http://127.0.0.1:{server.server_port}/{SUB_PATH}/"
    yield site
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="session")
def address(site: Site) -> str:
    return site.address


# Playwright has an event loop in this thread for as long as the browser is open. Other modules,
# whose tests have loops of their own, must not meet it.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    pytest.importorskip("playwright")
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def page(address: str, browser: Browser) -> Iterator[Page]:
    """A page with Python at work. No request leaves the site's address, no script fails."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened = context.new_page()
    opened.set_default_timeout(TIMEOUT_MS)
    errors: list[str] = []
    asked: set[str] = set()
    opened.on("pageerror", lambda error: errors.append(str(error)))
    context.on("request", lambda request: asked.add(request.url))
    # Else the first visit runs an example on a robot, whose pictures take long without a graphics
    # card.
    opened.add_init_script(
        "localStorage['bricks-programs'] ??= JSON.stringify("
        "{ files: { 'main.py': '' }, current: 'main.py', robot: 'bench', world: '' })"
    )
    opened.goto(address)
    opened.wait_for_selector("#state.ready")
    yield opened
    context.close()
    assert not errors
    # What the worker has unpacked are addresses within the browser.
    origin = "/".join(address.split("/")[:3])
    outside = {url for url in asked if not url.startswith((address, f"blob:{origin}/"))}
    assert outside <= {"about:blank"}
