"""Record of a run for the page: what moved, was shown and was printed, each with its time."""

import json
import math
import time
from array import array
from typing import Any, Protocol

from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel

FRAME_MS = 20
"""Simulated time from one frame to the next; a multiple of the control loop's."""
PORTS = "ABCDEF"
_POST_S = 0.015
"""Real time between two posts: a picture of the screen."""
_MAX_EVENTS = 500
_STREAMS = ("out", "err")


class Page(Protocol):
    """What goes to the page of a tab, and comes from it while a program runs."""

    def frame(self) -> None:
        """Keep the poses of the robot's bodies as they are now, beside the frame that is made."""

    def post(self, events: str, rows: bytes) -> None:
        """Send what has happened: a JSON list of events, and the rows of ``Recorder``."""

    def take(self) -> str:
        """What has come since the last call: a JSON list of messages, empty for none."""

    def may_go_on(self, time_ms: int) -> bool:
        """Whether the page has reached a simulated time; waits a little until it has, or a message
        comes."""


class Recorder:
    """Frames and events of a run, on their way to the page.

    A frame is a row of 32-bit numbers: simulated time (ms), the angle of the motor on each port
    (deg; not a number where there is none), the heading (deg). The page adds the poses of the
    robot's bodies, which it has without Python.

    Args:
        page: receives them.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._frames = array("f")
        self._events: list[dict[str, Any]] = []
        self._posted_s = time.monotonic()
        self._machine: Machine | None = None
        self._device_count = 0

    def begin(self, machine: Machine) -> None:
        """Take the machine whose run is recorded."""
        self._machine = machine
        machine.panel.on_change = self._show
        self.frame()

    def tell(self, kind: str, **values: Any) -> None:
        """Add an event."""
        time_ms = 0 if self._machine is None else self._machine.time_ms
        event = {"kind": kind, "ms": time_ms, **values}
        # One print is many pieces of output.
        last = self._events[-1] if self._events else {}
        is_next_piece = kind in _STREAMS and last.get("kind") == kind and last["ms"] == time_ms
        if is_next_piece:
            last["text"] += event["text"]
            return
        self._events.append(event)
        # A program that prints without end fills memory else.
        if len(self._events) >= _MAX_EVENTS:
            self.post()

    def frame(self) -> None:
        """Add how things are now, and post what has gathered if it is time for it."""
        machine = self._machine
        if machine is None:
            return
        body = machine.body
        row = [float(machine.time_ms)]
        for port in PORTS:
            is_motor = port in machine.servos
            row.append(body.angle_mdeg(port) / 1000 if is_motor else math.nan)
        row.append(body.heading_deg())
        self._frames.extend(row)
        self._page.frame()
        self._tell_devices(machine)
        self.post_in_time()

    def post_in_time(self) -> None:
        """Send what has gathered to the page, if it is time for it."""
        if time.monotonic() - self._posted_s >= _POST_S:
            self.post()

    def post(self) -> None:
        """Send what has gathered to the page."""
        self._posted_s = time.monotonic()
        if not (self._events or self._frames):
            return
        events = json.dumps(self._events) if self._events else ""
        frames = self._frames.tobytes()
        self._events = []
        self._frames = array("f")
        self._page.post(events, frames)

    def _tell_devices(self, machine: Machine) -> None:
        """Say what a program has plugged into the bench since the last frame."""
        bench = machine.body
        if not isinstance(bench, FittedBench):
            return
        devices = {}
        for port in machine.robot.hub.model.ports:
            device = bench.device(port)
            if device is not None:
                devices[port] = device
        if len(devices) != self._device_count:
            self._device_count = len(devices)
            self.tell("devices", devices=devices)

    def _show(self, panel: Panel) -> None:
        self.tell(
            "panel",
            light=panel.light,
            display=panel.display,
            text=panel.text,
            turns=panel.quarter_turns,
            hz=panel.sound_hz,
            lamps=panel.lamps,
            screen=panel.packed_screen(),
        )
