"""`benchmarks/firmware_programs.py`: random programs run on the virtual hub, and their output
decides."""

from __future__ import annotations

import json
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import firmware_programs

ROOT = Path(__file__).parents[4]
FIRMWARE = f"""#!{sys.executable}
import sys
from brickhub.virtual import run_file
print("changed") if "_0.py" in sys.argv[1] else run_file(sys.argv[1])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a script cannot stand in for the firmware")
def test_different_output_is_counted(tmp_path: Path) -> None:
    """In place of the firmware: the virtual hub itself, with another output for the first program
    of each kind."""
    firmware = tmp_path / "firmware"
    firmware.write_text(FIRMWARE)
    firmware.chmod(firmware.stat().st_mode | stat.S_IXUSR)
    subprocess.run(
        [
            sys.executable,
            "-m",
            "benchmarks",
            "firmware_programs",
            str(firmware),
            "--programs",
            "2",
            "--kinds",
            "tasks",
            "drives",
            "--keep",
            str(tmp_path / "keep"),
            "--folder",
            str(tmp_path),
        ],
        cwd=ROOT,
        check=True,
        timeout=90,
    )
    result = json.loads((tmp_path / "study.json").read_text())["kinds"]
    assert result == {
        kind: {"programs": 2, "same": 1, "differ": [0]} for kind in ("tasks", "drives")
    }
    assert (tmp_path / "keep" / "drives_0.firmware").read_text() == "changed\n"
    assert "DriveBase" in (tmp_path / "keep" / "tasks_0.py").read_text()


def test_programs_without_end_are_the_same(tmp_path: Path) -> None:
    program = tmp_path / "endless.py"
    program.write_text("from pybricks.tools import wait\nwhile True:\n    wait(1000)\n")
    assert firmware_programs.on_virtual_hub(program) == firmware_programs.NO_END


def test_branches_follow_lines_that_take_time() -> None:
    lines = firmware_programs.branching(["m.run(5)", "    wait(3)", "b.turn(9)"])
    assert lines == [
        "m.run(5)",
        "    wait(3)",
        f"    {firmware_programs.BRANCH}",
        "b.turn(9)",
        firmware_programs.BRANCH,
    ]
