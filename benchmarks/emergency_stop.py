"""Time until the motors stop after an emergency stop, over Bluetooth simulated by Bumble at several
connection intervals.

    python -m benchmarks emergency_stop

Two moments: in the middle of a step, when the computer waits for the answer and only sends
keepalives; and any moment of short steps in close succession, where a write always waits for its
acknowledgement. Bluetooth lets no other write overtake it, so the stop arrives with the third
connection event at the latest. Events are counted too, since a loaded machine wakes its threads
late. Needs the packages of the extra ``dev``.
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path

from benchmarks.session import Session

sys.path.insert(0, str(Path(__file__).parents[1] / "packages/brickhub/tests"))
sys.path.insert(0, str(Path(__file__).parents[1] / "packages/brickhub/tests/hub"))
from ble_world import World  # type: ignore[import-not-found]

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from bricksrl.errors import StoppedError

INTERVALS_MS = (7.5, 15.0, 30.0, 45.0)
TRIALS = 30
MOMENTS = {"in the middle of a step": 3000, "at any moment of short steps": 10}
"""Duration of a step in milliseconds."""


def interface(step_ms: int) -> Interface:
    return Interface((RunAngle("left", -3000, 3000, 400),), (MotorAngle("left"),), Wait(step_ms))


def trial(world: World, link: HubLink, rng: random.Random) -> tuple[float, int]:
    """Milliseconds, and connection events, from the call to motors without voltage."""
    link.open()

    def step() -> None:
        try:
            while True:
                link.act([3000])
        except StoppedError:
            pass

    stepping = threading.Thread(target=step)
    stepping.start()
    world.hub.wait_until("is_driven", True)
    time.sleep(0.1 + 0.4 * rng.random())
    stopper = threading.Thread(target=link.emergency_stop)
    air = world.radio.link
    start_s, events = time.perf_counter(), air.events
    stopper.start()
    while world.hub.is_driven:
        time.sleep(0.0002)
    stop_s, events = time.perf_counter() - start_s, air.events - events
    for thread in (stopper, stepping):
        thread.join()
    link.release()
    return 1000 * stop_s, events


def main(session: Session) -> None:
    """Measure, print, and write the results."""
    trials = session.parse(trials=TRIALS).trials
    rng, results = random.Random(0), []
    for interval_ms in INTERVALS_MS:
        for moment, step_ms in MOMENTS.items():
            with tempfile.TemporaryDirectory() as folder:
                world = World(Path(folder))
                try:
                    link = world.link(interface(step_ms), timeout_s=20.0, answer_timeout_s=2.0)
                    link.open()
                    world.set_interval(interval_ms)
                    stop_ms, events = zip(
                        *(trial(world, link, rng) for _ in range(trials)), strict=True
                    )
                finally:
                    world.close()
            row = {
                "interval_ms": interval_ms,
                "moment": moment,
                "trials": trials,
                "median_ms": round(statistics.median(stop_ms), 1),
                "max_ms": round(max(stop_ms), 1),
                "median_intervals": round(statistics.median(stop_ms) / interval_ms, 2),
                "max_intervals": round(max(stop_ms) / interval_ms, 2),
                "median_events": statistics.median(events),
                "max_events": max(events),
            }
            results.append(row)
            sys.stdout.write(f"{row}\n")
    session.write({"results": results})
