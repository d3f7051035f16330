"""Pictures of the live page, taken in a headless Chromium.

    python -m benchmarks page_pictures
    python -m benchmarks page_pictures --looks

Writes for the documentation ``docs/images/page.png``, a trained Walker,
``docs/images/page_phone.png``, a 2Wheeler driven by hand on a screen as wide as a phone's,
``docs/images/page_goal.png``, the bay of Park, ``docs/images/page_tag.png``, a phone that drives
the runner, and ``docs/images/start_page.png``; and for the start page a picture of each
environment, drawn as in films.

``--looks`` writes into ``studies/page_pictures/looks`` what is to be looked at after a change of
the page: the first frame of each card's page, and the start page in a class, each at three sizes;
and the sheet that is printed of a run.

Needs Chromium, OpenGL and some minutes.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from benchmarks.session import Session
from bricksrl.envs.arenas import ARENAS, get_arena_task
from bricksrl.envs.make import has_arrays, make
from bricksrl.envs.registry import is_simulation, list_envs
from bricksrl.envs.tasks.scripted import CONTROLLERS
from bricksrl.errors import BricksError
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.render.opengl import Renderer
from bricktwin.twin.render.video import Room

FOLDER = Path(__file__).parents[1] / "docs" / "images"
ENVIRONMENTS = (
    Path(__file__).parents[1] / "packages" / "bricksrl" / "src" / "bricksrl" / "page" / "pictures"
)
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
SEED, STEPS = 3, 2
SIZES_PX = {"laptop": (1366, 768), "upright": (390, 844), "across": (844, 390)}
"""Of windows: a laptop, and a phone in both directions."""
_HAS_ALL_PIXELS = """() => {
  const scene = document.querySelector("#scene");
  const width = scene.clientWidth * Math.min(devicePixelRatio, 2);
  return Math.abs(width - scene.width) < 1;
}"""
NAMES = ("Anna", "Ben and Carla", "The group at the window")
"""Of visitors of a class."""
SIZE_PX = (480, 300)
"""Of the picture of an environment."""


@contextmanager
def served(folder: str, *arguments: str) -> Iterator[str]:
    """Address of the page of a ``bricksrl`` command, run in a folder until the end of this
    context."""
    words = [sys.executable, "-m", "bricksrl", *arguments]
    # our own command
    process = subprocess.Popen(  # noqa: S603
        words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
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
def tab(url: str, width: int, height: int, shows: str = "#scene") -> Iterator[Page]:
    """The page in a browser of this size, once it shows an element."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(FLAGS)
        )
        page = browser.new_context(viewport={"width": width, "height": height}).new_page()
        page.set_default_timeout(600_000)
        page.goto(url)
        page.locator(shows).last.wait_for()
        yield page
        browser.close()


def take(page: Page, path: Path) -> None:
    """Take the picture, of a robot at rest: it is drawn with all pixels."""
    page.get_by_role("button", name="Pause", exact=True).click()
    page.wait_for_timeout(4_000)
    page.screenshot(path=path)


def draw_environment(env_id: str, path: Path) -> None:
    """Draw an environment after some steps of its controller, with its goal, as films do, from the
    front if nothing is ahead."""
    if not has_arrays(env_id):
        raise BricksError(f"{env_id} has no robot to draw; give one that has")
    env = make(env_id, seed=SEED, arrays=True)
    with closing(env):
        observation, act = env.begin().observation, CONTROLLERS.get(env_id)
        body: Any = None if env.twin is None else env.twin.body
        room = Room(body, env.task.goal(observation.tolist()))
        for _ in range(STEPS if act is not None and not env.task.images else 0):
            observation = env.move(
                np.clip(
                    (act or CONTROLLERS[env_id])({"observation": observation}), -1.0, 1.0
                ).tolist()
            )
        has_wall = env.task.scene.wall_distance_mm is not None  # which would hide the robot
        room.camera.azimuth = 62.0 if has_wall else 125.0
        room.camera.distance *= 0.9 if has_wall else 0.68
        for _ in range(100):
            room.follow()
        draw(body, room.camera, path, room.decorate)


def draw(body: MujocoBody, camera: Any, path: Path, decorate: Any = None) -> None:
    """Draw a robot's world as a picture of an environment."""
    width, height = SIZE_PX
    with Renderer(body, 2 * width, 2 * height, camera, shadows=True, decorate=decorate) as renderer:
        Image.fromarray(renderer.render()).resize(SIZE_PX, Image.Resampling.LANCZOS).save(
            path, quality=82
        )


def draw_arena(env_id: str, path: Path) -> None:
    """Draw the robots of an arena at their starts."""
    task = get_arena_task(env_id)
    world = ArenaWorld(task.arena)
    world.place(np.random.default_rng(SEED))
    if task.mark is not None:
        middle = [(low + high) / 2 for low, high in task.drawn]
        world.put_marks(task.mark(torch.tensor(middle)).tolist())
    world.bodies[0].update_visuals()
    draw(world.bodies[0], "arena", path)


def take_arena(env_id: str, robot: str, path: Path) -> None:
    """Take the picture of an arena on a phone that drives one robot."""
    with served(".", "team", env_id, "--page") as url, tab(url, 390, 844) as page:
        page.locator("#facts:has-text('step')").wait_for()
        page.get_by_role("button", name=f"Drive the {robot}", exact=True).click()
        page.wait_for_timeout(4_000)
        page.screenshot(path=path)


def take_sizes(page: Page, path: Path, *, whole: bool = False) -> None:
    """Take the picture of a page at each size; ``whole`` with what is below the window."""
    for name, (width, height) in SIZES_PX.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(1_500)
        if not whole:
            # A processor in place of a graphics card draws with fewer pixels at first.
            page.wait_for_function(_HAS_ALL_PIXELS)
        page.screenshot(path=path.with_name(f"{path.name}_{name}.png"), full_page=whole)


def look_at_cards(folder: Path, only: list[str]) -> None:
    """Take the first frame of each card's page at each size."""
    for env_id in only:
        command = ("team", env_id, "--page") if env_id in ARENAS else ("play", env_id, "--page")
        with served(".", *command) as url, tab(url, 1366, 768) as page:
            page.locator("#scene[data-frames]:not([data-frames='0'])").wait_for()
            pause = page.get_by_role("button", name="Pause", exact=True)
            if pause.is_visible():
                pause.click()
            take_sizes(page, folder / env_id)


def train_class(folder: Path) -> None:
    """Train a short run of each visitor; one has films, which take longest."""
    for seed, name in enumerate(NAMES):
        words = ["train", "RunAway-v0", "--episodes", "4", "--seed", str(seed), "--name", name]
        words += ["--no-film"] if seed else []
        # our own command
        subprocess.run([sys.executable, "-m", "bricksrl", *words], cwd=folder, check=True)  # noqa: S603


def look_at_class(place: Path, folder: Path) -> None:
    """Take the start page with the runs of a class and three visitors at each size, its table, and
    the sheet of a run."""
    report = next(
        path.with_name("report.html") for path in place.glob("runs/*/before_after.mp4")
    ).resolve()
    with served(str(place), "page") as url, tab(url, 1366, 768, ".env img") as page:
        browser = page.context.browser
        others = (
            [browser.new_context().new_page() for _ in NAMES[1:]] if browser is not None else []
        )
        for name, one in zip(NAMES, (page, *others), strict=True):
            one.goto(url)
            one.locator("#own-name").fill(name)
            one.locator("#own-name").press("Enter")
        page.locator(f"#others:has-text('{NAMES[-1]}')").wait_for()
        page.get_by_role("button", name="Table of the class").click()
        page.locator(".job .chip.finished").wait_for()
        take_sizes(page, folder / "start", whole=True)
        page.goto(report.as_uri())
        page.pdf(path=folder / "sheet.pdf", prefer_css_page_size=True)


def main(session: Session) -> None:
    """Take the pictures."""
    cards = [*(env_id for env_id in list_envs() if not is_simulation(env_id)), *ARENAS]
    session.parser.add_argument(
        "--looks",
        nargs="*",
        metavar="CARD",
        help="only pictures to look at, of these cards, or of all",
    )
    looks = session.parse().looks
    if looks is not None:
        folder = session.folder / "looks"
        folder.mkdir(parents=True, exist_ok=True)
        if not looks:
            with tempfile.TemporaryDirectory() as place:
                train_class(Path(place))
                look_at_class(Path(place), folder)
        look_at_cards(folder, looks or cards)
        print(folder)
        return
    pictures = session.place_of(FOLDER)
    environments = session.place_of(ENVIRONMENTS)
    for env_id in list_envs():
        if not is_simulation(env_id):
            draw_environment(env_id, environments / f"{env_id}.jpg")
    for env_id in ARENAS:
        draw_arena(env_id, environments / f"{env_id}.jpg")
    take_arena("Tag-v0", "runner", pictures / "page_tag.png")
    with served(".", "demo", "Park-v0") as url, tab(url, 1280, 800) as page:
        page.wait_for_timeout(5_000)
        take(page, pictures / "page_goal.png")
    with served(".", "page") as url, tab(url, 1280, 800, ".env img") as page:
        page.screenshot(path=pictures / "start_page.png")
    with served(".", "demo", "Walker-v1") as url, tab(url, 1280, 800) as page:
        page.get_by_role("button", name="max", exact=True).click()
        page.wait_for_timeout(25_000)
        page.get_by_role("button", name="1x", exact=True).click()
        page.wait_for_timeout(8_000)
        take(page, pictures / "page.png")
    with served(".", "drive", "RunAway-v0") as url, tab(url, 390, 844) as page:
        page.wait_for_timeout(6_000)
        take(page, pictures / "page_phone.png")
    print(pictures)
