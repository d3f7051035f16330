"""Programs for LEGO's package as in a tab, in a process of its own: what Pyodide has is played.

It writes a line of JSON for each of the programs: name, exit code, and what it said.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

import legoeducation  # noqa: F401  only whether it is there
from lego_programs import OWN, own

import bricktwin.site.tab.run as tab_run
from bricktwin.robots import CART
from bricktwin.twin.make_body import make_body

_LEFT_OUT = ("two devices", "waits for a color without a pause")
"""What these wait for, a person would do; the second one lets no time pass in one thread."""

_ANEW = ("legoeducation", "brickhub.virtual.virtual_transport")


class _Page:
    """A page that lets time go on as fast as it can."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def frame(self) -> None:
        """Nothing is drawn."""

    def post(self, events: str, rows: bytes) -> None:
        self.events += json.loads(events or "[]")

    def take(self) -> str:
        return ""

    def may_go_on(self, time_ms: int) -> bool:
        return True


def as_in_a_tab() -> None:
    """Let LEGO's package, imported anew, take this Python for one in a browser."""
    for name in [name for name in sys.modules if name.startswith(_ANEW)]:
        del sys.modules[name]
    # A tab has no greenlets.
    sys.modules["greenlet"] = None  # type: ignore[assignment]
    ffi = types.ModuleType("pyodide.ffi")
    for name in ("run_sync", "to_js", "create_proxy"):
        setattr(ffi, name, None)
    sys.modules["pyodide"] = types.ModuleType("pyodide")
    sys.modules["pyodide.ffi"] = ffi
    sys.modules["pyodide"].ffi = ffi  # type: ignore[attr-defined]
    sys.platform = "emscripten"


def _tell(name: str, code: int, said: str) -> None:
    sys.stdout.write(json.dumps({"name": name, "code": code, "said": said}) + "\n")
    sys.stdout.flush()


def main() -> None:
    body = make_body(CART)
    as_in_a_tab()
    tab_run.FOLDER = Path(tempfile.mkdtemp()) / "programs"
    drives = "import legoeducation as le\nm = le.DoubleMotor()\nm.connect()\n"
    drives += "m.movement_move_for_time(1000)\nprint('it drove')\n"
    programs = [(name, own(name), None) for name in OWN if name not in _LEFT_OUT]
    for name, source, robot in [*programs, ("cart", drives, body)]:
        page = _Page()
        request = {"files": {"main.py": source}, "name": "main.py", "readings": []}
        code = tab_run.run_in_tab(json.dumps(request), page, robot)
        said = "".join(event["text"] for event in page.events if event["kind"] == "err")
        printed = "".join(event["text"] for event in page.events if event["kind"] == "out")
        _tell(name, code, f"{printed}{said}")
    way_mm = body.pose().x_m * 1000
    _tell("way", 0 if way_mm > 50 else 1, f"{way_mm:.0f} mm")
    # LEGO's package, which takes this Python for one in a browser, cannot end here.
    os._exit(0)


if __name__ == "__main__":
    main()
