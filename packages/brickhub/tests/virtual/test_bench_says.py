"""What the bench says of what it assumes, and of a program that it cannot run on."""

from __future__ import annotations

import io

import pytest

from brickhub.virtual.run import run_file

STALLS = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
motor = Motor(Port.C)
print(motor.run_until_stalled(500))
{rest}
print("done")
"""


def test_bench_says_where_it_blocks_a_motor(tmp_path):
    program, err, out = tmp_path / "main.py", io.StringIO(), io.BytesIO()
    program.write_text(STALLS.format(rest="motor.run_until_stalled(500)"))
    assert run_file(program, stdout=out, stderr=err) == 0
    assert err.getvalue().count("The bench blocks the motor on port C after 90 degrees") == 1
    assert "--end-stop C=-90..120" in err.getvalue() and out.getvalue().startswith(b"90\n")


@pytest.mark.parametrize("move", ["motor.run_target(500, 180)", "motor.run_angle(500, 90)"])
def test_program_that_waits_for_a_blocked_motor_ends(move, tmp_path):
    program, err, out = tmp_path / "main.py", io.StringIO(), io.BytesIO()
    program.write_text(STALLS.format(rest=move))
    assert run_file(program, stdout=out, stderr=err) == 1
    assert (
        "waits for the motor on port C, which has been blocked at" in err.getvalue()
        and b"done" not in out.getvalue()
    )


@pytest.mark.parametrize(
    "move", ["motor.run_time(500, 90_000)", "motor.run_target(500, 180, wait=False)"]
)
def test_program_whose_wait_ends_is_not_ended(move, tmp_path):
    program, err, out = tmp_path / "main.py", io.StringIO(), io.BytesIO()
    program.write_text(STALLS.format(rest=f"{move}\nfrom pybricks.tools import wait\nwait(90_000)"))
    assert run_file(program, stdout=out, stderr=err) == 0, err.getvalue()
    assert out.getvalue().endswith(b"done\n")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "print(\N{LEFT DOUBLE QUOTATION MARK}hello\N{RIGHT DOUBLE QUOTATION MARK})",
            'Line 2 has \N{LEFT DOUBLE QUOTATION MARK}, as word processors write it; type "',
        ),
        ("x = 1 \N{EN DASH} 2", "Line 2 has \N{EN DASH}, as word processors write it; type -"),
    ],
)
def test_character_of_a_word_processor_is_named(line, says, tmp_path):
    program, err = tmp_path / "main.py", io.StringIO()
    program.write_text(f"# quotes\n{line}\n", encoding="utf-8")
    assert run_file(program, stdout=io.BytesIO(), stderr=err) == 1
    assert err.getvalue().endswith(f"{says}\n") and "SyntaxError" in err.getvalue()


def test_other_wrong_syntax_needs_no_hint(tmp_path):
    program, err = tmp_path / "main.py", io.StringIO()
    program.write_text("x = = 1\n")
    assert run_file(program, stdout=io.BytesIO(), stderr=err) == 1
    assert "word processor" not in err.getvalue()
