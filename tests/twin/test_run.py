"""Whole programs from files, on both virtual robots."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from bricksrl.errors import ProgramError, UnknownNameError
from bricksrl.twin.run import run_file


def run(
    folder: Path, source: str, robot: str = "bench", stdin: bytes | None = None, time_limit_s: float | None = None
) -> tuple[int, str, str]:
    path = folder / "main.py"
    path.write_text(source)
    out, err = io.BytesIO(), io.StringIO()
    data = io.BytesIO(stdin) if stdin is not None else None
    code = run_file(path, robot, stdout=out, stderr=err, stdin=data, time_limit_s=time_limit_s)
    return code, out.getvalue().decode(), err.getvalue()


def test_a_program_prints_clean_lines(tmp_path: Path) -> None:
    assert run(tmp_path, "print('a')\nprint(1/3)") == (0, "a\n0.33333334\n", "")


def test_the_two_wheeler_drives(tmp_path: Path) -> None:
    source = """
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.parameters import Port, Direction
from pybricks.robotics import DriveBase
from pybricks.hubs import PrimeHub
hub = PrimeHub()
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
eyes = UltrasonicSensor(Port.C)
base.straight(100)
print(abs(base.distance() - 100) <= 3, 40 <= eyes.distance() <= 2000)
base.turn(90)
print(abs(hub.imu.heading() - 90) < 10)
"""
    assert run(tmp_path, source, "two-wheeler") == (0, "True True\nTrue\n", "")


def test_an_error_shows_where_it_was(tmp_path: Path) -> None:
    source = "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\nprint(1)\nMotor(Port.B)\nprint(2)"
    code, out, err = run(tmp_path, source, "two-wheeler")
    assert (code, out) == (1, "1\n")
    assert err.startswith(
        'Traceback (most recent call last):\n  File "main.py", line 4, in <module>\nOSError: [Errno 19] ENODEV: '
    )


@pytest.mark.parametrize("base", ["BaseException", "KeyboardInterrupt", "GeneratorExit"])
def test_whatever_a_program_raises_is_its_own(tmp_path: Path, base: str) -> None:
    code, _, err = run(tmp_path, f"class Mine({base}):\n    pass\nraise Mine(3)")
    assert (code, err.splitlines()[-1]) == (1, "Mine: 3")


def test_a_program_may_end_itself(tmp_path: Path) -> None:
    source = "print(1)\nclass Over(SystemExit):\n    pass\nraise {}\nprint(2)"
    assert run(tmp_path, source.format("SystemExit(3)")) == (0, "1\n", "The program was stopped (SystemExit).\n")
    assert run(tmp_path, source.format("Over")) == (0, "1\n", "The program was stopped (Over).\n")


@pytest.mark.parametrize(
    "loop",
    ["wait(100)", "pass", "watch.time()", "print(end='')", "try:\n        wait(10)\n    except:\n        pass"],
)
def test_the_time_limit_stops_any_loop(tmp_path: Path, loop: str) -> None:
    source = f"from pybricks.tools import wait, StopWatch\nwatch = StopWatch()\nprint('go')\nwhile True:\n    {loop}\n"
    assert run(tmp_path, source, time_limit_s=0.5) == (0, "go\n", "The program was stopped (SystemExit).\n")


def test_input_is_what_was_given(tmp_path: Path) -> None:
    source = "import usys\nprint(usys.stdin.buffer.read(3))\nprint(input())"
    assert run(tmp_path, source, stdin=b"abcdef\n") == (0, "b'abc'\ndef\ndef\n", "")
    code, _, err = run(tmp_path, source)
    assert code == 1
    assert "EOFError: the program waits for input" in err


def test_syntax_error(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, "print(1)\nx = = 2\n")
    assert (code, out) == (1, "")
    assert err.splitlines()[1:] == ['  File "main.py", line 2', "SyntaxError: invalid syntax"]


def test_unknown_robot_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="no robot 'submarine'"):
        run(tmp_path, "", "submarine")
    with pytest.raises(ProgramError, match="nowhere.py"):
        run_file(tmp_path / "nowhere.py", "bench", stdout=io.BytesIO(), stderr=io.StringIO())


def test_programs_of_the_same_folder_can_be_imported(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text("def halve(x):\n    return x / 0\nthird = 1 / 3\nprint(__name__)\n")
    code, out, err = run(tmp_path, "import helper\nfrom helper import halve, third\nprint(third)\nhalve(1)\n")
    assert (code, out) == (1, "helper\n0.33333334\n")
    assert err == (
        "Traceback (most recent call last):\n"
        '  File "main.py", line 4, in <module>\n'
        '  File "helper.py", line 2, in halve\n'
        "ZeroDivisionError: divide by zero\n"
    )
