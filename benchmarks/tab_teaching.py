"""Robots that learn to walk in a browser tab: how fast, at what cost beside this computer's own
Python, and how long a pupil waits.

    python -m benchmarks tab_teaching
    python -m benchmarks tab_teaching --seeds 2 --walkers klann_legs --visitors 1

What the page's *Teach it to walk* does: 35 trials of two and a half seconds, of a policy search for
each seed.

- The Walker searches in a tab's worker (Pyodide and MuJoCo's JavaScript build in Node.js), and on
  this computer by the same modules (CPython and Python's MuJoCo), one after the other. The best
  score is compared with that of the trot that people write by hand, at the same place; CPU time of
  all searches with each other.
- The walkers of ``examples/walkers``, whose legs are of other kinds, search in the tab's worker.
- In Chromium, from the press of *Teach* to the last trial: wall time. The page draws meanwhile, by
  the processor, as computers without a screen have no graphics card.

Takes about a quarter of an hour. It needs Chromium, Playwright, Node.js and npm.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.session import Session
from benchmarks.tab_page import FLAGS, SIZE, TIMEOUT_MS, plain_server
from benchmarks.tab_physics import ROOT, Engines, by_robot
from bricktwin.robots import WALKER
from bricktwin.robots.planned import robot_of_plan
from bricktwin.site.build import build_site
from bricktwin.site.robot_files import robot_file
from bricktwin.twin.scene import Scene

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

FOLDER = ROOT / "examples" / "walkers"
TRIALS = 35
"""Trials of a search, as on the page."""
TROT = (-0.9, 180.0)
"""Numbers of the trot, whose legs turn as fast as its motors bear."""
BEGUN = {"files": {"main.py": ""}, "current": "main.py", "robot": "walker", "world": ""}
"""What the page knows of its visitor: without an example that runs at once."""


def best_of(search: dict[str, Any]) -> float:
    """Best score of a search, mm/s."""
    scores: list[float] = [score for score in search["scores"] if score is not None]
    return max(scores)


def searches(
    engines: Engines,
    place: str,
    seeds: int,
) -> dict[str, Any]:
    """Searches of the Walker at a place, beside its trot there."""
    asked = {"robots": ["walker"], "duration_s": 1.0}
    (trot,) = engines.moved(place, starts=[0], trials=1, numbers=TROT, **asked)
    made = engines.moved(place, starts=list(range(seeds)), trials=TRIALS, **asked)
    best = [best_of(one) for one in made]
    return {
        "trot_mm_s": round(best_of(trot), 1),
        "best_mm_s": [round(speed, 1) for speed in best],
        "of_the_trot": [round(speed / best_of(trot), 3) for speed in best],
        "least_of_the_trot": round(min(best) / best_of(trot), 3),
        "robot_s": [one["robot_s"] for one in made],
        "cpu_s": [round(one["cpu_s"], 2) for one in made],
    }


def walkers(
    engines: Engines,
    names: list[str],
    seeds: int,
) -> dict[str, Any]:
    """Best speeds of walkers in the tab."""
    if not names:
        return {}
    starts = list(range(seeds))
    made = engines.moved("tab", robots=names, starts=starts, trials=TRIALS, duration_s=1.0)
    found = {}
    for name, own in by_robot(made).items():
        best = [round(best_of(one), 1) for one in own]
        falls = sum(one["scores"].count(None) for one in own)
        found[name] = {"least_mm_s": min(best), "best_mm_s": best, "falls": falls}
    return found


def opened(browser: Browser, address: str) -> Page:
    """A page with the Walker, and Python at work."""
    page = browser.new_context(viewport=SIZE).new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.add_init_script(f"localStorage['bricks-programs'] ??= {json.dumps(json.dumps(BEGUN))}")
    page.goto(address)
    page.wait_for_selector("#state.ready")
    return page


def taught(browser: Browser, address: str) -> dict[str, float]:
    """How long a visitor waits until the robot has made all trials, and what it has learned."""
    page = opened(browser, address)
    started_s = time.monotonic()
    page.click("#teach-it")
    page.wait_for_selector("#state.learning")
    page.wait_for_selector("#state.finished")
    wall_s = time.monotonic() - started_s
    said = page.text_content("[data-teach=status]") or ""
    page.context.close()
    words = said.removeprefix("It has learned: ").split()
    return {"wall_s": round(wall_s, 1), "mm_s": float(words[0])}


def visited(visitors: int) -> dict[str, Any]:
    """Waits of visitors in Chromium."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory(prefix="tab-teaching-") as name, sync_playwright() as started:
        folder = Path(name) / "site"
        build_site(folder, (WALKER,), worlds=())
        path = shutil.which("chromium")
        browser = started.chromium.launch(executable_path=path, args=list(FLAGS))
        with plain_server(folder) as address:
            each = [taught(browser, address) for _ in range(visitors)]
        version = browser.version
        browser.close()
    return {
        "browser": version,
        "median_wall_s": statistics.median(one["wall_s"] for one in each),
        "each": each,
    }


def main(session: Session) -> None:
    """Measure, and write the result."""
    plans = {plan.stem: plan for plan in sorted(FOLDER.glob("*.ldr"))}
    args = session.parse(seeds=10, walkers=list(plans), walker_seeds=3, visitors=3)
    result: dict[str, Any] = {"trials": TRIALS}
    with tempfile.TemporaryDirectory(prefix="tab-teaching-") as name:
        folder = Path(name)
        robots = {name: robot_of_plan(str(plans[name]), name) for name in args.walkers}
        for robot, description in {"walker": WALKER, **robots}.items():
            file = robot_file(description, Scene())
            (folder / f"{robot}.json").write_text(json.dumps(file), encoding="utf-8")
        engines = Engines(folder)
        # One after the other, so that what else this computer does troubles both alike.
        for key, place in (("tab", "tab"), ("native", "ours")):
            result[key] = searches(engines, place, args.seeds)
            print(key, result[key], flush=True)
        spent_s = [sum(result[key]["cpu_s"]) for key in ("tab", "native")]
        result["cpu_times"] = round(spent_s[0] / spent_s[1], 2)
        result["walkers"] = walkers(engines, args.walkers, args.walker_seeds)
        print(result["cpu_times"], result["walkers"], flush=True)
    if args.visitors:
        result["chromium"] = visited(args.visitors)
        print(result["chromium"], flush=True)
    result["load_average"] = round(os.getloadavg()[0], 2)
    session.write(result)
