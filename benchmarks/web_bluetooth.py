"""A real hub from the page in Chromium, over Web Bluetooth: how long a Walker takes to learn to
walk, and drawn faults while it learns; fails at the first harmful one.

    python -m benchmarks web_bluetooth
    python -m benchmarks web_bluetooth --faults 10 --searches 0

The hub is our simulated firmware, in real time, with the Walker's twin before a wall for its body.
It is a Bluetooth peripheral of Chromium over the DevTools protocol. A person is played, who puts
the robot back when the page asks for it.

- Searches from nothing, of 35 trials: when the robot has first walked at 60 mm/s, by its own
  measure.
- Faults at drawn moments: the link is lost; writes are refused; the hub says nothing for some
  seconds; the battery falls until the hub switches off. After each one the search goes on by
  itself: the next trial that counts is waited for. A program whose link is lost ends ten seconds
  after its trial, as on a real hub, and nobody can connect before.

Takes about an hour, as it runs in real time. It needs Chromium, Playwright, Node.js and npm.
"""

from __future__ import annotations

import asyncio
import functools
import http.server
import importlib
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.session import Session
from brickhub.hub.program.generate import generate_trials
from brickhub.hub.transports.profile import Status
from bricktwin.robots import WALKER
from bricktwin.site.build import build_site
from bricktwin.site.tab.hub_lessons import HUB_LESSONS
from bricktwin.twin.make_body import make_body
from bricktwin.twin.objects import Wall
from bricktwin.twin.scene import Scene

if TYPE_CHECKING:
    from playwright.async_api import Page

ROOT = Path(__file__).parents[1]
TESTS = [
    str(ROOT / "packages" / tests)
    for tests in ("bricktwin/tests/site", "bricktwin/tests", "brickhub/tests", "brickhub/tests/hub")
]
ROOM = Scene(objects=(Wall((1400.0, -2000.0), (1400.0, 2000.0), height_mm=800.0),))
"""A wall as of a room: over a low one the sensor looks, when the Walker stands on its toes."""
GOAL_MM_S = 60.0
LONGEST_SEARCH_S = 240.0
HANG_S = 120.0
"""Time after a fault without a trial that counts, which is taken to be a hang."""
STILL_S = 3.0
"""Longest time after a fault until the motors stand: a trial of two and a half seconds."""
LOOK_S = 0.05
SAID = ("teach=status", "teach=distance", "real=facts", "real=status")
"""What is told of a hang."""
KINDS = ("lost", "refused", "silent", "battery")


class Bench:
    """A page before a hub, and the person beside them."""

    def __init__(self, page: Page, hub: Any, body: Any) -> None:
        self.page = page
        self.hub = hub
        self.body = body
        self.put_back = 0

    async def look(self) -> None:
        """Put the robot back if the page asks for it, and teach on if all trials were made."""
        if await self.page.is_visible("[data-teach=go]"):
            self.hub.by_hand.append(lambda: self.body.reset(random.Random(0)))
            await asyncio.sleep(0.5)
            # The page may have gone on meanwhile.
            if await self.page.is_visible("[data-teach=go]"):
                self.put_back += 1
                await self.page.click("[data-teach=go]")
        await asyncio.sleep(LOOK_S)

    async def trials(self) -> list[dict[str, Any]]:
        """What the curve shows of each trial that counts."""
        found: list[dict[str, Any]] = await self.page.evaluate(
            "[...document.querySelectorAll('[data-teach=curve] .dot title')]"
            ".map((title) => ({ text: title.textContent }))"
        )
        return found

    async def said(self) -> str:
        """What the page and the hub say at a hang."""
        texts = [await self.page.text_content(f"[data-{name}]") for name in SAID]
        place_mm = self.hub.body.distance_mm("E")
        texts.append(f"runs: {self.hub.is_running}, sees {place_mm} mm")
        return " | ".join(text or "" for text in texts)

    async def is_learning(self) -> bool:
        return await self.page.text_content("#state") == "learning"


async def searched(bench: Bench) -> dict[str, Any]:
    """A search from nothing."""
    page = bench.page
    if await page.is_enabled("[data-teach=again]"):
        await page.click("[data-teach=again]")
    before = bench.put_back
    begin_s = time.monotonic()
    await page.click("[data-teach=learn]")
    reached_s = None
    best = 0.0
    while time.monotonic() - begin_s < LONGEST_SEARCH_S and await bench.is_learning():
        await bench.look()
        speeds = [speed_of(trial["text"]) for trial in await bench.trials()]
        best = max([best, *speeds])
        if reached_s is None and best >= GOAL_MM_S:
            reached_s = round(time.monotonic() - begin_s, 1)
    return {
        "goal_reached_s": reached_s,
        "wall_s": round(time.monotonic() - begin_s, 1),
        "trials": len(await bench.trials()),
        "best_mm_s": best,
        "put_back": bench.put_back - before,
    }


def speed_of(text: str) -> float:
    """Speed of a trial, mm/s, of the words of its dot, such as ``try 3: 57 mm/s``."""
    words = text.rsplit(": ", maxsplit=1)[-1].split()
    return float(words[0]) if words[-1] == "mm/s" else 0.0


async def faulty(bench: Bench, faults: int, seed: int) -> dict[str, Any]:
    """Faults while the robot learns."""
    rng = random.Random(seed)
    kinds: Counter[str] = Counter()
    recovered_s: list[float] = []
    still_s: list[float] = []
    for number in range(faults):
        await _learning(bench)
        begin_s = time.monotonic()
        pause_s = rng.uniform(0.0, 5.0)
        while time.monotonic() - begin_s < pause_s:
            await bench.look()
        kind = rng.choice(KINDS)
        kinds[kind] += 1
        fault_s = time.monotonic()
        driven = await _happen(bench, kind, rng)
        count = len(await bench.trials())
        while len(await bench.trials()) <= count:
            await _learning(bench)
            if time.monotonic() - fault_s > HANG_S:
                said = await bench.said()
                raise AssertionError(f"fault {number}, {kind}: nothing goes on ({said})")
        recovered_s.append(time.monotonic() - fault_s)
        if driven is not None:
            still_s.append(await driven)
            assert still_s[-1] < STILL_S, f"fault {number}, {kind}: driven for {still_s[-1]} s"
        print(f"{number}: {kind}, {recovered_s[-1]:.1f} s", flush=True)
    return {
        "faults": dict(sorted(kinds.items())),
        "hangs": 0,
        "longest_until_it_goes_on_s": round(max(recovered_s), 1),
        "longest_until_motors_stand_s": round(max(still_s, default=0.0), 2),
        "connections": bench.hub.connections,
        "put_back": bench.put_back,
    }


async def _learning(bench: Bench) -> None:
    """Look, and teach on if the page has ended: all trials were made, or the link was given up."""
    await bench.look()
    if await bench.is_learning():
        return
    page = bench.page
    if await page.is_visible("[data-real=again]"):
        await page.click("[data-real=again]")
        await asyncio.sleep(1.0)
    elif await page.is_enabled("[data-teach=learn]"):
        await page.click("[data-teach=learn]")


async def _happen(bench: Bench, kind: str, rng: random.Random) -> asyncio.Task[float] | None:
    """Let a fault happen; returns what measures how long the motors go on, if the link is lost."""
    hub = bench.hub
    if kind == "lost":
        return await _lose(hub)
    if kind == "refused":
        hub.refusals = rng.randint(1, 12)
    elif kind == "silent":
        hub.is_silent = True
        end_s = time.monotonic() + rng.uniform(0.5, 8.0)
        while time.monotonic() < end_s:
            await bench.look()
        hub.is_silent = False
    else:
        for flag in (Status.BATTERY_LOW, Status.BATTERY_EMPTY, Status.SHUTDOWN_REQUESTED):
            hub.battery = flag
            await asyncio.sleep(0.6)
        # It switches off, and somebody switches it on again with a fresh battery.
        hub.press_button()
        hub.battery = Status(0)
        return await _lose(hub)
    return None


async def _lose(hub: Any) -> asyncio.Task[float]:
    still = asyncio.create_task(_still_s(hub, hub.connections))
    await hub.lose()
    return still


async def _still_s(hub: Any, connections: int) -> float:
    """Time from now to the last moment at which a motor is driven, until the next connection."""
    begin_s = driven_s = time.monotonic()
    while hub.connections == connections:
        if hub.is_driven:
            driven_s = time.monotonic()
        await asyncio.sleep(0.02)
    return driven_s - begin_s


@contextmanager
def site() -> Iterator[str]:
    """Address of a site with the Walker."""
    with tempfile.TemporaryDirectory() as folder:
        build_site(Path(folder) / "site", (WALKER,), worlds=())
        handler = functools.partial(_Files, directory=f"{folder}/site")
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        server.server_close()


class _Files(http.server.SimpleHTTPRequestHandler):
    """A plain file server."""

    def log_message(self, *arguments: object) -> None:
        """Quiet."""


async def measured(address: str, searches: int, faults: int, seed: int) -> dict[str, Any]:
    """Results of searches, and of faults."""
    emulated = importlib.import_module("emulated_hub")
    body = make_body(WALKER, scene=ROOM)
    hub = emulated.EmulatedHub(WALKER, body)
    lesson = HUB_LESSONS["walk"](WALKER).lesson
    structure = lesson.structure
    program = generate_trials(WALKER, lesson.interface, structure.numbers, structure.hub_source())
    hub.library.append(program.source)
    result: dict[str, Any] = {}
    async with emulated.page_with(hub, address) as page:
        await page.select_option("#robot", "walker")
        await emulated.connect(page)
        await page.click("#teach-it")
        bench = Bench(page, hub, body)
        if searches:
            result["searches"] = [await searched(bench) for _ in range(searches)]
            print(result["searches"], flush=True)
        if faults:
            result["faulty"] = await faulty(bench, faults, seed)
            print(result["faulty"], flush=True)
    return result


def main(session: Session) -> None:
    """Measure, and write the result."""
    args = session.parse(searches=5, faults=100, seed=0)
    sys.path[:0] = TESTS
    start_s = time.monotonic()
    with site() as address:
        found = asyncio.run(measured(address, args.searches, args.faults, args.seed))
    session.write({"seed": args.seed, **found, "wall_s": round(time.monotonic() - start_s)})
