"""Memory of the live page over ten minutes: of the process that plays and serves, and of a browser
tab.

    python -m benchmarks page_memory --minutes 10

A Walker plays in real time on a page that a headless Chromium shows. Resident memory and the tab's
heap (after a garbage collection) are read every half minute; growth is the slope of a line through
them without the first two minutes.
"""

from __future__ import annotations

import contextlib
import resource
import shutil
import sys
import threading
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import bricksrl
from benchmarks.session import Session
from bricksrl.errors import StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import play_on_page
from bricksrl.policies.policy import random_player

FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
WARM_S = 120.0


def resident_mb() -> float:
    """Resident memory of this process."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(
            line
            for line in status.read_text(encoding="utf-8").splitlines()
            if line.startswith("VmRSS")
        )
        return float(line.split()[1]) / 1024
    return (
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        / 1024
        / (1024 if sys.platform == "darwin" else 1)
    )


def main(session: Session) -> None:
    args = session.parse(minutes=10.0, env="Walker-v1")
    env, stop = bricksrl.make(args.env, seed=0), threading.Event()
    page = LivePage(args.env, task=env.task, policies=("random",), speed="1x")
    rows: list[tuple[float, float, float, int]] = []

    def look() -> None:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=list(FLAGS)
            )
            tab = browser.new_page(viewport={"width": 800, "height": 600})
            tab.goto(page.url)
            tab.wait_for_selector("#scene[data-frames]", timeout=120_000)
            session, start_s = tab.context.new_cdp_session(tab), time.monotonic()
            while (now_s := time.monotonic() - start_s) < 60 * args.minutes:
                session.send("HeapProfiler.collectGarbage")
                heap = session.send("Runtime.getHeapUsage")["usedSize"] / 1e6
                frames = int(tab.evaluate("document.querySelector('#scene').dataset.frames"))
                rows.append((now_s, resident_mb(), heap, frames))
                time.sleep(min(30.0, 6 * args.minutes))
            browser.close()
        stop.set()
        env.stop()

    with page:
        thread = threading.Thread(target=look, daemon=True)
        thread.start()
        with contextlib.suppress(StoppedError):
            play_on_page(env, page, {"random": lambda: random_player(env, 0)}, stop=stop)
        thread.join(60)
    table = np.array(rows)
    late = table[table[:, 0] > min(WARM_S, 12 * args.minutes)]
    slopes = {
        name: float(np.polyfit(late[:, 0] / 60, late[:, column], 1)[0])
        for name, column in (("process", 1), ("tab_heap", 2))
    }
    results = {
        "minutes": args.minutes,
        "frames_per_s": round(
            float((table[-1, 3] - table[0, 3]) / (table[-1, 0] - table[0, 0])), 2
        ),
        "process_mb": [round(value, 1) for value in table[:, 1].tolist()],
        "tab_heap_mb": [round(value, 2) for value in table[:, 2].tolist()],
        "growth_mb_per_minute": {name: round(value, 3) for name, value in slopes.items()},
    }
    print(results)
    session.write(results)
