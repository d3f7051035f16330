"""`benchmarks/firmware_tests.py`: programs with expected output."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import firmware_tests


@pytest.mark.parametrize(
    ("printed", "expected", "verdict"),
    [
        ("a\nb\n", "a\nb", "passed"),
        ("a\n", "a\nb\n", "differs: '(end)', expected 'b'"),
        ("SKIP\nThe program was stopped (SystemExit).\n", "a\n", "skips itself"),
        ("Traceback\nImportError: no module named 'array'\n", "a\n", "needs the module array"),
        ("OverflowError: small int overflow\n", "1180591620717411303424\n", "needs long integers"),
    ],
)
def test_verdict_has_reason(printed: str, expected: str, verdict: str) -> None:
    assert firmware_tests.verdict(printed, expected) == verdict


def test_program_runs_with_files_beside_it(tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    program.write_text("import part\nprint(part.VALUE / 3)\n1 / 0\n")
    (tmp_path / "part.py").write_text("VALUE = 2\n")
    (tmp_path / "main.exp").write_text("")
    assert firmware_tests.expected_output(program) == tmp_path / "main.exp"
    assert firmware_tests.expected_output(tmp_path / "part.py") is None
    printed = firmware_tests.output(program, "bench", 60.0, 60.0)
    assert printed.startswith("0.6666667\nTraceback") and printed.endswith(
        "ZeroDivisionError: divide by zero\n"
    )
