"""Parts of generated programs, line by line, and what a description has to keep for them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from described import SPINNING, TWO_WHEELER

from brickhub.entry import Entry
from brickhub.errors import DescriptionError, ProgramError
from brickhub.hub.interface import (
    Distance,
    DriveAngle,
    DriveDistance,
    DriveSpeed,
    DriveTurnRate,
    Heading,
    HubLight,
    Interface,
    LightBrightness,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    RunDuty,
    RunSpeed,
    SensorReading,
    UntilDone,
    Wait,
)
from brickhub.hub.program.generate import (
    Goals,
    Place,
    generate,
    generate_alone,
    generate_trials,
    hub_line,
    sorted_imports,
    start_line,
    validate,
)
from brickhub.hub.transport import Pipe
from brickhub.robot import (
    Direction,
    DriveBase,
    HubKind,
    KitKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)

ROVER = Robot(
    "rover",
    HubKind.PRIME,
    (
        Motor("left", "E", direction=Direction.COUNTERCLOCKWISE),
        Motor("right", "A", gears=(12, 20), speed_limit_deg_s=500, acceleration_deg_s2=900),
        Motor("arm", "B", range_deg=(-30, 90), torque_limit_mnm=300, zero_deg=5),
        Motor("spare", "F"),
    ),
    (UltrasonicSensor("eyes", "C"), PoweredUpSensor("color", "D", SensorKind.COLOR)),
    needs_imu=True,
    hub_sides=("ahead", "down"),
)
INTERFACE = Interface(
    (RunSpeed("left", -100, 300), RunAngle("arm", -20, 40, 250), HubLight()),
    (
        Pitch(),
        Heading(),
        SensorReading("color", "hsv", 0, 360, "deg", "hue"),
        MotorAngle("arm", -30, 90),
        MotorAngle("right", -30, 90),
    ),
    Wait(80),
)


def part_of(source: str, first: str) -> list[str]:
    """Lines of a program from the one that begins so, up to two empty ones."""
    lines = source.splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith(first))
    part = []
    for index in range(start, len(lines)):
        if lines[index : index + 2] == ["", ""]:
            break
        part.append(lines[index])
    return part


def test_devices_are_made_in_the_order_of_the_robot() -> None:
    assert part_of(generate(ROVER, INTERFACE).source, "hub = ") == [
        "hub = PrimeHub(top_side=Axis.X, front_side=-Axis.Z)",
        "motor_left = Motor(Port.E, Direction.COUNTERCLOCKWISE)",
        "motor_right = Motor(Port.A, gears=[12, 20])",
        "motor_right.control.limits(speed=500, acceleration=900)",
        "motor_arm = Motor(Port.B)",
        # Within half a turn of the middle of the range, 30 degrees.
        "motor_arm.reset_angle((motor_arm.angle() - -145) % 360 + -150)",
        "motor_arm.control.limits(torque=300)",
        "motor_arm = Joint(motor_arm, -30, 90)",
        "sensor_color = ColorSensor(Port.D)",
        "",
        "MOVERS = [motor_left, motor_arm]",
    ]


def test_imports_are_those_of_what_is_used() -> None:
    source = generate(ROVER, INTERFACE).source
    imports = [line for line in source.splitlines() if line.startswith(("import ", "from "))]
    assert imports == [
        "from micropython import kbd_intr",
        "from pybricks.hubs import PrimeHub",
        "from pybricks.parameters import Axis, Color, Direction, Port",
        "from pybricks.pupdevices import ColorSensor, Motor",
        "from pybricks.tools import StopWatch",
        "from uselect import POLLIN, poll",
        "import ustruct",
        "from usys import stdin, stdout",
    ]


def test_imports_are_sorted_by_their_modules() -> None:
    lines = ["from b import z", "import c", "from a import y", "from b import a"]
    assert sorted_imports(lines) == [
        "from a import y",
        "from b import a",
        "from b import z",
        "import c",
    ]


def test_header_of_a_step_of_a_fixed_time() -> None:
    source = generate(ROVER, INTERFACE).source
    written_by = "written by BricksRL from the robot's description."
    assert [*part_of(source, "# Program of"), ""] == [
        f'# Program of the robot "rover" for the prime hub, {written_by}',
        "# Do not edit: it is written anew whenever the description changes.",
        "# Commands, in the order of the action:",
        "#   left: run at -100 to 300 deg/s",
        "#   arm: turn by -20 to 40 deg at 250 deg/s",
        "#   light: light of a hue of 0 to 359 deg",
        "# Channels, in the order of the observation:",
        "#   pitch, -90 to 90 deg",
        "#   heading, -180 to 180 deg",
        "#   color_hue, 0 to 360 deg",
        "#   arm_angle, -30 to 90 deg",
        "#   right_angle, -30 to 90 deg",
        "# It answers 80 ms after the commands started.",
        "",
        *(line for line in source.splitlines() if line.startswith(("from ", "import "))),
        "",
    ]
    waits = generate(ROVER, replace(INTERFACE, commands=(), settle=UntilDone(700))).source
    after = "or after 700 ms, when it stops those that have not."
    assert f"# It answers when all moves have ended, {after}" in waits.splitlines()


@pytest.mark.parametrize(
    ("settle", "lines"),
    [
        (
            Wait(80),
            [
                "UNTIL_DONE = False  # answer when all moves have ended",
                "SETTLE_MS = 80  # answer after this time in any case",
            ],
        ),
        (
            UntilDone(700),
            [
                "UNTIL_DONE = True  # answer when all moves have ended",
                "SETTLE_MS = 700  # answer after this time at the latest",
            ],
        ),
    ],
)
def test_constants_of_a_program(settle: Wait | UntilDone, lines: list[str]) -> None:
    interface = replace(INTERFACE, commands=INTERFACE.commands[1:], settle=settle)
    program = generate(ROVER, interface)
    definitions = "from the same definitions as on the host's side"
    assert part_of(program.source, "# The wire,") == [
        f"# The wire, {definitions}. Kinds of frames are ASCII letters.",
        "MAGIC = 0xA5",
        "CRC_POLYNOMIAL = 0x107",
        "HELLO = 72  # 'H'",
        "STOP = 83  # 'S'",
        "READ = 82  # 'R'",
        "WATCHDOG = 87  # 'W'",
        "STREAM = 84  # 'T'",
        "STOPPED = 1",
        "SILENCE = 2",
        # A clock, then a heading and an angle without range of 32 bits.
        'ANSWER_FORMAT = "<Hhihhi"',
        "COMMAND_BYTES = 7  # length of a data frame from the host",
        "CONTROL_BYTES = {HELLO: 4, STOP: 4, READ: 5, WATCHDOG: 6, STREAM: 6}",
        "PIECE_BYTES = 19  # what fits one notification",
        "HELLO_HEAD = bytes([MAGIC, 0, 72, 1])",
        "BYE_HEAD = bytes([MAGIC, 0, 66])",
        f"PROGRAM_HASH = {program.hash.to_bytes(4, 'little')!r}",
        'ACTION_FORMAT = "<hh"',
        "",
        *lines,
        "WATCHDOG_MS = 400  # silence that stops the motors",
        "END_MS = 10000  # further silence that ends the program",
    ]
    by_app_data = generate(ROVER, interface, Pipe.APP_DATA)
    assert by_app_data.pipe is Pipe.APP_DATA
    assert "SLOT_BYTES = 22  # of AppData" in by_app_data.source.splitlines()


def test_moves_and_channels_of_a_program() -> None:
    source = generate(ROVER, INTERFACE).source
    assert part_of(source, "def start_moves(")[2:] == [
        "    motor_left.run(whole(actions[0], -1000, 3000, 10))",
        "    motor_arm.turn(250, whole(actions[1], -200, 400, 10))",
        "    hub.light.on(Color(whole(actions[2], 0, 3590, 10), 100, 100))",
    ]
    assert part_of(source, "def read_channels(")[2:] == [
        "    pitch, roll = hub.imu.tilt()",
        "    read_color_hsv = sensor_color.hsv()",
        "    return ustruct.pack(",
        "        ANSWER_FORMAT,",
        "        time_ms,",
        "        wire(pitch * 100),",
        "        round(hub.imu.heading() * 10),",
        "        wire(read_color_hsv[0] * 10),",
        "        wire(motor_arm.angle() * 10),",
        "        round(motor_right.angle() * 10),",
        "    )",
    ]


DRIVER = Robot(
    "driver",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B")),
    (PoweredUpSensor("lamp", "C", SensorKind.LIGHT),),
    DriveBase("left", "right", 56.0, 112.0),
)


def test_drive_base_is_made_once_and_moves_by_one_call() -> None:
    interface = Interface(
        (DriveTurnRate(-50, 50), LightBrightness("lamp"), DriveSpeed(-200, 100)),
        (DriveDistance(-9, 9), DriveAngle(-9, 9)),
        Wait(50),
    )
    source = generate(DRIVER, interface).source
    assert part_of(source, "hub = ") == [
        "hub = PrimeHub()",
        "motor_left = Motor(Port.A)",
        "motor_right = Motor(Port.B)",
        "drive_base = DriveBase(motor_left, motor_right, wheel_diameter=56.0, axle_track=112.0)",
        "sensor_lamp = Light(Port.C)",
        "",
        "MOVERS = [drive_base]",
    ]
    speed = "whole(actions[2], -2000, 1000, 10)"
    assert part_of(source, "def start_moves(")[2:] == [
        f"    drive_base.drive({speed}, whole(actions[0], -500, 500, 10))",
        "    sensor_lamp.on(whole(actions[1], 0, 1000, 10))",
    ]
    assert "class Joint" not in source
    assert "class Joint" in generate(ROVER, INTERFACE).source
    # A joint that is only read needs no guard.
    assert "class Joint" not in generate(ROVER, replace(INTERFACE, commands=())).source


def test_motor_without_encoder_has_no_gears_on_the_hub() -> None:
    train = Robot("train", HubKind.CITY, (Motor("wheels", "B", MotorKind.TRAIN, gears=(12, 20)),))
    remote = Interface((RunDuty("wheels"),), (MotorAngle("wheels"),), Wait(50))
    with pytest.raises(DescriptionError, match="'wheels' is a train motor; use RunDuty"):
        validate(train, remote)
    seer = replace(train, sensors=(PoweredUpSensor("color", "A", SensorKind.COLOR),))
    reads = (SensorReading("color", "ambient", 0, 100),)
    source = generate(seer, replace(remote, channels=reads)).source
    assert "motor_wheels = DCMotor(Port.B)" in source.splitlines()


@pytest.mark.parametrize(
    ("motor", "line"),
    [
        (
            Motor("arm", "A", zero_deg=20),
            "motor_arm.reset_angle((motor_arm.angle() - -160) % 360 + -180)",
        ),
        (
            Motor("arm", "A", gears=(12, 36), zero_deg=-7),
            "motor_arm.reset_angle((motor_arm.angle() - -67) % 120 + -60)",
        ),
        # 7 turns of 3: no turn is of whole degrees.
        (
            Motor("arm", "A", gears=(7, 11), zero_deg=3),
            "motor_arm.reset_angle(motor_arm.angle() - 3)",
        ),
        (
            Motor("arm", "A", range_deg=(11, 100), zero_deg=1),
            "motor_arm.reset_angle((motor_arm.angle() - -124) % 360 + -125)",
        ),
    ],
)
def test_angle_from_a_calibrated_zero(motor: Motor, line: str) -> None:
    robot = Robot("one", HubKind.PRIME, (motor,))
    source = generate(robot, Interface((), (MotorAngle("arm"),), Wait(9))).source
    assert line in source.splitlines()
    described = replace(robot, motors=(replace(motor, zero_deg=0),))
    source = generate(described, Interface((), (MotorAngle("arm"),), Wait(9))).source
    assert "reset_angle" not in source


@pytest.mark.parametrize(
    ("sides", "line"),
    [
        (("up", "ahead"), "hub = PrimeHub()"),
        (("up", "left"), "hub = PrimeHub(top_side=Axis.Z, front_side=Axis.Y)"),
        (("back", "right"), "hub = PrimeHub(top_side=-Axis.X, front_side=-Axis.Y)"),
        (("down", "ahead"), "hub = PrimeHub(top_side=-Axis.Z, front_side=Axis.X)"),
    ],
)
def test_hub_knows_how_it_is_mounted(sides: tuple[str, str], line: str) -> None:
    robot = Robot("one", HubKind.PRIME, needs_imu=True, hub_sides=sides)
    assert hub_line(robot) == line
    source = generate(robot, Interface((), (Pitch(),), Wait(9))).source
    assert ("import Axis" in source) is (line != "hub = PrimeHub()")


POLICY = "import ustruct\n\n\ndef act(observed):\n    return [0.0, 0.0, 0.0]\n"


def alone(**options: Any) -> str:
    """A program that acts by itself, observing heading, arm and pitch."""
    return generate_alone(
        ROVER, INTERFACE, (1, 3, 0), POLICY, "a policy of three", 35, **options
    ).source


def test_program_that_acts_by_itself() -> None:
    program = generate_alone(ROVER, INTERFACE, (1, 3, 0), POLICY, "a policy of three", 35)
    source = program.source
    assert (program.hash, program.says_hello) == (0, False)
    head = source.splitlines()
    assert head[:2] == ["# A policy of three", "# Robot: rover"]
    assert "# It acts by itself, by a policy of three, until the center button is pressed." in head
    assert part_of(source, "UNTIL_DONE") == [
        "UNTIL_DONE = False  # a step ends when all moves have ended",
        "SETTLE_MS = 80  # and after this time in any case",
        "COUNTING = (0,)  # places of what counts from the start of the acting",
        "AGE_MS = 35  # age of an observation when its commands start",
        "# Middle and half of each command's range, times its scale.",
        "SPANS = ((1000.0, 2000.0), (100.0, 300.0), (1795.0, 1795.0))",
    ]
    assert part_of(source, "def observe(")[2:] == [
        "    pitch, roll = hub.imu.tilt()",
        "    return [",
        "        hub.imu.heading(),",
        "        motor_arm.angle(),",
        "        pitch,",
        "    ]",
    ]
    assert part_of(source, "def act(") == ["def act(observed):", "    return [0.0, 0.0, 0.0]"]
    # Imports of all parts come first, each once.
    imports = [line for line in head if line.startswith(("import ", "from "))]
    assert imports.count("import ustruct") == 1
    assert head.index("import ustruct") < head.index(
        "UNTIL_DONE = False  # a step ends when all moves have ended"
    )
    assert "GOALS" not in source
    assert "PLACE" not in source


def test_program_that_draws_goals_and_reckons_a_place() -> None:
    place = Place((0.0, 1.26, 90.0), (100.0, 0.0, 45.0), ("left", "right"), 2.04627748, 112.5)
    source = alone(goals=Goals(((0.0, 1.5), (1, 4)), 20), world="Room-v0", place=place)
    assert source.splitlines()[1] == "# Robot: rover Room-v0"
    assert part_of(source, "GOALS") == [
        "GOALS = ((0.0, 1.5), (1, 4))  # lowest and highest value; whole numbers if both are",
        "GOAL_STEPS = 20  # steps after which they are drawn anew",
    ]
    assert part_of(source, "# Where the robot is put") == [
        "# Where the robot is put, and where it is to go: mm along x and y, degrees clockwise.",
        "START = (0.0, 1.3, 90.0)",
        "PLACE = (100.0, 0.0, 45.0)",
        "DEG_PER_MM = 2.04628",
        "TRACK_MM = 112.5",
    ]
    assert part_of(source, "def wheels(") == [
        "def wheels():",
        "    return motor_left.angle(), motor_right.angle()",
    ]
    commanded = "COMMANDED[0] / 10, COMMANDED[1] / 10, COMMANDED[2] / 10"
    assert part_of(source, "def observe(")[-1] == f"    ] + goals() + [{commanded}] + seen_place()"
    only_goals = alone(goals=Goals(((0.0, 1.5),), 20))
    assert part_of(only_goals, "def observe(")[-1] == "    ] + goals()"


def test_start_is_told_to_a_tenth() -> None:
    assert start_line((0.04, -12.0, 359.96)) == "START = (0.0, -12.0, 360.0)"


BY_NUMBERS = "def act_by(observed, numbers):\n    return [0.0] * 3\n"


def test_program_of_trials() -> None:
    numbers = [Entry("a", -1.0, 1.0), Entry("b", 100.0, 360.0)]
    interface = replace(INTERFACE, channels=(*INTERFACE.channels, Roll()))
    program = generate_trials(ROVER, interface, numbers, BY_NUMBERS)
    lines = program.source.splitlines()
    assert "# It makes trials by itself, by numbers that it is told." in lines
    wanted = [
        f"PROGRAM_HASH = {program.hash.to_bytes(4, 'little')!r}",
        "END_HEAD = bytes([MAGIC, 0, 69])",
        'PIECE_FORMAT = "<hh"  # of a piece of a trial\'s numbers',
        "PIECES = 1",
        "RANGES = (  # middle, and half for the unit on the wire, of each number",
        # 1 and 130, each by 32767.
        "    (0, 3.051851e-05),",
        "    (230, 0.003967406),",
        ")",
        "",
        "UNTIL_DONE = False  # a step ends when all moves have ended",
        "SETTLE_MS = 80  # and after this time in any case",
        "# Middle and half of each command's range, times its scale.",
        "SPANS = ((1000.0, 2000.0), (100.0, 300.0), (1795.0, 1795.0))",
        "COUNTING = (1,)  # places of what counts from the start of the acting",
        "LIMITS = ((0, 35.0), (5, 35.0))  # index of a tilt, and where it ends a trial",
        "LONGEST_MS = 10000  # of a trial",
        "END_MS = 10000  # silence between trials that ends the program",
    ]
    start = lines.index(wanted[0])
    assert lines[start : start + len(wanted)] == wanted
    # A frame from the host carries steps, a piece's index and two numbers.
    assert "COMMAND_BYTES = 9  # length of a data frame from the host" in lines
    assert part_of(program.source, "def packed(")[2:] == [
        "    return ustruct.pack(",
        "        ANSWER_FORMAT,",
        "        time_ms,",
        "        wire(observed[0] * 100),",
        "        round(observed[1] * 10),",
        "        wire(observed[2] * 10),",
        "        wire(observed[3] * 10),",
        "        round(observed[4] * 10),",
        "        wire(observed[5] * 100),",
        "    )",
    ]
    tilting = generate_trials(ROVER, INTERFACE, numbers, BY_NUMBERS, tilt_deg=12.5).source
    assert "LIMITS = ((0, 12.5),)  # index of a tilt, and where it ends a trial" in tilting


def of_spinning(**changed: Any) -> Interface:
    return replace(SPINNING, **changed)


LEFT = RunAngle("left", -100, 100, 400)


@pytest.mark.parametrize(
    "interface",
    [
        of_spinning(settle=Wait(1)),
        of_spinning(settle=Wait(60_000)),
        of_spinning(commands=(RunAngle("left", -3276.7, 3276.7, 9),)),
        # Angle and speed of a drive are arguments of one call; a light moves nothing.
        of_spinning(commands=(DriveSpeed(-9, 9), DriveTurnRate(-9, 9), HubLight())),
        # An angle may be both commanded and read.
        of_spinning(commands=(LEFT,), channels=(MotorAngle("left"),)),
    ],
)
def test_interface_at_its_limits_is_valid(interface: Interface) -> None:
    validate(TWO_WHEELER, interface)


@pytest.mark.parametrize(
    ("interface", "message"),
    [
        (of_spinning(settle=Wait(0)), "the step settles after 0 ms; give 1 to 60000 ms"),
        (of_spinning(settle=Wait(60_001)), "the step settles after 60001 ms; give 1 to 60000 ms"),
        (
            of_spinning(commands=(RunAngle("left", -3276.7, 3276.8, 9),)),
            r"command 'left' ranges from -3276.7 to 3276.8; give low < high within \+-3276.7",
        ),
        (
            of_spinning(channels=(MotorAngle("left", 5, 5),)),
            r"channel 'left_angle' ranges from 5 to 5; give low < high within \+-3276.7",
        ),
        (of_spinning(channels=(Pitch(), Roll(), Pitch())), "channel 'pitch' is named 2 times"),
        (
            of_spinning(commands=(RunSpeed("right", -9, 9), DriveSpeed(-9, 9))),
            "motor 'right' is moved by the commands 'right' and 'drive_speed'; use one",
        ),
        (
            of_spinning(commands=(RunSpeed("left", -9, 9),), settle=UntilDone()),
            "'left' goes on until the next step; let the step Wait, not UntilDone",
        ),
        (of_spinning(channels=(Distance("nose"),)), "has no sensor 'nose'"),
    ],
)
def test_interface_beyond_its_limits_is_refused(interface: Interface, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        validate(TWO_WHEELER, interface)


def test_eight_commands_fit_and_nine_do_not() -> None:
    motors = tuple(Motor(f"m{port}", port) for port in "ABCDEF")
    robot = Robot(
        "many",
        HubKind.PRIME,
        motors[:4],
        (
            PoweredUpSensor("one", "E", SensorKind.LIGHT),
            PoweredUpSensor("two", "F", SensorKind.LIGHT),
        ),
    )
    moves = tuple(RunSpeed(motor.name, -9, 9) for motor in robot.motors)
    eight = (*moves, LightBrightness("one"), LightBrightness("two"), HubLight())
    interface = Interface((*eight, RunDuty("mA")), (MotorAngle("mA"),), Wait(9))
    with pytest.raises(DescriptionError, match="'mA' is named 2 times"):
        validate(robot, interface)
    nine = Interface((*eight, *eight[:2]), (MotorAngle("mA"),), Wait(9))
    with pytest.raises(DescriptionError, match="9 commands do not fit one write of 20 bytes; use"):
        validate(robot, nine)
    validate(robot, Interface(eight, (MotorAngle("mA"),), Wait(9)))


@pytest.mark.parametrize(
    ("hub", "message"),
    [
        (HubKind.MOVE, "a move hub has neither standard input nor floating point numbers"),
        (KitKind.DOUBLE_MOTOR, "a double-motor runs no programs; programs for it run on this"),
    ],
)
def test_device_that_runs_no_program_of_ours(hub: Any, message: str) -> None:
    kind = MotorKind(hub.model.own_kind)
    robot = Robot("odd", hub, tuple(Motor(f"m{port}", port, kind) for port in "AB"))
    with pytest.raises(ProgramError, match=f"robot 'odd': {message}"):
        validate(robot, Interface((), (MotorAngle("mA"),), Wait(9)))
