"""What the firmware (v4.1.0b2, built for a computer) printed of motors and drive bases on the way,
measured: here every digit.

Format of ``data/firmware_drives.txt``: ``===`` begins a program, whose lines have ``>``; what it printed follows. The clock of
the firmware stood still while a program computed.
"""  # noqa: E501

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

from brickhub.virtual.run import run_file

_FILE = Path(__file__).parents[1] / "data" / "firmware_drives.txt"
_PROGRAMS = re.findall(
    r"^===\n((?:> .+\n)+)((?:(?!===).*\n)+)", _FILE.read_text(encoding="utf-8"), re.MULTILINE
)
_HEAD = """from pybricks.parameters import Direction, Port, Stop
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, multitask, run_task, wait

s = StopWatch()
"""


@pytest.mark.parametrize(("lines", "printed"), _PROGRAMS, ids=map(str, range(len(_PROGRAMS))))
def test_every_digit_is_the_firmwares(lines: str, printed: str, tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    program.write_text(
        _HEAD + "".join(line.removeprefix("> ") for line in lines.splitlines(keepends=True)),
        encoding="utf-8",
    )
    out, err = io.BytesIO(), io.StringIO()
    code = run_file(program, stdout=out, stderr=err, time_limit_s=100)
    assert (code, err.getvalue()) == (0, "")
    assert out.getvalue().decode().splitlines() == printed.splitlines()
