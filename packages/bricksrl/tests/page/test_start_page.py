"""The start page in a real browser: what a class does without a command typed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from browser import TIMEOUT_MS, chromium
from forked import Forked, ForkServer

from bricksrl.page.server import PageOptions
from bricksrl.page.start import StartPage
from bricksrl.training.config import TrainConfig

pytestmark = pytest.mark.realtime
SIX_LEGS = Path(__file__).parents[4] / "examples" / "15_six_legs.ldr"


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as started:
        yield started


@pytest.fixture
def start(forked: ForkServer, tmp_path: Path) -> Iterator[StartPage]:
    def launch(words: Sequence[str], folder: Path) -> Forked:
        read, write = os.pipe()
        with os.fdopen(write, "w") as said:
            asked = {
                "folder": str(folder),
                "environment": dict(os.environ),
                "module": "bricksrl.cli.job",
            }
            process = forked.start(words, (subprocess.PIPE, said, said), **asked)
        process.stdout = os.fdopen(read)
        return process

    with StartPage(tmp_path, PageOptions(), launch) as page:
        yield page


@contextmanager
def walk(browser: object, url: str, width: int = 1280, height: int = 800) -> Iterator[object]:
    """A tab that goes from page to page of this computer, and must show no script errors."""
    context = browser.new_context(viewport={"width": width, "height": height})
    page, errors = context.new_page(), list[str]()
    page.set_default_timeout(TIMEOUT_MS)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(url)
    yield page
    context.close()
    assert not errors


def until(page: object, condition: str) -> None:
    """Wait until JavaScript is true; the page forbids Playwright's own way, by ``eval``."""
    limit_s = time.monotonic() + TIMEOUT_MS / 1000
    while not page.evaluate(condition):
        assert time.monotonic() < limit_s, condition
        page.wait_for_timeout(100)


def button(place: object, name: str) -> object:
    return place.get_by_role("button", name=name, exact=True)


@pytest.mark.slow
def test_class_trains_plays_and_compares_without_typing(
    browser: object, start: StartPage, tmp_path: Path
) -> None:
    with walk(browser, start.url) as page:
        for number in (1, 2):
            button(page.get_by_label("RunAway-v0"), "Train").click()
            page.wait_for_selector("#scene[data-frames]")
            until(
                page,
                "document.querySelector(\"figure[data-series='return/0']\")?.dataset.count >= 2",
            )
            page.get_by_role("link", name="Start").click()
            page.locator(".job", has_text="RunAway-v0 learns").first.get_by_role(
                "button", name="End"
            ).click()
            page.locator(
                f".job:has-text('learns'):has(.chip:text-is('done')) >> nth={number - 1}"
            ).wait_for()
        assert len(list((tmp_path / "runs").iterdir())) == 2
        page.locator("#runs li").nth(1).wait_for()
        for box in page.locator("#runs input").all():
            box.check()
        button(page, "Compare").click()
        page.locator("img.result").wait_for()
        until(page, "document.querySelector('img.result').naturalWidth > 300")
        assert "RunAway-v0" in page.locator(".job[data-action=compare] pre").inner_text()
        button(page.locator("#runs li").first, "Watch").click()
        page.wait_for_selector("#scene[data-frames]")
        page.wait_for_selector("[data-fact=return]")
        page.get_by_role("link", name="Start").click()
        button(page.get_by_label("Walker-v1"), "Play").click()
        page.wait_for_selector("#scene[data-frames]")
        assert page.locator("#title").inner_text() == "Walker-v1"
        page.get_by_role("link", name="Start").click()
        page.locator(".job:has-text('is shown') .chip:text-is('done')").wait_for()


@pytest.mark.slow
def test_hub_check_and_plan_need_no_typing(browser: object, start: StartPage) -> None:
    with walk(browser, start.url, 390, 844) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.get_by_role("combobox", name="Environment").select_option("RunAway-v0")
        page.get_by_role("combobox", name="Hub").select_option("virtual")
        button(page, "Check").click()
        page.locator(".job[data-action=check] .chip:text-is('done')").wait_for()
        assert "battery" in page.locator(".job[data-action=check] pre").inner_text()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, (
            "long lines are wrapped"
        )
        button(page.locator("#build li", has_text="walker"), "Step by step in 3D").click()
        page.wait_for_selector("#scene[data-frames]")
        page.get_by_role("slider", name="Step").wait_for()


@pytest.mark.slow
def test_drawing_in_the_folder_is_looked_at_and_taught(
    browser: object, start: StartPage, tmp_path: Path
) -> None:
    shutil.copy(SIX_LEGS, tmp_path / "mine.ldr")
    (tmp_path / "broken.ldr").write_text("no plan", encoding="utf-8")
    with walk(browser, start.url) as page:
        broken = page.locator("#drawings li", has_text="broken.ldr")
        button(broken, "What can it learn?").click()
        broken.get_by_role("alert").wait_for()
        assert "broken.ldr" in broken.get_by_role("alert").inner_text()
        drawing = page.locator("#drawings li", has_text="mine.ldr")
        button(drawing, "What can it learn?").click()
        teach = button(drawing, "Teach it to walk forward")
        teach.wait_for()
        assert "left_front turns a leg" in drawing.inner_text()
        teach.click()
        page.wait_for_selector("#scene[data-frames]")
        page.get_by_role("link", name="Start").click()
        page.locator("#runs li", has_text="mine.ldr:walk").wait_for()


def test_runs_that_need_trust_are_named_with_the_command(browser: object, tmp_path: Path) -> None:
    for name in ("from a friend", "another"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        config = {
            **TrainConfig(env="RunAway-v0").to_dict(),
            "env": "their_task.py",
            "run_dir": None,
        }
        text = json.dumps({"bricksrl_run": 1, "config": config})
        (tmp_path / "runs" / name / "config.json").write_text(text)
    os.utime(tmp_path / "runs" / "another" / "config.json", (1, 1))
    with (
        StartPage(tmp_path, PageOptions(), lambda words, folder: None) as start,
        walk(browser, start.url) as page,
    ):
        page.locator("#untrusted:visible").wait_for()
        said = page.locator("#untrusted").inner_text()
        assert said == (
            "2 runs are from elsewhere and would run code: from a friend, another. Read that "
            "code, then allow it in a terminal: bricksrl trust 'runs/from a friend'"
        )
        assert not page.get_by_text("Nothing yet").is_visible()
        numbers = "import('./charts.js').then(({ short }) => [-0.001, -0, -0.2, 0.004].map(short))"
        assert page.evaluate(numbers) == ["0.00", "0", "-0.20", "0.00"], "never -0.00"


def test_jobs_end_with_the_page(start: StartPage) -> None:
    start._press("drive", "Spinning-v0")
    (job,) = start._jobs
    limit_s = time.monotonic() + 60
    while not job.url:
        assert time.monotonic() < limit_s, list(job.lines)
        time.sleep(0.05)
    start._press("play", "Spinning-v0")
    assert job.process.poll() is not None, "one robot is on the stage at a time"
    start.close()
    assert None not in [one.process.poll() for one in start._jobs]
