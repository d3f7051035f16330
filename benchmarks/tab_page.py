"""The page of a site in Chromium: how long a visitor waits, what memory it takes, and whether
running leaks.

    python -m benchmarks tab_page --minutes 15

The whole site, from a plain file server of this computer (which sends no headers, so that the page
loads itself once more for its service worker) and from the site's own starter ``serve.py``.

- Waits: from the request to the first picture of the robot, and to the robot's first motion, of
  visitors with an empty cache and at their second visit; medians. With them the processor time of
  all of the browser until then, as a computer that does something else makes visitors wait longer.
- Memory: proportional memory (PSS) of the page's own process while the first example runs, and
  every half minute while a program drives without end at five times real time. A browser's own
  collections of garbage let it rise and fall, so that a leak shows in the least of each third.
- A time-lapse: the same program as fast as it goes, by which an hour of the robot's time takes a
  few minutes; memory of the page's process, and of what its scripts hold.
- The same of two and of three hubs, whose robots share a world: a worker and a Python for each.

``--visitors 0``, ``--minutes 0``, ``--lapse 0`` and ``--hubs 0`` leave these out, and keep what was
measured of them.
"""

from __future__ import annotations

import http.server
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.session import Session
from bricktwin.site.build import build_site

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
SIZE = {"width": 1280, "height": 800}
TIMEOUT_MS = 120_000
RATE = "5"
CIRCLES = """
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase

base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
while True:
    base.curve(100, 360)
    print(base.distance())
"""

BEGUN = {
    "files": {"circles.py": CIRCLES},
    "current": "circles.py",
    "robot": "two-wheeler",
    "world": "",
}
"""What the page knows of a visitor who has that program."""


def begun_together(hubs: int) -> dict[str, Any]:
    """The same of a visitor who runs it on so many hubs."""
    seat = {"program": BEGUN["current"], "robot": BEGUN["robot"]}
    return {**BEGUN, "hubs": [seat] * hubs, "hub": 0}


class _PlainFiles(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments: object) -> None:
        """Quiet."""


@contextmanager
def plain_server(folder: Path) -> Iterator[str]:
    """Address of a folder on a file server."""
    handler = partial(_PlainFiles, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def own_starter(folder: Path) -> Iterator[str]:
    """Address of a site that its ``serve.py`` serves."""
    process = subprocess.Popen(  # noqa: S603  the site's own starter
        [sys.executable, str(folder / "serve.py"), "--no-browser"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


def cpu_s(browser: Browser) -> float:
    """Processor time of all of a browser so far."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    return sum(float(process["cpuTime"]) for process in processes)


def visit(page: Page, address: str) -> dict[str, float]:
    """Seconds from the request to the robot's picture, and to its first motion; and the browser's
    processor time."""
    browser = page.context.browser
    assert browser is not None
    used_s = cpu_s(browser)
    started_s = time.monotonic()
    page.goto(address, wait_until="commit")
    page.wait_for_selector("#scene[data-frames]")
    seen_s = time.monotonic() - started_s
    if page.locator("#run").is_enabled():
        # At the second visit nothing runs by itself.
        page.click("#run")
    wait_until(page, "parseFloat(document.querySelector('#clock').textContent) >= 0.2")
    moving_s = time.monotonic() - started_s
    return {
        "seen_s": round(seen_s, 2),
        "moving_s": round(moving_s, 2),
        "cpu_s": round(cpu_s(browser) - used_s, 2),
    }


def wait_until(page: Page, condition: str) -> None:
    """Wait until a condition holds: as a script, as the page's policy allows no text of one."""
    page.evaluate(
        f"async () => {{ while (!({condition})) await new Promise(requestAnimationFrame); }}"
    )


def waits(browser: Browser, address: str, visitors: int) -> dict[str, Any]:
    """Waits of visitors who come twice."""
    visits: dict[str, list[dict[str, float]]] = {"first": [], "second": []}
    for _ in range(visitors):
        context = browser.new_context(viewport=SIZE)
        context.set_default_timeout(TIMEOUT_MS)
        page = context.new_page()
        visits["first"].append(visit(page, address))
        # The rest of the site is fetched meanwhile.
        page.wait_for_timeout(3000)
        page.close()
        visits["second"].append(visit(context.new_page(), address))
        context.close()
    found: dict[str, Any] = {}
    for name, several in visits.items():
        for key in ("seen_s", "moving_s", "cpu_s"):
            values = [one[key] for one in several]
            found[f"{name}_{key}"] = round(statistics.median(values), 2)
        found[f"{name}_each"] = several
    return found


def renderers(browser: Browser) -> list[int]:
    """Processes that show pages."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    return [process["id"] for process in processes if process["type"] == "renderer"]


def pss_mb(process: int) -> float:
    """Proportional memory of a process."""
    text = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="utf-8")
    match = re.search(r"(?m)^Pss: +(\d+) kB", text)
    return int(match[1]) / 1024 if match else 0.0


def page_mb(browser: Browser) -> float:
    """Proportional memory of the page's process, which is the largest: others stand ready."""
    return max(pss_mb(process) for process in renderers(browser))


def drive(browser: Browser, address: str, minutes: float) -> dict[str, Any]:
    """Memory while a program runs that has no end."""
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(TIMEOUT_MS)
    page = context.new_page()
    visit(page, address)
    page.wait_for_timeout(5000)
    at_first_mb = page_mb(browser)
    page.click("#stop")
    page.wait_for_selector("#state.stopped")
    content = CIRCLES.encode()
    files = [{"name": "circles.py", "mimeType": "text/x-python", "buffer": content}]
    page.set_input_files("#file", files=files)
    wait_until(page, "document.querySelector('#programs').value === 'circles.py'")
    page.select_option("#rate", RATE)
    page.click("#run")
    rows: list[tuple[float, float]] = []
    session = context.new_cdp_session(page)
    started_s = time.monotonic()
    while time.monotonic() - started_s < 60 * minutes:
        page.wait_for_timeout(min(30_000, 6000 * minutes))
        session.send("HeapProfiler.collectGarbage")
        clock = page.text_content("#clock") or "0"
        rows.append((page_mb(browser), float(clock.split()[0])))
    context.close()
    third = max(1, len(rows) // 3)
    pieces = [rows[start : start + third] for start in range(0, 3 * third, third)]
    return {
        "first_example_mb": round(at_first_mb, 1),
        "minutes": minutes,
        "simulated_s": rows[-1][1],
        "mb": [round(mb, 1) for mb, _ in rows],
        "least_mb_of_each_third": [round(min(mb for mb, _ in piece), 1) for piece in pieces],
    }


def lapse(
    browser: Browser,
    address: str,
    minutes: float,
    begun: dict[str, Any],
) -> dict[str, Any]:
    """Memory while programs drive without end as fast as they go; ``begun``: what the page
    knows."""
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(TIMEOUT_MS)
    page = context.new_page()
    page.add_init_script(f"localStorage['bricks-programs'] ??= {json.dumps(json.dumps(begun))}")
    page.goto(address)
    page.wait_for_selector("#state.ready")
    page.select_option("#rate", "fast")
    page.click("#run")
    session = context.new_cdp_session(page)
    rows = []
    started_s = time.monotonic()
    while time.monotonic() - started_s < 60 * minutes:
        page.wait_for_timeout(12_000)
        session.send("HeapProfiler.collectGarbage")
        scripts_mb = session.send("Runtime.getHeapUsage")["usedSize"] / 1e6
        simulated_s = float((page.text_content("#clock") or "0").split()[0])
        rows.append([simulated_s, round(page_mb(browser), 1), round(scripts_mb, 2)])
    context.close()
    return {"minutes": minutes, "simulated_s_mb_and_scripts_mb": rows}


def main(session: Session) -> None:
    """Measure, and write the result."""
    from playwright.sync_api import sync_playwright

    args = session.parse(minutes=15.0, visitors=5, lapse=3.0, hubs=1.0)
    with tempfile.TemporaryDirectory(prefix="tab-page-") as name:
        folder = Path(name) / "site"
        files = build_site(folder)
        size_mb = sum(path.stat().st_size for path in files) / 1e6
        result: dict[str, Any] = dict(session.known())
        result |= {"site_mb": round(size_mb, 2), "files": len(files)}
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=list(FLAGS)
            )
            result["browser"] = browser.version
            for key, serve in (("file_server", plain_server), ("own_starter", own_starter)):
                if not args.visitors:
                    continue
                with serve(folder) as address:
                    result[key] = waits(browser, address, args.visitors)
                    print(key, result[key], flush=True)
            result["load_average"] = round(os.getloadavg()[0], 2)
            with plain_server(folder) as address:
                if args.minutes:
                    result["running"] = drive(browser, address, args.minutes)
                    print(result["running"], flush=True)
                if args.lapse:
                    result["lapse"] = lapse(browser, address, args.lapse, BEGUN)
                    print(result["lapse"], flush=True)
                # One hub, too, in the same time: what a hub more takes is the difference.
                for hubs, name in ((1, "one_hub"), (2, "two_hubs"), (3, "three_hubs")):
                    if args.hubs:
                        begun = begun_together(hubs) if hubs > 1 else BEGUN
                        result[name] = lapse(browser, address, args.hubs, begun)
                        print(name, result[name], flush=True)
            browser.close()
    session.write(result)
