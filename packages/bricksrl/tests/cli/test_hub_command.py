"""``bricksrl hub``."""

from __future__ import annotations

import ast
import re
import signal
import subprocess
import sys
import time

import pytest

from brickhub.hub.program.generate import generate
from bricksrl.envs import get_task


def test_program_equals_generated_one(bricksrl):
    done = bricksrl("hub", "program", "RunAway-v0")
    assert (done.returncode, done.stderr) == (0, "")
    task = get_task("RunAway-v0")
    assert done.stdout.strip() == generate(task.robot, task.interface).source.strip()
    ast.parse(done.stdout)


def test_program_of_unknown_environment_prints_one_line(fails):
    fails("hub", "program", "RunAwya-v0", says="there is no environment 'RunAwya-v0'")


HELLO = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.tools import wait
motor = Motor(Port.A)
motor.run_angle(500, 90)
print("turned", motor.angle())
"""


def test_run_in_scene_of_environment(bricksrl, tmp_path):
    look = "from pybricks.parameters import Port\nfrom pybricks.pupdevices import UltrasonicSensor\n"
    path = tmp_path / "look.py"
    path.write_text(look + "print(UltrasonicSensor(Port.C).distance())")
    distances = [int(bricksrl("hub", "run", str(path), "--robot", robot).stdout) for robot in ("RunAway-v0", "two-wheeler")]
    assert 40 <= distances[0] <= 500 and distances[1] == 2000


def test_run_on_unknown_robot_prints_one_line(fails, tmp_path):
    (tmp_path / "look.py").write_text("print(1)")
    fails(
        "hub",
        "run",
        str(tmp_path / "look.py"),
        "--robot",
        "Nonsense",
        says="there is no environment 'Nonsense'",
    )


def test_run_prints_program_output(bricksrl, tmp_path):
    path = tmp_path / "main.py"
    path.write_text(HELLO)
    done = bricksrl("hub", "run", str(path), "--robot", "bench")
    assert (done.returncode, done.stderr) == (0, "")
    word, angle = done.stdout.split()
    assert word == "turned"
    assert abs(int(angle) - 90) <= 5


def test_run_of_failing_program_prints_traceback(bricksrl, tmp_path):
    path = tmp_path / "main.py"
    path.write_text("print('before')\n1 / 0\n")
    done = bricksrl("hub", "run", str(path), "--robot", "bench")
    assert done.returncode == 1
    assert done.stdout.split() == ["before"]
    assert done.stderr.startswith("Traceback (most recent call last):\n")
    assert "line 2" in done.stderr
    assert "ZeroDivisionError" in done.stderr.splitlines()[-1]
    assert "bricksrl" not in done.stderr


def test_run_ends_at_its_time_limit(bricksrl, tmp_path):
    path = tmp_path / "main.py"
    path.write_text("from pybricks.tools import wait\nprint('on')\nwhile True:\n    wait(100)\n")
    done = bricksrl("hub", "run", str(path), "--robot", "bench", "--time-limit-s", "5")
    assert (done.returncode, done.stdout, done.stderr) == (0, "on\n", "The program was stopped (SystemExit).\n")


def test_run_passes_stdin(tmp_path):
    path = tmp_path / "main.py"
    path.write_text("from usys import stdin\nprint(stdin.read(3))\n")
    command = [sys.executable, "-m", "bricksrl", "hub", "run", str(path), "--robot", "bench"]
    done = subprocess.run(command, input="abc", capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "abc\n", "")


def test_run_passes_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "main.py"
    path.write_text("from usys import stdin\nprint(stdin.buffer.read(3) == b'\\xff\\xfeA')\n")
    command = [sys.executable, "-m", "bricksrl", "hub", "run", str(path), "--robot", "bench"]
    done = subprocess.run(command, input=b"\xff\xfeA", capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, b"True", b"")


def test_run_does_not_wait_for_unused_input(tmp_path):
    path = tmp_path / "main.py"
    path.write_text("print('done')\n")
    command = [sys.executable, "-m", "bricksrl", "hub", "run", str(path), "--robot", "bench"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:  # the pipe stays open
        assert child.wait(timeout=60) == 0
        assert child.stdout.read() == b"done\n"


def test_ctrl_c_stops_a_program(start, tmp_path):
    path = tmp_path / "main.py"
    path.write_text("from pybricks.tools import wait\nprint('on')\nwhile True:\n    wait(1000)\n")
    child = start("hub", "run", str(path), "--robot", "bench")
    time.sleep(3)
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=60)
    assert child.returncode == 130
    assert re.fullmatch(r"interrupted: [^\n]+\n", stderr)


@pytest.mark.parametrize(("arguments", "says"), [(("nothing.py",), "nothing.py"), ((__file__, "--robot", "dog"), "dog")])
def test_wrong_files_and_robots_print_one_line(fails, arguments, says):
    fails("hub", "run", *arguments, says=says)


def test_run_provides_used_devices(bricksrl, tmp_path):
    path = tmp_path / "main.py"
    path.write_text(
        "from pybricks.hubs import TechnicHub\nfrom pybricks.pupdevices import *\nfrom pybricks.parameters import *\n"
        "from pybricks.tools import wait\nhub = TechnicHub()\narm, eye = Motor(Port.A), ColorSensor(Port.B)\n"
        "hub.light.on(Color.RED)\nprint(eye.color(), arm.run_until_stalled(300, duty_limit=50))\nwait(10000)\n"
    )
    options = ("--reading", "B=red", "--end-stop", "A=-90..120", "--press", "center@5s", "--panel")
    done = bricksrl("hub", "run", str(path), *options)
    assert (done.returncode, done.stdout) == (0, "Color.RED 120\n")
    assert "hue 0, 100 %, 100 %" in done.stderr and "stopped (SystemExit)" in done.stderr


def test_run_takes_a_robot_from_a_file(bricksrl, tmp_path):
    robot, program = tmp_path / "arm.py", tmp_path / "main.py"
    robot.write_text(
        "from bricksrl.robots import HubKind, Motor, Robot\nARM = Robot('arm', HubKind.CITY, motors=(Motor('joint', 'B'),))\n"
    )
    program.write_text(
        "from pybricks.hubs import CityHub\nfrom pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "joint = Motor(Port.B)\njoint.run_angle(500, 90)\nprint(joint.angle() in (89, 90))\n"
    )
    for reference in (str(robot), f"{robot}:ARM"):
        done = bricksrl("hub", "run", str(program), "--robot", reference)
        assert (done.stdout, done.stderr) == ("True\n", "")


def test_run_takes_the_scene_of_the_task_beside_the_robot(bricksrl, tmp_path):
    robot, program = tmp_path / "my_robot.py", tmp_path / "main.py"
    assert bricksrl("new", "robot", str(robot)).returncode == 0  # its light has no reading but that of the task's scene
    program.write_text(
        "from pybricks.pupdevices import ColorSensor\nfrom pybricks.parameters import Port\n"
        "print(ColorSensor(Port.B).reflection())\n"
    )
    done = bricksrl("hub", "run", str(program), "--robot", str(robot))
    assert (done.stdout, done.stderr) == ("10\n", "")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--press", "left"), "'left' is not a button press"),
        (("--press", "up@1s"), "no button 'up'"),
        (("--reading", "B"), "'B' is not a reading"),
        (("--end-stop", "C=10..20"), "starts at 0"),
        (("--end-stop", "C"), "not a pair of end stops"),
        (("--robot", "nowhere.py"), "no file nowhere.py"),
        (("--robot", "rover.ldr"), "rover.ldr: No such file"),
        (("--hub", "ble", "--press", "left@1s"), "leave out --hub"),
        (("--robot", "walker", "--reading", "B=red"), "--robot bench"),
    ],
)
def test_run_with_mismatched_options_raises(fails, tmp_path, options, says):
    path = tmp_path / "main.py"
    path.write_text("")
    fails("hub", "run", str(path), *options, says=says)
