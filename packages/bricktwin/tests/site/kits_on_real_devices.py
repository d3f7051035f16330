"""Programs for LEGO's package on devices of a page, in a process of its own: what Pyodide and the
page have is played, and behind the page are virtual devices.

It writes a line of JSON for each of the programs: name, exit code, what it said, and what the page
was asked.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import legoeducation  # noqa: F401  only whether it is there
from kits_in_one_thread import as_in_a_tab

from brickhub.kits.virtual_kit import VirtualKit
from bricktwin.robots import CART
from bricktwin.twin.make_body import make_body

DRIVES = """
import time
import legoeducation as le
m = le.DoubleMotor()
m.connect()
m.movement_move_for_time(500)
print('it drove')
light = le.ColorSensor()
light.connect()
time.sleep(0.2)
print(light.sensor.reflection > 50)
m.movement_move()
"""
PROGRAMS = {
    "drives": DRIVES,
    "nobody chooses": "import legoeducation as le\nc = le.SingleMotor()\nc.connect()\n"
    "print(c.connected)\n",
    "fails": "import legoeducation as le\n1 / 0\n",
    "is stopped": "import time\nimport legoeducation as le\nm = le.DoubleMotor()\nm.connect()\n"
    "m.movement_move()\nwhile True:\n    time.sleep(0.05)\n",
}
_STOP_AFTER = 40
"""Waits until somebody presses Stop."""


class KitPage:
    """A page with virtual devices; they live while Python waits."""

    def __init__(self, stops: bool) -> None:
        self.kit = VirtualKit(make_body(CART))
        self.asked: list[str] = []
        self.events: list[dict[str, Any]] = []
        self._stops = stops
        self._waits = 0
        self._messages: list[dict[str, Any]] = []

    def ask_kit(
        self, number: int, operation: str, device: int, characteristic: str, data: str
    ) -> None:
        self.asked.append(operation)
        answer = {"kind": "answer", "number": number}
        peers = self.kit.peers
        if operation == "choose":
            answer.update(self._choose(json.loads(data)))
        elif operation == "connect":

            def notify(_: object, packet: bytes) -> None:
                event = {"kind": "event", "device": device, "data": packet.hex()}
                self._messages.append(event)

            peers[device].connect(notify, lambda: None)
        elif operation == "send":
            peers[device].send(bytes.fromhex(data))
        elif operation == "close":
            # What was sent before is done.
            for _ in range(100):
                self._live()
            peers[device].disconnect()
        self._messages.append(answer)

    def _choose(self, asked: dict[str, Any]) -> dict[str, Any]:
        for number, peer in enumerate(self.kit.peers):
            if peer.name == asked["title"]:
                return {"device": number, "name": peer.name, "id": f"id {number}"}
        return {"error": "NotFoundError", "message": "User cancelled"}

    def _live(self) -> None:
        for notify, packet in self.kit.step():
            notify(None, packet)

    def take(self) -> str:
        messages = self._messages
        self._messages = []
        return json.dumps(messages) if messages else ""

    def wait(self, longest_ms: float) -> None:
        self._waits += 1
        if self._stops and self._waits == _STOP_AFTER:
            self._messages.append({"kind": "stop"})
        self._live()

    # ---- as Python sees the page

    def frame(self) -> None:
        raise AssertionError("nobody films real devices")

    def post(self, events: str, rows: bytes) -> None:
        self.events += json.loads(events or "[]")

    def text(self, *kinds: str) -> str:
        return "".join(event["text"] for event in self.events if event["kind"] in kinds)


def main() -> None:
    as_in_a_tab()
    from bricktwin.site.tab import real_kit, run

    folder = Path(tempfile.mkdtemp()) / "programs"
    run.FOLDER = real_kit.FOLDER = folder
    for name, source in PROGRAMS.items():
        page = KitPage("stopped" in name)
        request = {"files": {"main.py": source}, "name": "main.py"}
        code = real_kit.run_on_kit(json.dumps(request), page, page)
        told = {
            "name": name,
            "code": code,
            "said": page.text("out", "err"),
            "asked": page.asked,
            "stops": [event["stop"] for event in page.events if event["kind"] == "kit"],
            "voltages": [servo.voltage_mv for servo in page.kit.machine.servos.values()],
        }
        sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()
    # LEGO's package, which takes this Python for one in a browser, cannot end here.
    os._exit(0)


if __name__ == "__main__":
    main()
