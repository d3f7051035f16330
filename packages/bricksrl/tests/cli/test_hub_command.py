"""``bricksrl hub``."""

from __future__ import annotations

import ast
from contextlib import ExitStack
from pathlib import Path

import pytest

from brickhub.hub.program.generate import generate
from bricksrl.cli.hub_run import Run
from bricksrl.envs import get_task
from bricksrl.errors import DescriptionError


def test_program_equals_generated_one(bricksrl):
    done = bricksrl("hub", "program", "RunAway-v0")
    assert (done.returncode, done.stderr) == (0, "")
    task = get_task("RunAway-v0")
    assert done.stdout.strip() == generate(task.robot, task.interface).source.strip()
    ast.parse(done.stdout)


def test_program_of_unknown_environment_prints_one_line(fails):
    fails("hub", "program", "RunAwya-v0", says="there is no environment 'RunAwya-v0'")


def test_run_in_scene_of_environment(bricksrl, tmp_path):
    look = (
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import UltrasonicSensor\n"
    )
    path = tmp_path / "look.py"
    path.write_text(look + "print(UltrasonicSensor(Port.C).distance())")
    distances = [
        int(bricksrl("hub", "run", str(path), "--robot", robot).stdout)
        for robot in ("RunAway-v0", "two-wheeler")
    ]
    assert 40 <= distances[0] <= 500 and distances[1] == 2000


def test_surroundings_of_an_environment_are_not_dropped_where_several_share_a_world(
    fails, tmp_path
):
    path = tmp_path / "look.py"
    path.write_text("print(1)")
    programs = ("hub", "run", str(path), str(path))
    says = (
        "RunAway-v0 has surroundings, and robots that share a world have one scene for all; name "
        "its robot alone: two-wheeler"
    )
    fails(*programs, "--robot", "scout", "--robot", "RunAway-v0", says=says)


def test_run_on_unknown_robot_prints_one_line(fails, tmp_path):
    (tmp_path / "look.py").write_text("print(1)")
    fails(
        "hub",
        "run",
        str(tmp_path / "look.py"),
        "--robot",
        "Nonsense",
        says="there is no environment 'Nonsense'; choose one of",
    )


def test_run_takes_the_scene_of_the_task_beside_the_robot(bricksrl, tmp_path):
    robot, program = tmp_path / "my_robot.py", tmp_path / "main.py"
    # its light has no reading but that of the task's scene
    assert bricksrl("new", "robot", str(robot)).returncode == 0
    program.write_text(
        "from pybricks.pupdevices import ColorSensor\nfrom pybricks.parameters import Port\n"
        "print(ColorSensor(Port.B).reflection())\n"
    )
    done = bricksrl("hub", "run", str(program), "--robot", str(robot))
    assert (done.stdout, done.stderr) == ("6\n", "")


def test_run_takes_a_robot_from_a_file(bricksrl, tmp_path):
    robot, program = tmp_path / "arm.py", tmp_path / "main.py"
    robot.write_text(
        "from bricksrl.robots import HubKind, Motor, Robot\n"
        "ARM = Robot('arm', HubKind.CITY, motors=(Motor('joint', 'B'),))\n"
    )
    program.write_text(
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "print(Motor(Port.B).angle())"
    )
    done = bricksrl("hub", "run", str(program), "--robot", f"{robot}:ARM")
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--robot", "nowhere.py"), "no file nowhere.py"),
        (("--robot", "rover.ldr"), "there is no file rover.ldr in"),
        (("--hub", "ble", "--press", "left@1s"), "leave out --hub"),
        (("--hub", "ble", "--page"), "leave out --hub"),
        (("--robot", "walker", "--reading", "B=red"), "--robot bench"),
        (("--robot", "walker", "--page", "--realtime"), "the page has a pace of its own"),
        (("--robot", "walker", "--page", "--video", "x.mp4"), "the page has a pace of its own"),
    ],
)
def test_run_with_mismatched_options_raises(fails, tmp_path, options, says):
    path = tmp_path / "main.py"
    path.write_text("")
    fails("hub", "run", str(path), *options, says=says)


def test_programs_are_shown_while_they_run_only_where_a_page_is_asked_for():
    plain, paged = (Run(Path("main.py"), page=page) for page in (False, True))
    with ExitStack() as stack:
        assert plain.attend(stack) is None and plain.attend_in_room() is None
        assert callable(paged.attend(stack)) and callable(paged.attend_in_room())
        with pytest.raises(DescriptionError, match="name a robot for each program, or omit --page"):
            paged.bodies(stack)


def test_robots_of_an_arena_have_programs(bricksrl, fails) -> None:
    first, second = (bricksrl("hub", "program", name) for name in ("Tag-v0", "Tag-v0:runner"))
    assert first.stdout != second.stdout
    assert first.stdout == bricksrl("hub", "program", "Tag-v0:catcher").stdout
    assert "this is catcher; there are also Tag-v0:runner" in first.stderr and not second.stderr
    fails(
        "hub",
        "program",
        "Tag-v0:runer",
        says="Tag-v0 has no robot 'runer' (did you mean 'runner'?); it has catcher, runner",
    )


def test_own_device_on_the_robot_of_an_environment(bricksrl, tmp_path):
    (tmp_path / "own.py").write_text(
        "from brickhub.virtual.own_devices import OwnDevice, OwnMode\n"
        "def wheel(robot):\n"
        "    turned = OwnMode('TURNED', lambda time_s: [round(robot.angle_deg('A'))])\n"
        "    return OwnDevice(201, (turned,))\n"
    )
    path = tmp_path / "turn.py"
    path.write_text(
        "from pybricks.iodevices import PUPDevice\nfrom pybricks.pupdevices import Motor\n"
        "from pybricks.parameters import Port\nwheel, motor = PUPDevice(Port.F), Motor(Port.A)\n"
        "motor.run_angle(500, 90)\nprint(motor.angle() - wheel.read(0)[0])\n"
    )
    plug = f"F={tmp_path / 'own.py'}:wheel"
    done = bricksrl("hub", "run", str(path), "--robot", "RunAway-v0", "--port", plug)
    assert done.stdout == "0\n"
