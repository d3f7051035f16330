"""Hundreds of programs print in a tab what they print in a terminal."""

from __future__ import annotations

import io
import json
import re
import shutil
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

import any_browser
import pytest
from browser import TIMEOUT_MS
from in_page import open_program, run_program
from test_in_browser import DATA, firmware_programs

from brickhub.hub.program.program_files import ProgramFiles
from brickhub.virtual.run import run_file

if TYPE_CHECKING:
    from conftest import Site
    from playwright.sync_api import Browser

_LEAST = 300
_HEAD = "".join(
    f"from pybricks.{name} import *\n"
    for name in ("pupdevices", "parameters", "tools", "robotics", "iodevices", "messaging", "hubs")
)


def short_programs() -> list[dict[str, str]]:
    """Those of the documented methods and of the drives, which need nobody beside them."""
    programs = []
    needs_somebody = False
    for line in (DATA / "api_programs.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            section = line.strip("[]")
            needs_somebody = section not in ("motor", "tools", "parameters", "language")
        elif line and not needs_somebody:
            source = line.partition("  =>")[0].replace("|", "\n").replace("\n=", "|=")
            programs.append({"main.py": f"{_HEAD}hub = PrimeHub()\n{source}\n"})
    drives = (DATA / "firmware_drives.txt").read_text(encoding="utf-8")
    for body in drives.split("===\n")[1:]:
        lines = re.findall(r"(?m)^> (.*)$", body)
        programs.append({"main.py": f"{_HEAD}s = StopWatch()\n" + "\n".join(lines) + "\n"})
    return programs


def moves() -> list[dict[str, str]]:
    """The firmware's moves, of many angles and speeds."""
    programs = []
    for speed in (100, 250, 400, 600, 900):
        for angle in (-200, -90, -7, 5, 30, 100, 360):
            source = (
                "m = Motor(Port.A)\nwatch = StopWatch()\n"
                f"m.run_angle({speed}, {angle})\nprint(watch.time(), m.angle(), m.speed())\n"
            )
            programs.append({"main.py": _HEAD + source})
    return programs


def expected(files: dict[str, str], folder: Path) -> list[object]:
    """Exit code, output and errors of a program on this computer."""
    for name, source in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(source, encoding="utf-8")
    out, err = io.BytesIO(), io.StringIO()
    # As the command does, which saves the files that a program prints.
    with closing(ProgramFiles(out, folder, lambda _: None)) as files_out:
        printed = cast("BinaryIO", files_out)
        code = run_file(folder / "main.py", stdout=printed, stderr=err, time_limit_s=600)
    return [code, out.getvalue().decode("latin-1"), err.getvalue()]


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("browser_name", "count"),
    [("chromium", _LEAST), ("firefox", 50), ("webkit", 50)],
)
def test_programs_print_the_same_in_each_browser(
    site: Site, browser_name: str, count: int, tmp_path: Path
) -> None:
    """And the page itself runs its first example there, on a robot."""
    programs = firmware_programs() + short_programs() + moves()
    assert len(programs) >= _LEAST
    step = len(programs) // count
    programs = programs[::step]
    for name in ("run_programs.html", "run_programs.js"):
        shutil.copy(Path(__file__).with_name(name), site.folder)
    (site.folder / "programs_to_run.json").write_text(json.dumps(programs), encoding="utf-8")
    while not site.told.empty():
        site.told.get()
    with any_browser.opened(browser_name, f"{site.address}run_programs.html", tmp_path / "profile"):
        told = site.told.get(timeout=1800)
    assert "failed" not in told, told["failed"]
    assert told["isIsolated"]
    assert told["visited"]["state"] == "running"
    # Firefox has no WebGL on a computer without a screen.
    assert told["visited"]["isDrawn"] or browser_name == "firefox"
    assert len(told["answers"]) >= count
    different = []
    for number, (files, answer) in enumerate(zip(programs, told["answers"], strict=True)):
        if answer != expected(files, tmp_path / str(number)):
            different.append((files, answer))
    assert different == []


@pytest.mark.slow
def test_without_shared_memory_a_run_is_shown_in_time(address: str, browser: Browser) -> None:
    """As of http without encryption, where browsers allow no service worker: a stop ends the
    worker, and the next one stands ready."""
    context = browser.new_context(service_workers="block")
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.goto(address)
    page.wait_for_selector("#state.running")
    assert page.evaluate("crossOriginIsolated") is False
    assert "no way into a running program" in (page.text_content("#note") or "")
    page.click("#stop")
    page.select_option("#robot", "bench")
    page.wait_for_selector("#state.ready, #state.stopped")
    assert run_program(page, "print('there')\n")[1] == "there\n"
    open_program(page, "while True:\n    pass\n")
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.click("#stop")
    page.wait_for_selector("#state.stopped, #state.ready")
    assert run_program(page, "print('still here')\n")[1] == "still here\n"
    context.close()
