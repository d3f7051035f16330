"""Programs for LEGO's kits of 2026 in a tab, without a browser: LEGO's unmodified package and
virtual devices in one thread."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.errors import HubTimeoutError, MediumUnavailableError
from bricktwin.robots import CART
from bricktwin.site.houses import kit_package
from bricktwin.site.robots import write_robots
from bricktwin.site.tab.kit_in_tab import _WorldLoop, waiting_by
from bricktwin.site.tab.run import is_for_kits
from bricktwin.worlds import world

KITS = Path(__file__).parents[3] / "brickhub" / "tests" / "kits"
SCRIPT = Path(__file__).with_name("kits_in_one_thread.py")


def test_programs_run_in_one_thread_and_drive_the_cart() -> None:
    pytest.importorskip("legoeducation")
    done = subprocess.run(
        [sys.executable, str(SCRIPT)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(KITS)},
    )
    ran = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(ran) == 8
    assert [one for one in ran if one["code"] or "Traceback" in one["said"]] == []


def test_the_package_is_copied_with_its_licence() -> None:
    pytest.importorskip("legoeducation")
    names = zipfile.ZipFile(BytesIO(kit_package())).namelist()
    assert "legoeducation/__init__.py" in names
    assert any(name.endswith("LICENSE") for name in names)


def test_without_the_package_the_command_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "legoeducation", None)
    with pytest.raises(MediumUnavailableError, match="BUSL-1.1, permits non-commercial use"):
        kit_package()


def test_the_cart_is_offered_what_it_can_be_put_into(tmp_path: Path) -> None:
    """It has no ultrasonic sensor, by which robots are put before a wall."""
    worlds = {name: world(name) for name in ("wall", "line-simple")}
    (cart,) = write_robots(tmp_path, (CART,), worlds, {})
    assert [one["name"] for one in cart["worlds"]] == ["open floor", "line-simple"]
    assert cart["title"] == "Cart"


def test_which_programs_are_for_kits() -> None:
    assert is_for_kits("import legoeducation as le\n")
    assert not is_for_kits("from pybricks.hubs import PrimeHub\n")
    assert not is_for_kits("no program (\n")


class Devices:
    """Virtual devices whose world goes on by a tenth of a second in each step."""

    limit_s: float | None = None

    def __init__(self, *arrivals: list[Any]) -> None:
        self.arrivals = list(arrivals)
        self.steps = 0
        self.looks = 0

    def now_s(self) -> float:
        self.looks += 1
        assert self.looks < 20_000, "time stands still"
        return self.steps / 10

    def step(self) -> list[Any]:
        self.steps += 1
        return self.arrivals.pop(0) if self.arrivals else []


def test_a_loop_waits_in_the_time_of_its_devices() -> None:
    letters: list[Any] = []

    async def notify(_sender: object, packet: bytes) -> None:
        letters.append((devices.now_s(), packet))

    async def program() -> float:
        await asyncio.sleep(1.0)
        return devices.now_s()

    devices = Devices([], [(notify, b"hello")], [], [(notify, b"again")])
    loop = _WorldLoop(devices)  # type: ignore[arg-type]
    try:
        # It wakes up when its time has come, though something arrives meanwhile.
        assert loop.run_until_complete(program()) == pytest.approx(1.0)
        assert letters == [(pytest.approx(0.2), b"hello"), (pytest.approx(0.4), b"again")]
        # What arrives ends a wait for anything, and so does a time that is over.
        assert loop.select(0.35) == [] and devices.now_s() == pytest.approx(1.4)
        devices.arrivals = [[], [], [(notify, b"late")]]
        assert loop.select(None) == [(notify, b"late")] and devices.now_s() == pytest.approx(1.7)
        assert loop.select(0.0) == [] and devices.now_s() == pytest.approx(1.7)
        devices.limit_s = 2.0
        with pytest.raises(HubTimeoutError, match="the time limit of the program is over"):
            loop.select(None)
        assert devices.now_s() == pytest.approx(2.0)
        devices.limit_s, devices.steps = None, 0
        assert loop.select(None) == [] and 10 < devices.now_s() < 1000
    finally:
        loop.close()


def test_what_waits_for_the_browser_waits_for_this_loop_instead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ffi = SimpleNamespace(run_sync="the browser")
    monkeypatch.setitem(sys.modules, "pyodide.ffi", ffi)

    def fail() -> None:
        with waiting_by(lambda _task: 3):
            assert ffi.run_sync("anything") == 3
            raise ValueError("as it was")

    with pytest.raises(ValueError, match="as it was"):
        fail()
    assert ffi.run_sync == "the browser"
