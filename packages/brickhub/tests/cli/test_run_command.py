"""``brickhub run``."""

from __future__ import annotations

import io
import re
import signal
import subprocess
import sys
from pathlib import Path

import described
import pytest

TWO_WHEELER = f"{described.__file__}:TWO_WHEELER"
HELLO = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.tools import wait
motor = Motor(Port.A)
motor.run_angle(500, 90)
print("turned", motor.angle())
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "main.py"
    path.write_text(HELLO)
    return path


@pytest.mark.parametrize("robot", [(), ("--robot", "bench"), ("--robot", TWO_WHEELER)])
def test_output_of_the_program_is_printed(told, program: Path, robot: tuple[str, ...]) -> None:
    code, out = told("run", str(program), *robot)
    word, angle = out.split()
    assert (code, word) == (0, "turned")
    assert abs(int(angle) - 90) <= 5


def test_failing_program_prints_traceback(brickhub, program: Path) -> None:
    program.write_text("print('before')\n1 / 0\n")
    done = brickhub("run", str(program), "--robot", "bench")
    assert (done.code, done.out.split()) == (1, ["before"])
    assert done.err.startswith("Traceback (most recent call last):\n")
    assert "line 2" in done.err
    assert "ZeroDivisionError" in done.err.splitlines()[-1]
    assert "brickhub" not in done.err


def test_unplugged_port_is_said_once(brickhub, program: Path, tmp_path: Path) -> None:
    port = tmp_path / "no-port"
    done = brickhub("run", str(program), "--hub", f"usb:{port}")
    reason = f"could not open the serial port {port} (No such file or directory); plug the hub in"
    assert (done.code, done.err.count("No such file")) == (2, 1)
    assert reason in done.err


def test_missing_device_of_a_described_robot_is_an_error(brickhub, program: Path) -> None:
    program.write_text(HELLO.replace("Port.A", "Port.B"))
    done = brickhub("run", str(program), "--robot", TWO_WHEELER)
    assert done.code == 1 and "OSError: [Errno 19] ENODEV" in done.err


def test_time_limit(brickhub, program: Path) -> None:
    program.write_text("from pybricks.tools import wait\nprint('on')\nwhile True:\n    wait(100)\n")
    done = brickhub("run", str(program), "--robot", "bench", "--time-limit-s", "5")
    assert done == (124, "on\n", "The program was stopped at the time limit of 5 s.\n")


@pytest.mark.parametrize(
    ("source", "typed", "printed"),
    [
        ("from usys import stdin\nprint(stdin.read(3))\n", b"abc", b"abc\n"),
        (
            "from usys import stdin\nprint(stdin.buffer.read(3) == b'\\xff\\xfeA')\n",
            b"\xff\xfeA",
            b"True\n",
        ),
    ],
    ids=["text", "bytes that are no text"],
)
def test_standard_input_is_passed(program: Path, source: str, typed: bytes, printed: bytes) -> None:
    program.write_text(source)
    command = [sys.executable, "-m", "brickhub", "run", str(program)]
    done = subprocess.run(command, input=typed, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, printed, b"")


def test_unused_input_is_not_waited_for(program: Path) -> None:
    program.write_text("print('done')\n")
    command = [sys.executable, "-m", "brickhub", "run", str(program)]
    # the pipe stays open
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.wait(timeout=60) == 0
        assert child.stdout.read() == b"done\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
def test_ctrl_c_stops_a_program(program: Path) -> None:
    program.write_text(
        "from pybricks.hubs import PrimeHub\nfrom pybricks.parameters import Color\n"
        "from pybricks.tools import wait\n"
        "PrimeHub().light.on(Color.RED)\nwhile True:\n    try:\n        wait(1000)\n"
        "    except BaseException:\n        pass\n"
    )
    command = [sys.executable, "-m", "brickhub", "run", str(program), "--panel"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert "hue 0" in child.stderr.readline(), "it runs"
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
    assert (child.returncode, out) == (130, "")
    assert re.fullmatch(r"(.* light off; .*\n)?interrupted: the program was stopped; [^\n]+\n", err)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nothing.py",), "nothing.py"),
        (
            (__file__, "--robot", "dog"),
            "there is no robot 'dog'; name a Python file with one, such as my_robot.py, or bench",
        ),
    ],
)
def test_wrong_files_and_robots_print_one_line(
    fails, arguments: tuple[str, ...], says: str
) -> None:
    fails("run", *arguments, says=says)


def test_used_devices_are_there(brickhub, program: Path) -> None:
    program.write_text(
        "from pybricks.hubs import TechnicHub\nfrom pybricks.pupdevices import *\n"
        "from pybricks.parameters import *\n"
        "from pybricks.tools import wait\nhub = TechnicHub()\n"
        "arm, eye = Motor(Port.A), ColorSensor(Port.B)\n"
        "hub.light.on(Color.RED)\nprint(eye.color(), arm.run_until_stalled(300, duty_limit=50))\n"
        "wait(10000)\n"
    )
    options = ("--reading", "B=red", "--end-stop", "A=-90..120", "--press", "center@5s", "--panel")
    done = brickhub("run", str(program), *options)
    assert (done.code, done.out) == (0, "Color.RED 120\n")
    assert "hue 0, 100 %, 100 %" in done.err and "stopped (SystemExit)" in done.err


def test_robot_from_a_file(told, tmp_path: Path, program: Path) -> None:
    robot = tmp_path / "arm.py"
    robot.write_text(
        "from brickhub.robot import HubKind, Motor, Robot\n"
        "ARM = Robot('arm', HubKind.CITY, motors=(Motor('joint', 'B'),))\n"
    )
    program.write_text(
        "from pybricks.hubs import CityHub\nfrom pybricks.pupdevices import Motor\n"
        "from pybricks.parameters import Port\n"
        "joint = Motor(Port.B)\njoint.run_angle(500, 90)\nprint(joint.angle() in (89, 90))\n"
    )
    for reference in (str(robot), f"{robot}:ARM"):
        assert told("run", str(program), "--robot", reference) == (0, "True\n")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--press", "left"), "'left' is not a button press"),
        (("--press", "up@1s"), "no button 'up'"),
        (("--reading", "B"), "'B' is not a reading"),
        (("--end-stop", "C=10..20"), "starts at 0"),
        (("--end-stop", "C"), "not a pair of end stops"),
        (("--robot", "nowhere.py"), "no file nowhere.py"),
        (("--hub", "ble", "--press", "left@1s"), "leave out --hub, or --press"),
        (
            ("--hub", "usb", "--robot", "bench"),
            "a real hub has its own robot, buttons and time; leave out --hub, or --robot",
        ),
        (("--robot", TWO_WHEELER, "--reading", "B=red"), "--robot bench"),
    ],
)
def test_mismatched_options_print_one_line(
    fails, program: Path, options: tuple[str, ...], says: str
) -> None:
    program.write_text("")
    fails("run", str(program), *options, says=says)


def test_terminal_is_no_input(brickhub, program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever sits at it would not know that the program waits."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

        def read(self, *_: object) -> str:
            raise AssertionError("is read")

    program.write_text("print(input())\n")
    monkeypatch.setattr(sys, "stdin", Terminal("typed\n"))
    done = brickhub("run", str(program))
    assert done.code != 0 and "typed" not in done.out
    monkeypatch.setattr(sys, "stdin", io.StringIO("typed\n"))
    # A hub echoes what it reads.
    assert brickhub("run", str(program)) == (0, "typed\ntyped\n", "")
