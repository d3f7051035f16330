"""The house as a whole: what it imports, and what it needs."""

from __future__ import annotations

import importlib
import pkgutil
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import brickhub
from brickhub.errors import an, counted

ONBOARD = "brickhub.hub.program.onboard"
"""Of this package only the folder is ours: its files run on a hub, under MicroPython."""
FROZEN = "brickhub.virtual.frozen"
"""Of this one too: its files are those of the firmware."""
EXTRAS = ("brickhub.kits.lego_transport",)
"""Modules that need an extra."""
MODULES = [
    module.name
    for module in pkgutil.walk_packages(brickhub.__path__, "brickhub.")
    if not module.name.startswith((f"{ONBOARD}.", f"{FROZEN}."))
    and module.name not in ("brickhub.__main__", *EXTRAS)
]
OTHERS = ("bricktwin", "bricksrl", "mujoco", "numpy", "scipy", "torch")


def test_every_module_is_imported_without_other_houses() -> None:
    assert len(MODULES) > 70
    for name in MODULES:
        importlib.import_module(name)
    program = f"import importlib, sys\nfor name in {MODULES}: importlib.import_module(name)\n"
    program += f"print(*set(sys.modules) & set({OTHERS}))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "\n", "")


def test_files_that_run_on_a_hub_are_there() -> None:
    names = {
        module.name for module in pkgutil.iter_modules(importlib.import_module(ONBOARD).__path__)
    }
    assert names == {
        "alone",
        "app_data",
        "find_stops",
        "frames",
        "goals",
        "ids_ev3devices",
        "ids_pupdevices",
        "inventory",
        "joint",
        "loop",
        "moves",
        "reckoning",
        "relative",
        "stdio",
        "trials",
        "wheels",
    }


def test_declared_requirements_are_light() -> None:
    needed = {
        re.match(r"[\w-]+", text)[0]
        for text in metadata.requires("brickhub")
        if "extra ==" not in text
    }
    assert needed == {
        "bleak",
        "greenlet",
        "mpy-cross-v6",
        "packaging",
        "prompt_toolkit",
        "pyserial",
        "tyro",
    }


def test_numbers_agree_with_their_noun() -> None:
    assert (counted(1, "episode"), counted(2, "episode")) == ("1 episode", "2 episodes")
    names = ("prime", "ev3-large", "nxt-motor", "UltrasonicSensor")
    assert [*map(an, names)] == ["a prime", "an ev3-large", "an nxt-motor", "an UltrasonicSensor"]


def test_virtual_hub_has_error_numbers_of_its_own() -> None:
    """Those of Python are the computer's: EBUSY is 16 on a hub, and 10 in a browser's tab."""
    sources = list((Path(brickhub.__file__).parent / "virtual").rglob("*.py"))
    assert len(sources) > 40
    for path in sources:
        assert "import errno" not in path.read_text(encoding="utf-8").splitlines(), path
