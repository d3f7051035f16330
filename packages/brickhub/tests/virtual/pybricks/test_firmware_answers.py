"""Measured answers of the firmware (v4.1.0b2, built for a computer as a Prime hub) to small
programs.

Format of ``data/firmware_answers.txt``: ``===`` starts a program with its sensor values; lines with ``>`` are its beginning. Each
other line runs in that program; after ``=>`` comes its output or error (``E``). ``¦`` is a line break.
"""  # noqa: E501

from __future__ import annotations

import ast
import io
import re
from pathlib import Path

import pytest

from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.run import Operation, run_file

_FILE = Path(__file__).parents[1] / "data" / "firmware_answers.txt"
_PROGRAMS = re.findall(
    r"^=== (.+)\n((?:> .+\n)+)((?:(?!===).*\n)+)", _FILE.read_text(encoding="utf-8"), re.MULTILINE
)


def _tried(number: int, source: str) -> str:
    try:
        ast.parse(source, mode="eval")
    except SyntaxError:
        statement = source
    else:
        statement = f"print(repr(({source})))"
    body = "".join(f"    {line}\n" for line in statement.split("\n"))
    return (
        f'print("@{number}")\ntry:\n{body}except BaseException as _e:\n    print("E", repr(_e))\n'
    )


@pytest.mark.parametrize(
    ("section", "head", "lines"), _PROGRAMS, ids=[section for section, _, _ in _PROGRAMS]
)
def test_answers(section: str, head: str, lines: str, tmp_path: Path) -> None:
    pairs = [line.replace(" ¦ ", "\n").split("  =>  ") for line in lines.splitlines() if line]
    beginning = "".join(f"{line.removeprefix('> ')}\n" for line in head.splitlines()).replace(
        " ¦ ", "\n"
    )
    program = tmp_path / "main.py"
    program.write_text(
        beginning + "".join(_tried(i, source) for i, (source, _) in enumerate(pairs)),
        encoding="utf-8",
    )
    readings = [
        parse_reading(option)
        for option in section.rsplit(" ", maxsplit=1)[-1].split(",")
        if "=" in option
    ]
    out, err = io.BytesIO(), io.StringIO()
    code = run_file(
        program, stdout=out, stderr=err, time_limit_s=600, operation=Operation([], readings, {})
    )
    told = [line for line in err.getvalue().splitlines() if not line.startswith("The bench blocks")]
    assert (code, told) == (0, [])
    printed = re.split(r"(?m)^@\d+\n", out.getvalue().decode().replace("\r\n", "\n"))[1:]
    assert {
        source: answer.strip() for (source, _), answer in zip(pairs, printed, strict=True)
    } == dict(pairs)
