"""The command ``brickhub`` as a whole: help, version, errors in one line."""

from __future__ import annotations

import errno
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from in_process import assert_explained

import brickhub as package
from brickhub.cli import app
from brickhub.cli.app import one_line
from brickhub.cli.command_table import LINE

COMMANDS = ("run", "check", "scan", "program", "latency", "calibrate", "stop", "doctor")
HEAVY = ("bleak", "greenlet", "numpy", "serial", "brickhub.virtual.machine")


def process(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=60, check=False, **options
    )  # type: ignore[call-overload]


def test_version(told) -> None:
    assert told("--version") == (0, f"brickhub {package.__version__}\n")


@pytest.mark.parametrize(
    ("platform", "error", "code"),
    [
        ("linux", BrokenPipeError(errno.EPIPE, "Broken pipe"), 1),
        ("win32", OSError(errno.EINVAL, "Invalid argument"), 1),
        ("linux", OSError(errno.EINVAL, "Invalid argument"), 2),
        ("win32", OSError(errno.EINVAL, "Invalid argument", "a?b"), 2),
    ],
)
def test_reader_that_has_left_is_no_error(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    platform: str,
    error: OSError,
    code: int,
) -> None:
    """As `head` does; Windows calls it an invalid argument."""

    def fail(_line: str) -> None:
        raise error

    monkeypatch.setattr("sys.platform", platform)
    monkeypatch.setattr(app, "print_line", fail)
    assert app.run(LINE, ["--version"]) == code
    assert bool(capfd.readouterr().err) is (code == 2)


def test_python_runs_the_package_as_the_command() -> None:
    done = process("-m", "brickhub", "--version")
    assert (done.returncode, done.stdout, done.stderr) == (
        0,
        f"brickhub {package.__version__}\n",
        "",
    )


def test_help_names_every_command(told) -> None:
    code, out = told("--help")
    assert code == 0 and tuple(LINE.commands) == COMMANDS
    assert all(f"• {command} " in out for command in COMMANDS)
    assert told() == told("help") == (code, out)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_examples(told, command: str) -> None:
    code, out = told(command, "--help")
    assert (
        code == 0
        and out.startswith(f"usage: brickhub {command}")
        and f"\n  brickhub {command}" in out
    )
    assert told("help", command) == (code, out)
    assert_explained(out)


@pytest.mark.parametrize("command", ["", "run"])
def test_help_is_light(command: str) -> None:
    script = (
        "import sys\n"
        "from brickhub.cli import main\n"
        "try:\n"
        f"    main({[*command.split(), '--help']!r})\n"
        "except SystemExit as end:\n"
        "    assert not end.code, end.code\n"
        f"print('loaded:', *sorted(set(sys.modules) & set({HEAVY!r})))\n"
    )
    done = process("-c", script)
    assert done.stdout.splitlines()[-1] == "loaded:"


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("command", ["--version", "--help"])
@pytest.mark.parametrize("output", ["| true", ">&-"])
def test_unread_output_ends_quietly(command: str, output: str) -> None:
    """A reader that has left, such as ``head``, and standard streams that are closed."""
    line = f"{shlex.quote(sys.executable)} -m brickhub {command} {output}"
    done = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.skipif(sys.platform != "linux", reason="a file that is always full, beyond POSIX")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written_is_told(unbuffered: str) -> None:
    line = f"{shlex.quote(sys.executable)} -m brickhub --help > /dev/full"
    done = subprocess.run(
        ["sh", "-c", line],
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    said = "error: No space left on device; make room on the disk\n"
    assert (done.returncode, done.stderr) == (2, said)


def test_second_ctrl_c_at_the_end_is_quiet() -> None:
    interrupted = "import atexit, signal; atexit.register(signal.raise_signal, signal.SIGINT); "
    done = process(
        "-c", f"{interrupted}from brickhub.cli import main; raise SystemExit(main(['--version']))"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_missing_docstrings_print_one_line() -> None:
    done = process("-OO", "-m", "brickhub", "scan", "--hub", "virtual")
    assert (
        (done.returncode, done.stdout) == (2, "")
        and "unset PYTHONOPTIMIZE" in done.stderr
        and done.stderr.count("\n") == 1
    )


def test_missing_package_is_named(tmp_path: Path) -> None:
    """As of an installation that was broken off."""
    (tmp_path / "sitecustomize.py").write_text(
        "from importlib.machinery import PathFinder\n"
        "find = PathFinder.find_spec\n"
        "PathFinder.find_spec = lambda name, *rest: None if name.startswith('greenlet') else "
        "find(name, *rest)\n"
    )
    (tmp_path / "main.py").write_text("print(1)")
    path = f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    done = process(
        "-m",
        "brickhub",
        "run",
        # Several programs are greenlets.
        str(tmp_path / "main.py"),
        str(tmp_path / "main.py"),
        env={**os.environ, "PYTHONPATH": path},
    )
    told = (
        r"error: the package 'greenlet' is missing in .*; install brickhub there again, or "
        r"activate its environment\n"
    )
    assert done.returncode == 2 and re.fullmatch(told, done.stderr), done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("scan --seconds x", "--seconds is 'x'; give a number; see `brickhub scan --help`"),
        (
            "latency my.py --exchanges x",
            "--exchanges is 'x'; give a whole number; see `brickhub latency --help`",
        ),
        ("run", "Missing from brickhub run: FILE"),
        ("scan --jsn", "Unrecognized options: --jsn (did"),
        ("scan --secnds 3", "(did you mean --seconds?)"),
        (
            "scna",
            "there is no command scna (did you mean 'scan'?); see `brickhub --help`",
        ),
        ("doctor --timeout-s nan", "timeout-s is nan"),
        ("scan --seconds 0", "above 0, and up to 600"),
        ("scan --hub infrared", "choose ble, usb or virtual"),
        ("run main.py --time-limit-s nan", "time limit is nan"),
        ("run main.py --time-limit-s -1", "time limit is -1"),
        ("run other.py", "(No such file or directory)"),
        ("program nowhere.py", "there is no file nowhere.py"),
        (
            "program my_robot.py --out program.txt",
            "'program.txt' is not a name of a program; end it in .py",
        ),
    ],
)
def test_wrong_arguments_print_one_line(
    fails, arguments: str, says: str, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "main.py").write_text("print(1)")
    (tmp_path / "my_robot.py").write_text("from brickhub.robot import BENCH\n")
    fails(*arguments.split(), says=says)
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix) == [
        "main.py",
        "my_robot.py",
    ], "nothing was made"


def test_failure_in_a_users_file_names_its_line(fails, tmp_path: Path) -> None:
    (tmp_path / "my_robot.py").write_text(
        "from brickhub.robot import Robot\n\nROBOT = Robot('mine', 'prime')\n"
    )
    fails("program", str(tmp_path / "my_robot.py"), says="give HubKind.PRIME")
    fails("program", str(tmp_path / "my_robot.py"), says="my_robot.py, line 3); correct it")


def test_one_line_error_keeps_message_and_help() -> None:
    box = (
        "╭─ Value error ────────╮\n"
        "│ Error parsing --seed: │\n"
        "│ not a number.         │\n"
        "│ ───────────────────── │\n"
        "│ For full helptext, see bricksrl --help │\n"
        "╰──────────────────────╯\n"
    )
    assert (
        one_line(box, "bricksrl train")
        == "Error parsing --seed: not a number; see `bricksrl train --help`"
    )


def test_unknown_error_prints_one_line() -> None:
    assert "\n" not in one_line("")
    assert "\n" not in one_line("Traceback\nsomething\n\nelse\n")
