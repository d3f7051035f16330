"""Programs in LEGO's own languages are named for what they are, line by line; Pybricks' are not."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.cli import main
from brickhub.hub.program.lego_languages import LANGUAGES, language_note, language_of, other_lines
from brickhub.hub.program.run_program import load_program
from brickhub.hub.transport import HubModule, HubProgram
from brickhub.virtual.run import run_file

ROOT = Path(__file__).parents[5]
SPIKE_2 = """\
hub.light_matrix.show_image('HAPPY')
hub.status_light.on('blue')
hub.speaker.beep(60, 0.5)
turned = hub.motion_sensor.get_yaw_angle()
hub.left_button.wait_until_pressed()
motor = Motor('A'); motor.run_for_rotations(2, 75)
motor.run_to_position(90, 'shortest path', 50)
pair = MotorPair('A', 'B'); pair.move(20, 'cm', steering=30)
pair.start_tank(40, 60)
seen = ColorSensor('C').get_reflected_light()
far = DistanceSensor('D').get_distance_cm()
while not ForceSensor('E').is_pressed(): wait_for_seconds(0.1)
"""
SPIKE_3 = """\
runloop.run(main())
motor.run(port.A, 500)
motor.run_for_degrees(port.A, 360, 720)
motor_pair.pair(motor_pair.PAIR_1, port.A, port.B)
motor_pair.move_tank_for_degrees(motor_pair.PAIR_1, 360, 500, 500)
seen = color_sensor.reflection(port.C)
far = distance_sensor.distance(port.D)
hit = force_sensor.pressed(port.E)
light_matrix.write('Hi')
sound.beep(440, 1000, 100)
yaw = motion_sensor.tilt_angles()[0]
left = button.pressed(button.LEFT)
"""
HUB_MODULE = """\
hub.port.A.motor.run_at_speed(50)
hub.display.show(hub.Image.HEART)
yaw = hub.motion.yaw_pitch_roll()[0]
hub.sound.beep(440)
hub.button.left.is_pressed()
hub.led(9)
level = hub.battery.capacity_left()
hub.display.clear()
seen = hub.port.B.device.get()[0]
hub.port.C.motor.brake()
named = hub.info()
link = hub.BT_VCP()
"""
EV3DEV = """\
LargeMotor('outA').on_for_rotations(75, 5)
MediumMotor('outB').run_forever(speed_sp=400)
tank = MoveTank('outA', 'outB')
tank.on_for_degrees(50, 50, 360)
steering = MoveSteering('outA', 'outB')
hit = TouchSensor().is_pressed
seen = ColorSensor().reflected_light_intensity
far = UltrasonicSensor().distance_centimeters
turned = GyroSensor().angle
Sound().speak('hello')
Leds().set_color('LEFT', 'GREEN')
Button().wait_for_bump('left')
"""
HEADS = {
    "LEGO's SPIKE app 2": "from spike import *\nfrom spike.control import *\nhub = PrimeHub()\n",
    "LEGO's MINDSTORMS app (Robot Inventor)": (
        "from mindstorms import *\nfrom mindstorms.control import *\nhub = MSHub()\n"
    ),
    "LEGO's SPIKE app 3": (
        "import runloop, motor, motor_pair, color_sensor, distance_sensor, force_sensor\n"
        "from hub import port, light_matrix, sound, motion_sensor, button\n"
        "async def main(): await runloop.sleep_ms(100)\n"
    ),
    "the hub module of LEGO's SPIKE app 2 or MINDSTORMS app": "import hub\n",
    "ev3dev, another system for the EV3": (
        "from ev3dev2.motor import *\nfrom ev3dev2.sensor.lego import *\n"
        "from ev3dev2.sound import *\n"
    ),
}
BODIES = dict(zip(HEADS, (SPIKE_2, SPIKE_2, SPIKE_3, HUB_MODULE, EV3DEV), strict=True))
PROGRAMS = [(name, line) for name, body in BODIES.items() for line in body.splitlines()]


@pytest.mark.parametrize(("name", "line"), PROGRAMS)
def test_a_program_is_named_for_what_it_is_and_its_line_too(name: str, line: str) -> None:
    program = HubProgram(f"{HEADS[name]}{line}\n", 0)
    language = language_of(program)
    assert language is not None and language.name == name
    last = HEADS[name].count("\n") + 1
    assert [number for number, _, _ in other_lines(program, language)].count(last) >= 1


def test_sixty_programs() -> None:
    assert len(PROGRAMS) == 60 and {name for name, _ in PROGRAMS} == {
        language.name for language in LANGUAGES
    }


@pytest.mark.parametrize(
    "source",
    [
        "from pybricks.hubs import PrimeHub\nfrom spike import Motor\n",
        "import color\nprint(color.name)\n",
        "from motors import left\n",
        "import hubs\n",
        "x = 'from spike import Motor'\n",
        "from .hub import port\n",
        "this is no program",
        "import motor\nmotor.go()\n",
        "from hub import spokes\n",
        "try:\n    import hub\nexcept ImportError:\n    hub = None\n",
    ],
)
def test_others_are_not(source: str) -> None:
    assert language_note(HubProgram(source, 0)) == ""


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("import motor as m\nfrom hub import port as p\nm.run(p.A, 500)\n", [2, 3]),
        ("from motor import run as go\nfrom hub import port\ngo(port.A, 500)\n", [1, 2]),
        ("import hub\nhub.light_matrix.write('Hi')\nport = hub.port.A\n", [2, 3]),
        ("import runloop, time\ntime.sleep_ms(100)\n", [1, 2]),
    ],
)
def test_other_names_of_modules_are_followed(source: str, lines: list[int]) -> None:
    program = HubProgram(source, 0)
    language = language_of(program)
    assert language is not None and language.name == "LEGO's SPIKE app 3"
    assert sorted({line for line, _, _ in other_lines(program, language)}) == lines


def test_own_module_of_that_name_is_no_sign() -> None:
    own = HubModule("motor", "motor.py", "SPEED = 500\n")
    assert language_note(HubProgram("import motor\nprint(motor.SPEED)\n", 0, modules=(own,))) == ""


def test_no_program_of_ours_is_named() -> None:
    ours = [
        *ROOT.glob("examples/*.py"),
        *ROOT.glob("packages/bricktwin/src/bricktwin/site/programs/*.py"),
        *ROOT.glob("packages/brickhub/tests/**/*.py"),
    ]
    named = [path.name for path in ours if language_note(load_program(path))]
    assert len(ours) > 50 and named == []


def test_a_real_hub_is_not_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "main.py"
    path.write_text("import runloop\n")
    assert main(("run", str(path), "--hub", "ble")) == 2
    assert f"error: {path} is for LEGO's SPIKE app 3, which a hub" in capsys.readouterr().err


def test_what_a_run_says(tmp_path: Path) -> None:
    path = tmp_path / "main.py"
    path.write_text("from spike import Motor\nmotor = Motor('A')\nmotor.start(50)\n")
    err = io.StringIO()
    assert run_file(path, stdout=io.BytesIO(), stderr=err) == 1
    said = err.getvalue()
    assert "ImportError: no module named 'spike'" in said
    assert "This program is for LEGO's SPIKE app 2; Pybricks has other names:\n" in said
    assert "  line 2: Motor: Motor(Port.A) of pybricks.pupdevices" in said
