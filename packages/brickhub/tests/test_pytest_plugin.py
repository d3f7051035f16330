"""The fixture of pytest, as pytest itself finds it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from described import TWO_WHEELER

from brickhub.errors import DescriptionError, ProgramError
from brickhub.pytest_plugin import PybricksHub
from brickhub.robot import HubKind, Motor, Robot, UltrasonicSensor
from brickhub.target import find_in_files
from brickhub.virtual.bench_body import BenchBody

LOOK = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import ColorSensor, Motor
from pybricks.tools import wait
hub = PrimeHub()
print(ColorSensor(Port.B).color(), Motor(Port.C).run_until_stalled(500))
while not hub.buttons.pressed():
    wait(10)
print(hub.buttons.pressed(), input())
"""
TURN = """
from pybricks.parameters import Port
from pybricks.pupdevices import Motor, UltrasonicSensor
motor, eyes = Motor(Port.A), UltrasonicSensor(Port.C)
motor.run_angle(500, 90)
print(motor.angle(), eyes.distance())
print(motor.run_until_stalled(500))
"""
ALONE = (
    "from pybricks.pupdevices import *\nfrom pybricks.parameters import *\n"
    "Motor(Port.PORT).run_angle(500, 90)"
)
ROVER = Robot(
    "rover", HubKind.PRIME, motors=(Motor("wheel", "A"),), sensors=(UltrasonicSensor("eyes", "C"),)
)


def test_the_bench_is_given_what_the_command_line_gives_it(pybricks_hub: PybricksHub) -> None:
    run = pybricks_hub.run(
        LOOK, readings=["B=red"], end_stops=["C=-90..120"], presses=["left@2s"], stdin="now\n"
    )
    angle = float(run.output.split()[1])
    assert (run.exit_code, run.errors) == (0, "")
    assert run.output == f"Color.RED {angle:.0f}\nnow\n{{Button.LEFT}} now\n", (
        "a hub echoes its input"
    )
    assert 110 < angle < 130
    assert run.log[-1]["B_color"] == "Color.RED"
    assert max(row["C_speed_deg_s"] or 0 for row in run.log) > 400  # type: ignore[type-var]
    assert run.log[-1]["time_s"] == pytest.approx(2.0, abs=0.05)


def test_a_robot_has_readings_and_end_stops_by_name(pybricks_hub: PybricksHub) -> None:
    run = pybricks_hub.run(
        TURN,
        robot=ROVER,
        readings={"eyes": lambda at: 500 - at["wheel"]},
        end_stops={"wheel": (-10, 200)},
    )
    assert run.exit_code == 0, run.errors
    turned, distance, stalled = map(int, run.output.split())
    assert abs(turned - 90) <= 3 and abs(distance - 410) <= 3 and 195 < stalled < 210


def test_a_robot_may_be_a_body_or_a_name(
    pybricks_hub: PybricksHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # as where no other house is installed
    monkeypatch.setattr("brickhub.target._finder", lambda: find_in_files)
    file = tmp_path / "my_robot.py"
    file.write_text(
        "from brickhub.robot import HubKind, Motor, Robot\n"
        "A = Robot('a', HubKind.PRIME, motors=(Motor('wheel', 'F'),))\n"
    )
    for robot, port in ((BenchBody(TWO_WHEELER), "E"), (str(file), "F"), ("bench", "D")):
        program = ALONE.replace("PORT", port)
        run = pybricks_hub.run(program, robot=robot)
        assert run.exit_code == 0 and abs(float(run.log[-1][f"{port}_angle_deg"] or 0) - 90) < 3, (
            run
        )  # type: ignore[arg-type]
        if robot != "bench":
            assert pybricks_hub.run(ALONE.replace("PORT", "B"), robot=robot).exit_code == 1


def test_errors_and_limits_are_told(pybricks_hub: PybricksHub) -> None:
    failed = pybricks_hub.run("def f():\n    return 1 / 0\nprint('on')\nf()")
    assert (failed.exit_code, failed.output) == (1, "on\n")
    assert failed.errors.startswith("Traceback") and failed.errors.endswith(
        "ZeroDivisionError: divide by zero\n"
    )
    endless = pybricks_hub.run("from pybricks.tools import wait\nwhile True:\n    wait(10)")
    assert (endless.exit_code, endless.errors) == (
        124,
        "The program was stopped at the time limit of 60 s.\n",
    )
    assert endless.timed_out and not failed.timed_out
    assert endless.log[-1]["time_s"] == 60.0
    assert "time_s" not in repr(endless), (
        "a failing assertion shows the run, not its thousands of rows"
    )


def test_what_does_not_fit_is_refused(pybricks_hub: PybricksHub) -> None:
    with pytest.raises(DescriptionError, match="dicts by name for a Robot"):
        pybricks_hub.run("pass", robot=ROVER, readings=["C=200mm"])
    with pytest.raises(DescriptionError, match="lists of texts for the bench"):
        pybricks_hub.run("pass", readings={"eyes": lambda at: 3.0})
    with pytest.raises(ProgramError, match=r"missing\.py"):
        pybricks_hub.run("missing.py")


def test_files_are_named_from_the_folder_of_the_test(tmp_path: Path) -> None:
    tests = tmp_path / "tests"
    tests.mkdir()
    (tests / "main.py").write_text("import helper\nprint(helper.WORD)\n")
    (tests / "helper.py").write_text("WORD = 'found'\n")
    (tests / "test_main.py").write_text(
        "import sys\n"
        "from pathlib import Path\n"
        "def test_light():\n"
        "    loaded = sorted(name for name in sys.modules if name.startswith('brickhub'))\n"
        "    assert loaded == ['brickhub', 'brickhub.pytest_plugin'], 'every run of pytest "
        "imports them'\n"
        "def test_main(pybricks_hub):\n"
        "    for program in ('main.py', Path('main.py')):\n"
        "        assert pybricks_hub.run(program).output == 'found\\n'\n"
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0 and "2 passed" in done.stdout, done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="timers of POSIX")
def test_ctrl_c_ends_the_tests_not_only_the_program(tmp_path: Path) -> None:
    (tmp_path / "test_endless.py").write_text(
        "import signal\n"
        "def test_first(pybricks_hub):\n"
        # What a first run imports takes long on a busy computer, and the timer is for the program.
        "    pybricks_hub.run('pass')\n"
        "    signal.setitimer(signal.ITIMER_REAL, 0.5)\n"
        "    signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))\n"
        "    loop = 'while True:\\n    try:\\n        pass\\n    except BaseException:\\n       "
        " pass'\n"
        "    pybricks_hub.run(loop, time_limit_s=None)\n"
        "def test_second():\n"
        "    raise AssertionError('goes on')\n"
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (
        "KeyboardInterrupt" in done.stdout and "goes on" not in done.stdout and done.returncode == 2
    ), done.stdout


def test_several_hubs_hear_one_another(pybricks_hub: PybricksHub) -> None:
    head = "from pybricks.messaging import BLERadio\nfrom pybricks.tools import wait\n"
    sender = f"{head}BLERadio(broadcast_channel=1).broadcast(5)\nwait(1000)\n"
    listener = f"{head}radio = BLERadio(observe_channels=[1])\nwait(500)\nprint(radio.observe(1))\n"
    first, second = pybricks_hub.run_together(sender, listener + "1 / 0\n")
    assert (first.exit_code, first.output, first.errors) == (0, "", "")
    assert (second.exit_code, second.output) == (1, "5\n") and "ZeroDivision" in second.errors


@pytest.mark.parametrize(
    ("robots", "says"),
    [
        (
            "walker",
            r"robots are 'walker'; give a list of names, such as \['two-wheeler', 'scout'\]",
        ),
        (["bench", 3], r"robots are \['bench', 3\]; give a list of names"),
        (["bench"], "1 robot for 2 programs; name one for each"),
        (["bench"] * 3, "3 robots for 2 programs; name one for each"),
        (["bench"] * 2, "robots that share a world need bodies: install bricktwin; or name no"),
    ],
)
def test_robots_of_several_programs_are_names_of_bodies(
    pybricks_hub: PybricksHub, monkeypatch: pytest.MonkeyPatch, robots: Any, says: str
) -> None:
    # As where no other house is installed.
    monkeypatch.setattr("brickhub.target._finder", lambda: find_in_files)
    with pytest.raises(DescriptionError, match=f"^{says}"):
        pybricks_hub.run_together("print(1)\n", "print(2)\n", robots=robots)
    first, second = pybricks_hub.run_together("print(1)\n", "print(2)\n")
    assert (first.output, second.output) == ("1\n", "2\n")
    assert not first.timed_out


def test_several_programs_end_at_their_time(pybricks_hub: PybricksHub) -> None:
    loop = "from pybricks.tools import wait\nwhile True:\n    wait(10)\n"
    runs = pybricks_hub.run_together(loop, "print('end')\n", time_limit_s=1.0)
    assert [run.exit_code for run in runs] == [124, 0]
    assert [run.timed_out for run in runs] == [True, False]
    assert runs[1].output == "end\n"


def test_input_may_be_bytes_and_output_none_of_utf_8(pybricks_hub: PybricksHub) -> None:
    program = (
        "from usys import stdin, stdout\n"
        "read = stdin.buffer.read(2)\nstdout.buffer.write(read + b'\\xffz')\n"
    )
    run = pybricks_hub.run(program, stdin=b"ab")
    assert run.output.endswith("ab\ufffdz")
