"""Pictures of the site in a browser's tab, taken in a headless Chromium.

    python -m benchmarks tab_pictures
    python -m benchmarks tab_pictures --looks

Writes ``docs/images/tab.png``, the first example at work, for the documentation. ``--looks`` writes
into ``studies/tab_pictures/looks`` what is to be looked at after a change of the page, on a laptop
and on a phone: the page as it begins, a robot at work, an error, the bench.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from benchmarks.session import Session
from benchmarks.tab_page import FLAGS, TIMEOUT_MS, plain_server, wait_until
from bricktwin.site.build import build_site

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).parents[1]
IMAGE = ROOT / "docs" / "images" / "tab.png"
POLICIES = ROOT / "docs" / "hub_programs"
SIZES_PX = {"laptop": (1280, 800), "phone": (390, 844)}
SHOWN_S = 3.0
"""Time of the run at which the first example is shown."""
ERROR = "from pybricks.tools import wait\n\nprint('before')\nwait(10)\nx = 1 / 0\n"
BENCH = """from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import ColorSensor, Motor, UltrasonicSensor
from pybricks.tools import wait

hub = PrimeHub()
motor = Motor(Port.A)
light = ColorSensor(Port.B)
eyes = UltrasonicSensor(Port.C)
motor.run(200)
while True:
    print(light.color(), eyes.distance())
    hub.display.number(eyes.distance() // 20)
    wait(100)
"""


def opened(
    browser: Browser,
    address: str,
    size: tuple[int, int],
) -> Page:
    """The page of somebody who is there for the first time."""
    width, height = size
    context = browser.new_context(viewport={"width": width, "height": height})
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.goto(address)
    page.wait_for_selector("#scene[data-frames]")
    return page


def at_work(page: Page) -> None:
    """Wait until the first example is at work."""
    clock = "parseFloat(document.querySelector('#clock').textContent)"
    wait_until(page, f"{clock} >= {SHOWN_S}")
    page.click("#pause")
    # A processor in place of a graphics card draws with fewer pixels while the robot moves.
    page.wait_for_timeout(3000)


def run(page: Page, source: str) -> None:
    """Open a program as a file, and run it."""
    content = source.encode()
    page.set_input_files(
        "#file", files=[{"name": "try.py", "mimeType": "text/x-python", "buffer": content}]
    )
    wait_until(page, "document.querySelector('#programs').value.startsWith('try')")
    page.click("#run")


def look(
    browser: Browser,
    address: str,
    folder: Path,
) -> None:
    """Take what is to be looked at."""
    for name, size in SIZES_PX.items():
        page = opened(browser, address, size)
        page.screenshot(path=folder / f"begin_{name}.png")
        at_work(page)
        page.screenshot(path=folder / f"drive_{name}.png", full_page=True)
        page.click("#stop")
        page.wait_for_selector("#state.stopped")
        run(page, ERROR)
        page.wait_for_selector("#state.error")
        page.screenshot(path=folder / f"error_{name}.png", full_page=True)
        page.select_option("#robot", "bench")
        run(page, BENCH)
        page.wait_for_selector("#state.running")
        page.wait_for_timeout(2500)
        page.screenshot(path=folder / f"bench_{name}.png", full_page=True)
        page.context.close()


def main(session: Session) -> None:
    """Take them."""
    from playwright.sync_api import sync_playwright

    session.parser.add_argument("--looks", action="store_true")
    session.parser.add_argument("--site", type=Path, metavar="FOLDER", help="one that is made")
    args = session.parse()
    with tempfile.TemporaryDirectory(prefix="tab-pictures-") as name, sync_playwright() as driver:
        site = args.site or Path(name) / "site"
        if args.site is None:
            build_site(site, policies=POLICIES)
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=list(FLAGS))
        with plain_server(site) as address:
            if args.looks:
                folder = session.folder / "looks"
                folder.mkdir(parents=True, exist_ok=True)
                look(browser, address, folder)
                print(folder)
            else:
                page = opened(browser, address, SIZES_PX["laptop"])
                at_work(page)
                page.screenshot(path=IMAGE)
                # 256 colours are enough, and a third of the bytes.
                Image.open(IMAGE).convert("RGB").quantize(256).save(IMAGE, optimize=True)
                print(IMAGE)
        browser.close()
