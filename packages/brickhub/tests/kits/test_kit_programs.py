"""Programs for LEGO's package on virtual devices, each in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from lego_programs import FOLDER, OWN, own, published

pytest.importorskip("legoeducation")


def run(
    tmp_path: Path, source: str, *options: str, red_s: float = 2.5
) -> subprocess.CompletedProcess[str]:
    """Run a program; the color sensor sees white, and red after ``red_s``."""
    program, readings = tmp_path / "program.py", tmp_path / "seen.csv"
    program.write_text(source, encoding="utf-8")
    readings.write_text(f"0, white\n{red_s}, red\n", encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "brickhub",
        "run",
        str(program),
        "--reading",
        f"D=@{readings}",
        "--time-limit-s",
        "100",
    ]
    return subprocess.run(
        [*command, *options], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize("name", OWN)
def test_program_of_our_own(tmp_path: Path, name: str) -> None:
    # without a pause, each second is thousands of readings
    red_s = 0.5 if name == "waits for a color without a pause" else 2.5
    done = run(tmp_path, own(name), red_s=red_s)
    assert done.returncode == 0, done.stderr


def test_run_is_reproducible(tmp_path: Path) -> None:
    source = own("square") + "print([each.position for each in m.motor], time.monotonic())\n"
    assert run(tmp_path, source).stdout == run(tmp_path, source).stdout != ""


def test_program_that_raises_shows_its_own_lines(tmp_path: Path) -> None:
    done = run(tmp_path, "import legoeducation as le\nle.SingleMotor().connect()\n1 / 0\n")
    assert done.returncode == 1
    assert (
        done.stderr.startswith("Traceback")
        and "line 3" in done.stderr
        and "kit_run.py" not in done.stderr
    )


@pytest.mark.parametrize(("end", "code"), [("exit(3)", 3), ("exit()", 0), ("exit('no motor')", 1)])
def test_exit_code(tmp_path: Path, end: str, code: int) -> None:
    assert run(tmp_path, f"import legoeducation as le\n{end}\n").returncode == code


def test_time_limit_ends_a_program(tmp_path: Path) -> None:
    source = (
        "import legoeducation as le, time\nm = le.SingleMotor()\nm.connect()\n"
        "m.motor_run()\nwhile True: time.sleep(1)\n"
    )
    done = run(tmp_path, source, "--time-limit-s", "5")
    assert (done.returncode, done.stderr) == (
        124,
        "The program was stopped at the time limit of 5 s.\n",
    )


def test_move_that_never_ends_is_stopped_too(tmp_path: Path) -> None:
    source = (
        "import legoeducation as le\nm = le.SingleMotor()\nm.connect()\n"
        "m.motor_run_for_time(10**5)\n"
    )
    assert "stopped at the time limit of 5 s" in run(tmp_path, source, "--time-limit-s", "5").stderr


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
def test_ctrl_c_ends_a_program(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    source = (
        "import legoeducation as le, time\nle.SingleMotor().connect()\n"
        "print('on', flush=True)\nwhile True: time.sleep(1)\n"
    )
    program.write_text(source)
    command = [sys.executable, "-m", "brickhub", "run", str(program), "--realtime"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None and running.stdout.readline() == "on\n"
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=30) == 130


def test_robot_with_a_hub_is_refused(tmp_path: Path) -> None:
    robot = tmp_path / "my_robot.py"
    robot.write_text(
        "from brickhub.robot import HubKind, Robot\nROBOT = Robot('mine', HubKind.PRIME)\n"
    )
    program = tmp_path / "program.py"
    program.write_text("import legoeducation as le\n")
    command = [sys.executable, "-m", "brickhub", "run", str(program), "--robot", str(robot)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "take --robot cart" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(
    FOLDER is None, reason="set LEGO_EDUCATION to a clone of github.com/LEGO/LEGOEducation"
)
def test_what_lego_publishes_runs_unchanged(tmp_path: Path) -> None:
    programs = dict(published(Path(FOLDER or "")))
    failed = {
        name: done.stderr
        for name, source in programs.items()
        if (done := run(tmp_path, source)).returncode
    }
    assert len(programs) > 60
    assert failed == {}
