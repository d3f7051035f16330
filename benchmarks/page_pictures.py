"""Pictures of the live page, taken in a headless Chromium.

    python -m benchmarks page_pictures

Writes for the documentation ``docs/images/page.png``, a Walker in mid-training, ``docs/images/page_phone.png``, a 2Wheeler driven
by hand on a screen as wide as a phone's, ``docs/images/page_goal.png``, the bay of Park, ``docs/images/page_tag.png``, a phone
that drives the runner, and ``docs/images/start_page.png``; and for the start page a picture of each environment, drawn by the
live page itself. Needs Chromium and some minutes.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from benchmarks.session import Session
from bricksrl.envs.registry import is_simulation, list_envs

FOLDER = Path(__file__).parents[1] / "docs" / "images"
ENVIRONMENTS = Path(__file__).parents[1] / "packages" / "bricksrl" / "src" / "bricksrl" / "page" / "pictures"
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
OVERLAYS = "#facts, #view-buttons, #metres, #camera, #hint"
SIZE_PX = (480, 300)
"""Of the picture of an environment."""
EPISODES = 12
"""Of the training before the picture is taken."""


@contextmanager
def served(folder: str, *arguments: str) -> Iterator[str]:
    """Address of the page of a ``bricksrl`` command, run in a folder until the end of this context."""
    words = [sys.executable, "-m", "bricksrl", *arguments]
    process = subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)  # noqa: S603  our own command
    try:
        for line in process.stdout or ():
            match = re.search(r"http://\S+", line)
            if match is not None:
                yield match[0]
                break
    finally:
        process.kill()
        process.wait()


@contextmanager
def tab(url: str, width: int, height: int) -> Iterator[Page]:
    """The page in a browser of this size."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=list(FLAGS))
        page = browser.new_context(viewport={"width": width, "height": height}).new_page()
        page.set_default_timeout(600_000)
        page.goto(url)
        page.wait_for_selector("#scene")
        yield page
        browser.close()


def take(page: Page, path: Path) -> None:
    """Take the picture, of a robot at rest: it is drawn with all pixels."""
    page.get_by_role("button", name="Pause", exact=True).click()
    page.wait_for_timeout(4_000)
    page.screenshot(path=path)


def take_environment(env_id: str, folder: Path) -> None:
    """Take the picture of an environment, of its robot alone."""
    with served(".", "demo", env_id) as url, tab(url, 656, 960) as page:
        page.locator("#facts:has-text('episode')").wait_for()
        page.wait_for_timeout(5_000)
        take_view(page, folder / f"{env_id}.jpg")


def take_arena(env_id: str, robot: str, phone: Path | None, alone: Path) -> None:
    """Take the pictures of an arena: on a phone that drives one robot, and of the robots alone."""
    with served(".", "team", env_id, "--page") as url, tab(url, 390, 844) as page:
        page.locator("#facts:has-text('step')").wait_for()
        page.get_by_role("button", name=f"Drive the {robot}", exact=True).click()
        page.wait_for_timeout(4_000)
        if phone is not None:
            page.screenshot(path=phone)
        page.set_viewport_size({"width": 656, "height": 960})
        take_view(page, alone)


def take_view(page: Page, path: Path) -> None:
    """Take the picture of the robot alone, at rest."""
    page.evaluate(f"document.querySelectorAll('{OVERLAYS}').forEach((one) => (one.style.opacity = 0))")
    page.get_by_role("button", name="Pause", exact=True).click()
    page.wait_for_timeout(4_000)
    picture = Image.open(io.BytesIO(page.locator("#view").screenshot()))
    picture.convert("RGB").resize(SIZE_PX).save(path, quality=82)


def main(session: Session) -> None:
    """Take the pictures."""
    session.parse()
    pictures = session.place_of(FOLDER)
    for env_id in list_envs():
        if not is_simulation(env_id):
            take_environment(env_id, session.place_of(ENVIRONMENTS))
    take_arena("Tag-v0", "runner", pictures / "page_tag.png", ENVIRONMENTS / "Tag-v0.jpg")
    take_arena("Carry-v0", "left", None, ENVIRONMENTS / "Carry-v0.jpg")
    with served(".", "demo", "Park-v0") as url, tab(url, 1280, 800) as page:
        page.wait_for_timeout(5_000)
        take(page, pictures / "page_goal.png")
    with served(".", "page") as url, tab(url, 1280, 800) as page:
        page.locator(".env img").last.wait_for()
        page.screenshot(path=pictures / "start_page.png")
    with (
        tempfile.TemporaryDirectory() as folder,
        served(folder, "train", "Walker-v1", "--episodes", "60", "--page", "--no-record", "--run", "runs/walk") as url,
        tab(url, 1200, 800) as page,
    ):
        page.locator(f"#facts:has-text('{EPISODES}/')").wait_for()
        page.get_by_role("button", name="1x", exact=True).click()
        page.wait_for_timeout(8_000)
        take(page, pictures / "page.png")
    with served(".", "drive", "RunAway-v0") as url, tab(url, 390, 844) as page:
        page.wait_for_timeout(6_000)
        take(page, pictures / "page_phone.png")
    print(pictures)
