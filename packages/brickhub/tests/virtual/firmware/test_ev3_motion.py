"""Motion of EV3's motors, as the firmware's own motor control moves them (v4.1.0b2, built for a
computer by ``benchmarks/firmware_ev3.py``): here every degree and every millisecond."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.firmware_ev3 import on_virtual_hub, program

SHOWN = json.loads(
    (Path(__file__).parents[1] / "data" / "ev3_motion.json").read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", SHOWN)
def test_every_degree_is_the_firmwares(name: str, tmp_path: Path) -> None:
    kind, number = name.split()
    _, _, text = program(int(number), is_base=kind == "base")
    assert on_virtual_hub(tmp_path, text) == SHOWN[name]
