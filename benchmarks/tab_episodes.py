"""Episodes of a hub program that acts by itself, in a tab's worker: what it prints, and where the
robot was then. A script, for :mod:`benchmarks.tab_policies`.

ASKED is a file of JSON: ``file`` (path of the robot's file), ``program`` (path), ``starts``
(seeds), ``on_ms`` (how long the hub has been on, of each start) and ``lines`` of an episode. It
prints a line of JSON for each start.
"""

import json
import sys
from pathlib import Path
from typing import Any

from bricktwin.site.tab.mpy_cross import put_in_place

# Before all that imports it; a worker gives these to a script.
put_in_place(globals()["compile_in_tab"])

from brickhub.virtual.interpreter import execute  # noqa: E402
from brickhub.virtual.machine import Machine  # noqa: E402
from brickhub.virtual.micropython.exceptions import HostStop  # noqa: E402
from brickhub.virtual.pybricks import modules  # noqa: E402
from bricktwin.site.tab.js_engine import JsEngine  # noqa: E402
from bricktwin.site.tab.robot_file import body_of  # noqa: E402
from bricktwin.twin.body import TwinBody  # noqa: E402


class Over(HostStop):
    """The episode has as many lines as were asked for."""


class Console:
    """Keeps each printed line, with the time and the pose of its moment."""

    def __init__(
        self,
        machine: Machine,
        body: TwinBody,
        count: int,
    ) -> None:
        self._machine = machine
        self._body = body
        self._count = count
        self._line = b""
        self.inbox = bytearray()
        self.lines: list[dict[str, Any]] = []

    def available(self) -> int:
        return 0

    def read(self, n: int) -> bytes:
        raise EOFError("nobody types")

    def write_app_data(self, data: bytes) -> None:
        """Discard it."""

    def write(self, data: bytes) -> None:
        *lines, self._line = (self._line + data).split(b"\r\n")
        for line in lines:
            pose = self._body.pose()
            self.lines.append(
                {
                    "printed": line.decode(),
                    "ms": self._machine.body_ms,
                    "pose": [pose.x_m, pose.y_m, pose.heading_deg],
                }
            )
            if len(self.lines) == self._count:
                raise Over


def main(path: str) -> None:
    """Play the episodes that are asked for."""
    asked = json.loads(Path(path).read_text(encoding="utf-8"))
    text = Path(asked["file"]).read_text(encoding="utf-8")
    source = Path(asked["program"]).read_text(encoding="utf-8")
    for start, on_ms in zip(asked["starts"], asked["on_ms"], strict=True):
        # A body stands on an engine of its own, as in each run of the tab.
        engine = JsEngine(globals()["start_engine"](text))
        body = body_of(json.loads(text), engine, seed=start)
        machine = Machine(body)
        machine.advance(on_ms)
        console = Console(machine, body, asked["lines"])
        try:
            execute(source, "main.py", modules(machine, console), console)
        except Over:
            pass
        finally:
            machine.stop_motors()
        engine.end()
        sys.stdout.write(json.dumps({"start": start, "lines": console.lines}) + "\n")


if __name__ == "__main__":
    main((globals().get("ARGUMENTS") or sys.argv[1:])[0])
