"""Rates of the link: lock-step and streaming over a simulated radio, and our own overhead without a
radio.

    python -m benchmarks link_rates

Takes about a minute. The hub is simulated (Bumble delivers at connection events; the generated
program runs in it), so this measures our side and the protocol; a real hub adds the radio's losses.
"""

from __future__ import annotations

import importlib
import statistics
import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.session import Session
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.protocol import Up, control_frame, data_frame, hello_payload
from brickhub.hub.transport import HubProgram
from bricksrl.envs import get_task
from bricktwin.robots import TWO_WHEELER, WALKER

TESTS = [
    str(Path(__file__).parents[1] / "packages/brickhub" / tests) for tests in ("tests", "tests/hub")
]
INTERVALS_MS = (7.5, 15.0, 30.0, 45.0)
SECONDS = 4.0
OVERHEAD_EXCHANGES = 5000


class EchoTransport:
    """A hub without radio and program that answers each frame at once, to measure our own
    overhead."""

    def __init__(self, link_wire: Any, hello: bytes) -> None:
        self._wire, self._hello = link_wire, hello
        self._out = bytearray()

    def open(self) -> None: ...

    def start(self, program: HubProgram) -> None:
        self._out += self._hello

    def write(self, data: bytes) -> None:
        seq = data[1] or data[3]  # of a data frame, or of READ
        payload = bytearray(self._wire.answer_bytes)
        struct.pack_into("<H", payload, 0, int(time.monotonic() * 1000) & 0xFFFF)
        self._out += data_frame(seq, bytes(payload))

    def read(self, timeout_s: float) -> bytes:
        data = bytes(self._out)
        self._out.clear()
        return data

    def stop(self) -> None: ...

    def close(self) -> None: ...

    def now_s(self) -> float:
        return time.monotonic()


def spread(values_ms: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(values_ms, (50, 99))
    return {"p50_ms": round(float(p50), 3), "p99_ms": round(float(p99), 3)}


def lock_step(world: Any, link: HubLink, interval_ms: float) -> dict[str, Any]:
    """Rate and round trips of consecutive readings."""
    world.set_interval(interval_ms)
    link.read()
    times_ms: list[float] = []
    start_s = time.monotonic()
    while time.monotonic() - start_s < SECONDS:
        times_ms.append(1000 * link.read().round_trip_s)
    rate_hz = len(times_ms) / (time.monotonic() - start_s)
    over_ms = statistics.median(times_ms) - 2 * interval_ms
    return {
        "rate_hz": round(rate_hz, 1),
        **spread(times_ms),
        "over_two_intervals_ms": round(over_ms, 3),
    }


def stream(world: Any, link: StreamingLink, interval_ms: float) -> dict[str, Any]:
    """Rate of steps of the Spinning task, nominally 10 Hz, and age of the observations."""
    world.set_interval(interval_ms)
    link.act([0.0, 0.0])
    start_s = time.monotonic()
    ages_ms = [1000 * link.act([10.0, -10.0]).age_s for _ in range(int(SECONDS * 10))]
    return {
        "steps_hz": round(len(ages_ms) / (time.monotonic() - start_s), 2),
        "age": spread(ages_ms),
    }


def overhead() -> dict[str, Any]:
    """Our own time for one exchange, from an action to an observation."""
    task = get_task("Walker-v0")
    probe = HubLink(EchoTransport(None, b""), WALKER, task.interface)
    hello = control_frame(Up.HELLO, hello_payload(probe.program.hash))
    link = HubLink(EchoTransport(probe.wire, hello), WALKER, task.interface)
    wall_ms, cpu_ms = [], []
    with link:
        for _ in range(OVERHEAD_EXCHANGES):
            start_s, cpu_start_s = time.perf_counter(), time.thread_time()
            link.act([-10.0, -20.0, -30.0, -40.0])
            wall_ms.append(1000 * (time.perf_counter() - start_s))
            cpu_ms.append(1000 * (time.thread_time() - cpu_start_s))
    return {"exchanges": OVERHEAD_EXCHANGES, "wall": spread(wall_ms), "cpu": spread(cpu_ms)}


def main(session: Session) -> None:
    """Measure and write."""
    session.parse()
    sys.path[:0] = TESTS
    ble_world = importlib.import_module("ble_world")
    result: dict[str, Any] = {
        "overhead_without_radio": overhead(),
        "lock_step": {},
        "streaming": {},
    }
    print(result)
    with tempfile.TemporaryDirectory() as folder:
        world = ble_world.World(Path(folder), WALKER)
        walker = get_task("Walker-v0").interface
        with world.link(walker) as link:
            for interval_ms in INTERVALS_MS:
                result["lock_step"][f"{interval_ms:g} ms"] = lock_step(world, link, interval_ms)
                print(interval_ms, result["lock_step"][f"{interval_ms:g} ms"])
        world.close()
    with tempfile.TemporaryDirectory() as folder:
        world = ble_world.World(Path(folder), TWO_WHEELER)
        streaming = StreamingLink(world.transport(), TWO_WHEELER, get_task("Spinning-v0").interface)
        world.hub.library.append(streaming.program.source)
        with streaming as link:
            for interval_ms in INTERVALS_MS:
                result["streaming"][f"{interval_ms:g} ms"] = stream(world, link, interval_ms)
                print(interval_ms, result["streaming"][f"{interval_ms:g} ms"])
        world.close()
    session.write(result)
