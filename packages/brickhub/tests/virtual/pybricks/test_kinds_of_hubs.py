"""What each kind of hub has and lacks, from the configurations of the firmware
(``bricks/*/mpconfigport.h``, v4.0.1)."""

from __future__ import annotations

import pytest
from hub_programs import Console, output

from brickhub.robot import HubKind, Motor, Robot
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules

LACKS = {
    HubKind.PRIME: set(),
    HubKind.ESSENTIAL: {"tools.hub_menu", "parameters.Icon"},
    HubKind.TECHNIC: {
        *("tools.hub_menu", "parameters.Icon"),
        *("pupdevices.DuploTrain", "pupdevices.MarioHub", "pupdevices.TechnicMoveHub"),
    },
    HubKind.CITY: {
        *("tools.hub_menu", "parameters.Icon", "iodevices.XboxController"),
        *("pupdevices.DuploTrain", "pupdevices.MarioHub", "pupdevices.TechnicMoveHub"),
    },
    HubKind.MOVE: {
        *(
            "tools.hub_menu",
            "parameters.Icon",
            "iodevices",
            "iodevices.XboxController",
            "micropython",
            "math",
            "random",
            "sys",
            "struct",
            "geometry",
        ),
        *("tools.Matrix", "tools.vector", "tools.cross", "tools.Axis"),
        *("pupdevices.DuploTrain", "pupdevices.MarioHub", "pupdevices.TechnicMoveHub"),
    },
    HubKind.EV3: {
        *("tools.hub_menu", "iodevices.XboxController"),
        *("pupdevices.DuploTrain", "pupdevices.MarioHub", "pupdevices.TechnicMoveHub"),
    },
}
NAMES = set().union(*LACKS.values())
MOVE = Robot("small", HubKind.MOVE, motors=(Motor("left", "A"), Motor("right", "B")))
HEAD = """
from pybricks.hubs import MoveHub
from pybricks.parameters import Axis, Button, Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
"""


def has(kind: HubKind, name: str) -> bool:
    machine = Machine(BenchBody(Robot("hub", kind)))
    found = modules(machine, Console(machine, {}))
    part, _, member = name.partition(".")
    inside = found.get(f"pybricks.{part}") or found.get(part)
    return inside is not None and (not member or hasattr(inside, member))


@pytest.mark.parametrize("kind", HubKind)
def test_names(kind: HubKind) -> None:
    assert {name for name in NAMES if not has(kind, name)} == LACKS[kind]


def test_controllers_of_move_hub_are_hidden_and_its_angles_are_integers() -> None:
    source = """
left = Motor(Port.A, Direction.COUNTERCLOCKWISE)
base = DriveBase(left, Motor(Port.B), 56, 112)
base.turn(90)
print(repr(base.angle()) == repr(base.state()[2]))
print([hasattr(left, name) for name in ("control", "log", "model", "run")])
print([hasattr(base, name) for name in ("heading_control", "distance_control", "move_by", "use_gyro", "arc")])
print(hasattr(Button, "UP"), Button.LEFT_PLUS, [Axis.X, Axis.Y, -Axis.Z])
"""  # noqa: E501
    assert output(HEAD + source, robot=MOVE).splitlines() == [
        "True",
        "[False, False, False, True]",
        "[False, False, False, False, True]",
        "False Button.LEFT_PLUS [1, 2, -3]",
    ]


@pytest.mark.parametrize(
    ("sides", "shown"),
    [
        ("", "(0, 0) (0, 0, 10112) Side.TOP"),
        ("top_side=-Axis.Z, front_side=Axis.X", "(0, -180) (0, 0, -10112) Side.TOP"),
        ("top_side=Axis.X, front_side=-Axis.Z", "(-90, -180) (10112, 0, 0) Side.TOP"),
        ("top_side=Axis.Y, front_side=Axis.X", "(0, 90) (0, 10112, 0) Side.TOP"),
    ],
)
def test_accelerometer_of_a_move_hub_that_lies_flat(sides: str, shown: str) -> None:
    source = f"imu = MoveHub({sides}).imu\nprint(imu.tilt(), imu.acceleration(), imu.up())"
    assert output(HEAD + source, robot=MOVE) == shown


def test_accelerometer_of_a_mounted_move_hub() -> None:
    source = (
        "Motor(Port.A)\nimu = MoveHub(top_side=Axis.Y, front_side=-Axis.X).imu\n"
        "print(imu.tilt(), imu.acceleration(), imu.up())\n"
    )
    source += (
        "print(hasattr(imu, 'heading'))\ntry:\n    MoveHub(Axis.X, Axis.X)\n"
        "except ValueError as e:\n    print(e)"
    )
    shown = "(0, 0) (0, 0, 10112) Side.LEFT\nFalse\nInvalid argument"
    assert output(HEAD + source, body=FittedBench(HubKind.MOVE)) == shown


class Leaning(BenchBody):
    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 4000.0, -2500.0, -8000.0


def test_accelerometer_of_a_leaning_move_hub() -> None:
    # Counts of 1/64 g, rounded down: 26, -17, -53; angles from the firmware's table of arc
    # tangents.
    source = "imu = MoveHub().imu\nprint(imu.tilt(), imu.acceleration(), imu.up())"
    assert (
        output(HEAD + source, body=Leaning(MOVE)) == "(-25, -163) (4108, -2686, -8374) Side.BOTTOM"
    )


@pytest.mark.parametrize(
    ("kind", "found"), [(HubKind.PRIME, 5), (HubKind.TECHNIC, 4), (HubKind.MOVE, 1)]
)
def test_builtins(kind: HubKind, found: int) -> None:
    source = (
        "n = 0\nfor get in (lambda: len, lambda: set, lambda: float, lambda: enumerate, "
        "lambda: memoryview):\n"
    )
    source += "    try:\n        n += bool(get())\n    except NameError:\n        pass\nprint(n)"
    assert output(source, robot=Robot("hub", kind)) == str(found)


def test_buttons_of_move_hub_are_a_tuple() -> None:
    assert output(HEAD + "print(MoveHub().button.pressed())", robot=MOVE) == "()"


@pytest.mark.parametrize("kind", HubKind)
def test_storage_of_a_program(kind: HubKind) -> None:
    """``PBSYS_CONFIG_STORAGE_USER_DATA_SIZE`` of each hub."""
    size = 512 if kind in (HubKind.PRIME, HubKind.ESSENTIAL, HubKind.EV3) else 128
    source = f"""
from pybricks.hubs import ThisHub
system = ThisHub().system
system.storage({size - 2}, write=b"ok")
print(system.storage({size - 2}, read=2), len(system.storage(0, read={size})))
for values in (dict(read=2), dict(write=b"no")):
    try:
        system.storage({size - 1}, **values)
    except ValueError as error:
        print(error)
"""
    assert (
        output(source, robot=Robot("hub", kind))
        == f"b'ok' {size}\nInvalid argument\nInvalid argument"
    )
