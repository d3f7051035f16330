"""What the firmware (v4.1.0b2, built for a computer as a Prime hub) printed of whole programs,
measured: here all of it.

Format of ``data/firmware_programs.txt``: ``===`` and a name begin a program, ``--- file.py`` each of its files, ``--- prints``
what it printed, with the traceback. The clock of the firmware stood still while a program computed.
"""  # noqa: E501

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

from brickhub.virtual.run import run_file

_FILE = Path(__file__).parent / "data" / "firmware_programs.txt"
_PROGRAMS = dict(
    re.findall(r"^=== (.+)\n((?:(?!=== ).*\n)+)", _FILE.read_text(encoding="utf-8"), re.MULTILINE)
)


@pytest.mark.parametrize("name", _PROGRAMS)
def test_prints_what_the_firmware_prints(name: str, tmp_path: Path) -> None:
    _, *parts = re.split(r"(?m)^--- (.+)\n", _PROGRAMS[name])
    *files, (_, printed) = zip(parts[::2], parts[1::2], strict=True)
    for file, source in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(source, encoding="utf-8")
    out, err = io.BytesIO(), io.StringIO()
    run_file(tmp_path / "main.py", stdout=out, stderr=err, time_limit_s=600)
    assert (out.getvalue().decode() + err.getvalue()).splitlines() == printed.splitlines()
