"""Programs for LEGO's kits of 2026 in a tab, without a browser: LEGO's unmodified package and
virtual devices in one thread."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import pytest

from brickhub.errors import MediumUnavailableError
from bricktwin.robots import CART
from bricktwin.site.houses import kit_package
from bricktwin.site.robots import write_robots
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
