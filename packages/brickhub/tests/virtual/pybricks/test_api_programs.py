"""Small programs for every documented method of Pybricks, with expected output.

Format of ``data/api_programs.txt``: a line in brackets starts a section: imported hub (default
Prime), button presses (``press=``), sensor values (``reading``) and end stops. Other lines are
programs with ``|`` as line breaks, then ``=>`` and the output.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.panel import parse_press
from brickhub.virtual.run import Operation, run_file

_HUBS = ("PrimeHub", "InventorHub", "EssentialHub", "TechnicHub", "CityHub", "MoveHub", "ThisHub")
_MODULES = ("pupdevices", "parameters", "tools", "robotics", "iodevices", "messaging")
_DRIVE = (
    "left, right = Motor(Port.A), Motor(Port.B)\n"
    "base = DriveBase(left, right, wheel_diameter=56, axle_track=114)\n"
)
_FILE = Path(__file__).parents[1] / "data" / "api_programs.txt"


@dataclass(frozen=True)
class Program:
    """A program with its surroundings; ``printed`` is the expected output."""

    section: str
    source: str
    printed: str

    @property
    def operation(self) -> Operation:
        presses, readings, stops = [], [], {}
        _, _, options = self.section.partition(" ")
        for option in options.split(","):
            name, _, value = option.partition("=")
            if "@" in option:
                presses.append(parse_press(option.removeprefix("press=")))
            elif ".." in option:
                low, high = value.split("..")
                stops[name] = float(low), float(high)
            elif option:
                readings.append(parse_reading(option.replace(";", ",")))
        return Operation(presses, readings, stops)

    @property
    def text(self) -> str:
        word = self.section.split(" ", maxsplit=1)[0]
        hub = word if word in _HUBS else "PrimeHub"
        found = [name for name in _MODULES if hub != "MoveHub" or name != "iodevices"]
        head = (
            "".join(f"from pybricks.{name} import *\n" for name in found)
            + f"from pybricks.hubs import {hub}\n"
        )
        head += "" if word in _HUBS else "hub = PrimeHub()\n"
        return head + (_DRIVE if word == "drive" else "") + self.source + "\n"


def programs() -> Iterator[Program]:
    section = ""
    for line in _FILE.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line:
            source, _, printed = line.partition("  =>")
            yield Program(
                section,
                source.replace("|", "\n").replace("\n=", "|="),
                printed.strip().replace(" | ", "\n"),
            )


def test_there_are_many_programs() -> None:
    assert sum(1 for _ in programs()) >= 200


@pytest.mark.parametrize(
    "program", list(programs()), ids=lambda program: program.source.replace("\n", "|")[:60]
)
def test_program(program: Program, tmp_path: Path) -> None:
    path = tmp_path / "main.py"
    path.write_text(program.text)
    out, err = io.BytesIO(), io.StringIO()
    code = run_file(path, stdout=out, stderr=err, time_limit_s=60, operation=program.operation)
    printed = "\n".join(line.rstrip() for line in out.getvalue().decode().splitlines())
    assert (code, printed, err.getvalue()) == (0, program.printed, "")
