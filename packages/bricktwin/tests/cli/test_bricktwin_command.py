"""The command ``bricktwin`` as a whole, and ``bricktwin run`` with our robots, plans and users'
files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from in_process import assert_explained

import bricktwin as package
from brickhub.pytest_plugin import PybricksHub
from bricktwin.cli.command_table import LINE
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body

PLAN = Path(__file__).parents[4] / "examples" / "13_front_steered.ldr"
COMMANDS = ("run", "plan check", "plan parts", "plan steps", "twin record", "twin fit")


def test_version_and_help(bricktwin) -> None:
    assert bricktwin("--version") == (0, f"bricktwin {package.__version__}\n", "")
    overview = bricktwin("--help")
    assert overview.code == 0 and all(
        f"• {command} " in overview.out for command in ("run", "plan", "twin")
    )
    for command in COMMANDS:
        told = bricktwin(*command.split(), "--help")
        assert told.code == 0 and f"\n  bricktwin {command} " in told.out, command


def test_help_explains_each_option(bricktwin) -> None:
    commands = [[name] for name in LINE.commands]
    commands += [[group, name] for group, (_, names) in LINE.groups.items() for name in names]
    assert len(commands) == 12
    for command in commands:
        assert_explained(bricktwin(*command, "--help").out)


def test_python_runs_the_package_as_the_command() -> None:
    command = [sys.executable, "-m", "bricktwin", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        0,
        f"bricktwin {package.__version__}\n",
        "",
    )


def test_help_imports_no_mujoco() -> None:
    script = (
        "import sys\n"
        "from bricktwin.cli import main\n"
        f"for command in ('', *{COMMANDS!r}):\n"
        "    try:\n"
        "        main([*command.split(), '--help'])\n"
        "    except SystemExit as end:\n"
        "        assert not end.code, end.code\n"
        "    print('loaded by', command, *sorted(set(sys.modules) & {'matplotlib', 'mujoco', "
        "'scipy', 'torch', 'bricksrl'}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    assert all(f"loaded by {command}".rstrip() in lines for command in ("", *COMMANDS))


DRIVE = """
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
motor = Motor(Port.A)
motor.run_angle(500, 90)
print(abs(motor.angle() - 90) <= 5)
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "main.py"
    path.write_text(DRIVE)
    return path


@pytest.mark.parametrize("robot", ["walker", "two-wheeler", "bench", str(PLAN)])
def test_program_runs_on_robots_and_plans(bricktwin, program: Path, robot: str) -> None:
    assert bricktwin("run", str(program), "--robot", robot) == (0, "True\n", "")


def test_robot_in_a_users_file_has_a_body(bricktwin, program: Path, tmp_path: Path) -> None:
    robot = tmp_path / "car.py"
    robot.write_text(
        "from brickhub.robot import *\n"
        "CAR = Robot('car', HubKind.PRIME, (Motor('left', 'A', "
        "direction=Direction.COUNTERCLOCKWISE), Motor('right', 'B')),\n"
        "            drive_base=DriveBase('left', 'right', 56, 112), needs_imu=True)\n"
    )
    program.write_text(
        "from pybricks.hubs import PrimeHub\nfrom pybricks.parameters import Direction, Port\n"
        "from pybricks.pupdevices import Motor\nfrom pybricks.robotics import DriveBase\n"
        "hub, left = PrimeHub(), Motor(Port.A, Direction.COUNTERCLOCKWISE)\n"
        "DriveBase(left, Motor(Port.B), 56, 112).turn(90)\n"
        "print(abs(hub.imu.heading() - 90) < 10)\n"
    )
    assert bricktwin("run", str(program), "--robot", f"{robot}:CAR") == (0, "True\n", "")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ("--robot", "dog"),
            (
                "there is no robot 'dog'; choose two-wheeler, scout, cart, ev3-driver, walker, "
                "robo-arm, bench, "
                "or name a file"
            ),
        ),
        (("--robot", "rover.ldr"), "there is no file rover.ldr in"),
        (("--robot", "nowhere.py"), "no file nowhere.py"),
        (("--robot", "walker", "--reading", "B=red"), "--robot bench"),
        (("--robot", "cart"), "'cart' is of LEGO's kits"),
        (("--robot", "bench", "--video", "a.mp4"), "nothing to see of robot 'bench'"),
        (("--hub", "ble", "--video", "a.mp4"), "leave out --hub, or --video"),
    ],
)
def test_mismatched_options_print_one_line(
    fails, program: Path, options: tuple[str, ...], says: str
) -> None:
    fails("run", str(program), *options, says=says)


ROVER = """from brickhub.robot import DriveBase, HubKind, Motor, Mount, PoweredUpSensor, Robot, SensorKind
from bricktwin.twin.objects import Line
from bricktwin.twin.scene import Scene

LIGHT = PoweredUpSensor("light", "C", SensorKind.COLOR, Mount((30, 0, 12), "down"))
CAR = Robot("car", HubKind.PRIME, (Motor("left", "A"), Motor("right", "B")), (LIGHT,), DriveBase("left", "right", 56, 112))
MAT = Scene(objects=(Line(points_mm=((-100.0, 0.0), (300.0, 0.0)), color="red", width_mm=60),))
"""  # noqa: E501
SEES = """from pybricks.parameters import Port
from pybricks.pupdevices import ColorSensor
print(ColorSensor(Port.C).color())
"""
OTHERS = "from rover import CAR, MAT\nOTHER = type(MAT)(light_pct=50)\n"
NOTE = "others.py has scenes MAT, OTHER, and none is taken; name one: --scene others.py:MAT\n"


@pytest.mark.parametrize(
    ("options", "out", "err"),
    [
        (("--robot", "rover.py"), "Color.RED\n", ""),
        (("--robot", "rover.py:CAR"), "Color.RED\n", ""),
        (("--robot", "bare.py"), "Color.WHITE\n", ""),
        (("--robot", "bare.py", "--scene", "rover.py"), "Color.RED\n", ""),
        (("--robot", "others.py"), "Color.WHITE\n", NOTE),
        (("--robot", "others.py", "--scene", "others.py:MAT"), "Color.RED\n", ""),
        (("--robot", "rover.py", "--scene", "others.py:OTHER"), "Color.WHITE\n", ""),
    ],
)
def test_scene_of_a_file_is_taken(bricktwin, tmp_path, monkeypatch, options, out, err):
    monkeypatch.chdir(tmp_path)
    for name, text in (
        ("rover", ROVER),
        ("bare", "from rover import CAR\n"),
        ("others", OTHERS),
        ("main", SEES),
    ):
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.delitem(sys.modules, "rover", raising=False)
    assert bricktwin("run", "main.py", *options) == (0, out, err)


NAMELESS = (
    "lists.py has scenes MATS['red'], MATS['bare'], and none is taken; give one a name, "
    "MAT = MATS['red'], and name it: --scene lists.py:MAT\n"
)


@pytest.mark.parametrize(
    ("scenes", "out", "err"),
    [
        ("MATS = [MAT]; del MAT", "Color.RED\n", ""),
        ("MATS = (MAT,); del MAT", "Color.RED\n", ""),
        ("MATS = {'red': MAT}; del MAT", "Color.RED\n", ""),
        ("MATS = {'red': [(MAT,)]}; del MAT", "Color.RED\n", ""),
        ("MATS = [MAT]; MATS.append(MATS)", "Color.RED\n", ""),
        (
            "MATS = [MAT, Scene()]",
            "Color.RED\n",
            "lists.py has the scene MAT, which is taken, and MATS[1], not taken\n",
        ),
        (
            "MATS = {'red': MAT, 'bare': Scene()}; del MAT",
            "Color.WHITE\n",
            NAMELESS,
        ),
    ],
)
def test_scene_in_a_list_is_taken_or_named(bricktwin, tmp_path, monkeypatch, scenes, out, err):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lists.py").write_text(ROVER + scenes + "\n")
    (tmp_path / "bare.py").write_text(ROVER + "del MAT\n")
    (tmp_path / "main.py").write_text(SEES)
    assert bricktwin("run", "main.py", "--robot", "lists.py") == (0, out, err)
    if "RED" in out:
        named = bricktwin("run", "main.py", "--robot", "bare.py", "--scene", "lists.py")
        assert named == (0, out, "")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ("--robot", "rover.py", "--scene", "rover.py:CAR"),
            "rover.py:CAR is not a scene; name a Scene",
        ),
        (("--robot", "rover.py", "--scene", "mat"), "'mat' is not a scene; choose line-simple"),
        (
            ("--robot", "bench", "--scene", "rover.py"),
            "'bench' lies on the bench, which is in no scene",
        ),
        (("--hub", "ble", "--scene", "rover.py"), "leave out --hub, or --scene"),
        (
            ("--robot", "rover.py", "--end-stop", "D=-9..9"),
            "'car' has no motor on port D for an end stop; it has motors on A, B",
        ),
    ],
)
def test_scene_or_stop_that_cannot_be_is_refused(bricktwin, tmp_path, monkeypatch, options, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.py").write_text(ROVER)
    (tmp_path / "main.py").write_text(SEES)
    done = bricktwin("run", "main.py", *options)
    assert (done.code, done.out) == (2, "")
    assert says in done.err


def test_homing_that_nothing_stops_is_said(bricktwin, tmp_path):
    program = tmp_path / "home.py"
    program.write_text(
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import Motor\n"
        "Motor(Port.D).run_until_stalled(200)\n"
    )
    done = bricktwin("run", str(program), "--robot", "walker", "--time-limit-s", "0.2")
    assert "in this twin nothing does: give --end-stop D=-90..90\n" in done.err  # its motor alone
    stops = [word for port in "ABCD" for word in ("--end-stop", f"{port}=-5..5")]
    assert bricktwin("run", str(program), "--robot", "walker", *stops) == (0, "", "")


CONTROLLER = """
from pybricks.messaging import BLERadio
from pybricks.tools import wait
radio = BLERadio(broadcast_channel=1, observe_channels=[2])
for speed in (200, -100):
    radio.broadcast(speed)
    wait(1500)
    print(radio.observe(2), radio.signal_strength(2))
"""
DRIVER = """
from pybricks.messaging import BLERadio
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
radio = BLERadio(broadcast_channel=2, observe_channels=[1])
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
speed = None
while speed is None:
    speed = radio.observe(1)
    wait(5)
while speed is not None:
    base.drive(speed, 0)
    radio.broadcast(base.distance())
    wait(20)
    speed = radio.observe(1)
base.stop()
"""


def test_robots_of_several_programs_share_a_world(bricktwin, fails, tmp_path: Path) -> None:
    files = []
    for name, text in (("controller", CONTROLLER), ("driver", DRIVER)):
        (tmp_path / f"{name}.py").write_text(text)
        files.append(str(tmp_path / f"{name}.py"))
    robots = ("--robot", "two-wheeler", "--robot", "scout")
    done = bricktwin("run", *files, *robots)
    ahead, back = (line.removeprefix("controller: ").split() for line in done.out.splitlines())
    assert 200 < int(ahead[0]) < 300 and int(back[0]) < int(ahead[0])
    assert -55 < int(ahead[1]) < -45, "half a metre apart, and more"
    fails("run", *files, "--robot", "scout", says="there are 2 programs and 1 robot;")
    fails("run", *files, "--robot", "robo-arm", "--robot", "scout", says="stands on a fixed base")
    fails("run", files[0], *robots, says="--robot is named 2 times for one program")
    fails("run", *files, "--scene", "maze", says="a scene of several hubs needs their robots")
    fails("run", *files, *robots, "--scene", "wall", says="a wall before its sensor")


def test_robots_of_several_programs_share_a_scene(bricktwin, tmp_path: Path) -> None:
    files = []
    for name, text in (("controller", CONTROLLER), ("driver", DRIVER)):
        (tmp_path / f"{name}.py").write_text(text)
        files.append(str(tmp_path / f"{name}.py"))
    robots = ("--robot", "two-wheeler", "--robot", "scout")
    done = bricktwin("run", *files, *robots, "--scene", "sumo")
    (distance, signal), _ = (
        line.removeprefix("controller: ").split() for line in done.out.splitlines()
    )
    # They look at each other, 340 mm apart, and the second one drives up to the first.
    assert int(distance) < 300
    assert -50 < int(signal) < -30


def test_surroundings_of_a_robot_are_not_dropped_where_several_share_a_world(
    fails, program: Path, tmp_path: Path
) -> None:
    rover = tmp_path / "rover.py"
    rover.write_text(ROVER)
    robots = ("--robot", "scout", "--robot", str(rover))
    says = f"{rover} has surroundings, and robots that share a world have one scene for all"
    fails("run", str(program), str(program), *robots, says=says)


OWN = """
from brickhub.virtual.own_devices import OwnDevice, OwnMode, OwnUart

def compass(robot):
    read = lambda _: [round(robot.x_mm()), round(robot.y_mm()), round(robot.heading_deg())]
    return OwnDevice(201, (OwnMode("PLACE", read, 3),))

def echo(robot):
    return OwnUart(lambda written, time_s: written.upper())
"""
MEASURED = """
from pybricks.iodevices import PUPDevice, UARTDevice
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
place, uart = PUPDevice(Port.F), UARTDevice(Port.D, 9600)
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
base.straight(200)
base.turn(90)
x, y, heading = place.read(0)
print(abs(x - 200) < 15, abs(y) < 15, abs(heading - 90) < 5)
uart.write(b"hello")
wait(50)
print(uart.read(5))
"""


def test_devices_of_ones_own_measure_a_robot_with_a_body(
    bricktwin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pybricks_hub: PybricksHub
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN)
    Path("main.py").write_text(MEASURED)
    ports = ("--port", "F=own.py:compass", "--port", "D=own.py:echo")
    expected = "True True True\nb'HELLO'\n"
    assert bricktwin("run", "main.py", "--robot", "two-wheeler", *ports) == (0, expected, "")
    names: dict[str, Any] = {}
    exec(OWN, names)  # noqa: S102  our own text
    devices = {"F": names["compass"], "D": names["echo"]}
    # The same in a test, of a robot by its name and of a body.
    for robot in ("two-wheeler", make_body(TWO_WHEELER)):
        run = pybricks_hub.run(MEASURED, robot=robot, own_devices=devices)
        assert (run.output, run.errors) == (expected, "")


BY_I2C = """
from brickhub.virtual.own_devices import OwnI2c

def compass(robot):
    def read(register, length, time_s):
        # Two bytes at 0x42, as the HiTechnic compass has them: half of the heading, and the rest.
        half, rest = divmod(round(robot.heading_deg()) % 360, 2)
        return bytes([half, rest])[:length] if register == 0x42 else bytes(length)
    return OwnI2c(0x01, read)
"""
TURNS_BY_I2C = """
from pybricks.ev3devices import Motor, TouchSensor, UltrasonicSensor
from pybricks.iodevices import I2CDevice
from pybricks.parameters import Port
from pybricks.robotics import DriveBase
compass = I2CDevice(Port.S1, 0x01)
base = DriveBase(Motor(Port.B), Motor(Port.C), 56, 120)

def heading():
    half, rest = compass.read(0x42, 2)
    return 2 * half + rest

print(heading())
base.turn(90)
print(abs(heading() - 90) < 10, UltrasonicSensor(Port.S4).distance() > 0)
try:
    TouchSensor(Port.S1)
except OSError as error:
    print(error.args[0])
"""


def test_an_i2c_device_of_ones_own_takes_the_place_of_a_sensor_of_a_robot_with_a_body(
    bricktwin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(BY_I2C)
    Path("main.py").write_text(TURNS_BY_I2C)
    robot = ("--robot", "ev3-driver")
    done = bricktwin("run", "main.py", *robot, "--port", "S1=own.py:compass")
    assert done == (0, "0\nTrue True\n19\n", "")
    done = bricktwin("run", "main.py", *robot, "--port", "B=own.py:compass")
    assert done.code == 2
    assert "port B of 'ev3-driver' has a motor; plug your device into another port" in done.err
