"""All commands: clamping, execution, validation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar

import on_a_body
import pytest
from bench_arm import BenchArm
from described import ROBO_ARM, TASKS, TWO_WHEELER
from on_a_body import ANGLES, DriveContract, interface

from brickhub.errors import DescriptionError
from brickhub.hub.interface import (
    Command,
    Curve,
    DriveDistance,
    DriveSpeed,
    DriveStraight,
    DriveTurnRate,
    Heading,
    HubLight,
    HubSound,
    Interface,
    MotorAngle,
    RunAngle,
    RunDuty,
    RunSpeed,
    TrackTarget,
    Turn,
    UntilDone,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.compile import compile_program
from brickhub.hub.program.generate import generate, validate
from brickhub.hub.transport import Pipe
from brickhub.robot import DriveBase, HubKind, Motor, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.virtual_transport import VirtualHub

TECHNIC = replace(TWO_WHEELER, name="technic", hub=HubKind.TECHNIC, motors=tuple(
    replace(motor, port=port) for motor, port in zip(TWO_WHEELER.motors, "AB", strict=True)
))  # fmt: skip
HASHES = {
    "RoboArm-v0": "6334d6c7 035b10ef",
    "RoboArm_mixed-v0": "a2d6ef9b ad83235f",
    "RunAway-v0": "c095bdb6 0e66dd08",
    "Spinning-v0": "5812adce c2480909",
    "Walker-v0": "d614debb a42f90f6",
    "Walker-v1": "d614debb a42f90f6",
}


class TestDriveOnTheBench(DriveContract):
    """A 2Wheeler whose wheels turn in the air."""

    def body(self) -> Body:
        return BenchBody(TWO_WHEELER)


def carried_out(
    wanted: Interface, *steps: Sequence[float], robot: Robot = TWO_WHEELER
) -> tuple[list[list[float]], VirtualHub]:
    return on_a_body.carried_out(BenchBody(robot), wanted, *steps)


def turned(seen: list[list[float]], step: int) -> list[float]:
    """Degrees by which both wheels turned in a step."""
    return [
        after - before for before, after in zip(seen[step - 1][:2], seen[step][:2], strict=True)
    ]


@pytest.mark.parametrize("env_id", HASHES)
def test_paper_program_hashes_are_unchanged(env_id: str) -> None:
    assert " ".join(f"{generate(*TASKS[env_id], pipe).hash:08x}" for pipe in Pipe) == HASHES[env_id]


def test_what_counts_without_end_does_not_saturate() -> None:
    fast = replace(TWO_WHEELER, drive_base=replace(TWO_WHEELER.drive_base, wheel_diameter_mm=500.0))
    steps = [(1000, 1000)] * 8 + [(1000, -1000)] * 8
    seen, _ = carried_out(
        interface(RunSpeed("left", -1000, 1000), RunSpeed("right", -1000, 1000), settle=Wait(2500)),
        *steps,
        robot=fast,
    )
    straight, spun = seen[8], seen[16]
    assert straight[0] > 15_000 and straight[1] > 15_000, "angles of motors, in deg"
    assert (
        straight[2] == pytest.approx(math.pi * 500 * straight[0] / 360, rel=0.01)
        and straight[2] > 60_000
    ), "mm"
    assert (
        spun[3]
        == pytest.approx((spun[0] - spun[1]) / 2 * 500 / fast.drive_base.axle_track_mm, rel=0.01)
        and spun[3] > 30_000
    )
    assert all(after[3] - before[3] > 3000 for before, after in pairwise(seen[9:])), (
        "each step counts"
    )


@pytest.mark.parametrize("deg", [3300.0, -3300.0, 1e6])
def test_heading_counts_beyond_nine_turns(deg: float) -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    with HubLink(hub, TWO_WHEELER, interface(RunSpeed("left", -500, 500))) as link:
        hub.machine.heading.set_angle(deg)
        assert link.read().values[-1] == pytest.approx(deg, abs=1)


def test_a_number_at_the_end_of_16_bits_is_told(caplog: pytest.LogCaptureFixture) -> None:
    @dataclass(frozen=True)
    class Huge(Heading):
        accumulates: ClassVar[bool] = False

    hub = VirtualHub(BenchBody(TWO_WHEELER))
    with HubLink(
        hub, TWO_WHEELER, Interface((RunSpeed("left", -500, 500),), (Huge(),), Wait(50))
    ) as link:
        link.read()
        assert not caplog.records
        hub.machine.heading.set_angle(4000.0)
        assert [link.read().values[-1] for _ in range(3)] == [pytest.approx(3276.7)] * 3
    assert [record.message.partition(",")[0] for record in caplog.records] == [
        "the channel 'heading' is beyond what 16 bits carry"
    ]


EVERY = [
    (RunSpeed("left", -500, 500), RunSpeed("right", -500, 500)),
    (RunDuty("left"), RunDuty("right", -50, 50)),
    (TrackTarget("left", -90, 90), HubLight()),
    (DriveSpeed(-200, 200), DriveTurnRate(-100, 100)),
    (DriveTurnRate(-100, 100), DriveSpeed(-200, 200)),
    (DriveSpeed(-200, 200),),
    (DriveTurnRate(-100, 100), HubSound()),
    (Turn(-90, 90),),
    (Curve(-90, 90, radius_mm=100), HubLight(), HubSound()),
]


@pytest.mark.parametrize(
    "commands", EVERY, ids=lambda commands: "+".join(type(command).__name__ for command in commands)
)
@pytest.mark.parametrize("pipe", Pipe)
def test_the_program_is_clean_and_runs(commands: tuple[Command, ...], pipe: Pipe) -> None:
    wanted = interface(*commands)
    program = generate(TWO_WHEELER, wanted, pipe)
    compile_program(program)
    link = HubLink(VirtualHub(BenchBody(TWO_WHEELER)), TWO_WHEELER, wanted, pipe=pipe)
    link.open()
    link.act([command.high for command in commands])
    link.act([0.0] * len(commands))


def test_speed_command_is_held_and_clamped() -> None:
    seen, _ = carried_out(
        interface(RunSpeed("left", -300, 300), RunSpeed("right", -300, 300)),
        (200, 200),
        (200, 200),
        (900, 0),
    )
    assert turned(seen, 2) == pytest.approx([200 * 0.53] * 2, abs=12)
    left, right = turned(seen, 3)
    assert left < 300 * 0.6, "clamped to 300 deg/s"
    assert right < 40, "stopped"


def test_duty_command_is_share_of_battery() -> None:
    seen, _ = carried_out(
        interface(RunDuty("left"), RunDuty("right", -50, 50)), (100, 100), (100, 100), (100, 100)
    )
    left, right = turned(seen, 3)
    assert left > 1.6 * right > 150


def test_target_command_holds_angle() -> None:
    seen, hub = carried_out(
        interface(TrackTarget("left", -90, 90), settle=Wait(800)), (60,), (300,)
    )
    start_deg = hub.machine.servos["E"].angle_deg() - seen[-1][0]
    assert [start_deg + row[0] for row in seen[1:]] == pytest.approx([60, 90], abs=12)


def test_drive_command_order_follows_action() -> None:
    seen, _ = carried_out(
        interface(DriveTurnRate(-90, 90), DriveSpeed(-200, 200)), (0, 200), (0, 200)
    )
    assert seen[2][2] > 120 and abs(seen[2][3]) < 4


def test_light_and_sound_commands() -> None:
    wanted = interface(HubLight(), HubSound(duration_ms=100), settle=Wait(100))
    _, hub = carried_out(wanted, (120, 440))
    assert hub.machine.panel.light is not None and hub.machine.panel.light[0] == 120
    seen = []
    hub.machine.panel.on_change = seen.append
    link = HubLink(hub, TWO_WHEELER, wanted)
    link.open()
    link.act((240, 0))
    assert hub.machine.panel.sound_hz == 0, "below 64 Hz it is silent"


@pytest.mark.parametrize(
    ("robot", "wanted", "message"),
    [
        (
            TWO_WHEELER,
            interface(RunSpeed("left", -1, 1), settle=UntilDone()),
            "let the step Wait, not UntilDone",
        ),
        (
            TWO_WHEELER,
            interface(DriveSpeed(-1, 1), Turn(-1, 1)),
            "moved by the commands 'drive_speed' and 'turn'",
        ),
        (
            TWO_WHEELER,
            interface(DriveSpeed(-1, 1), RunSpeed("left", 0, 1)),
            "moved by the commands 'drive_speed' and 'left'",
        ),
        (TWO_WHEELER, interface(RunDuty("left", -200, 100)), "stay within -100 to 100"),
        (TWO_WHEELER, interface(Curve(-9, 9, radius_mm=3)), "a radius of 3 mm"),
        (TWO_WHEELER, interface(HubLight(0, 720)), "hues are 0 to 360"),
        (TWO_WHEELER, interface(HubSound(duration_ms=900)), "1 to 200 ms"),
        (
            replace(TECHNIC),
            Interface((HubSound(),), ANGLES, Wait(9)),
            "a technic hub has no loudspeaker",
        ),
        (
            ROBO_ARM,
            Interface((RunSpeed("low", -9, 9),), (MotorAngle("low", 10, 70),), Wait(9)),
            "turns endlessly",
        ),
        (
            ROBO_ARM,
            Interface((RunDuty("low"),), (MotorAngle("low", 10, 70),), Wait(9)),
            "turns endlessly",
        ),
        (
            ROBO_ARM,
            Interface((TrackTarget("low", 0, 70),), (MotorAngle("low", 10, 70),), Wait(9)),
            "range of 10 to 70",
        ),
        (
            ROBO_ARM,
            Interface((Turn(-9, 9),), (MotorAngle("low", 10, 70),), Wait(9)),
            "no drive base for 'turn'",
        ),
        (
            ROBO_ARM,
            Interface((HubLight(),), (DriveDistance(0, 9),), Wait(9)),
            "no drive base for 'drive_distance'",
        ),
    ],
)
def test_unsupported_commands_raise(robot: Any, wanted: Interface, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        validate(robot, wanted)


def test_joint_tracks_targets_in_range() -> None:
    wanted = Interface((TrackTarget("high", -120, 0),), (MotorAngle("high", -150, 10),), Wait(600))
    hub = VirtualHub(BenchArm())
    link = HubLink(hub, ROBO_ARM, wanted)
    link.open()
    assert link.act((-40,)).values[0] == pytest.approx(-40, abs=12)


def test_straight_command_is_unchanged() -> None:
    seen, _ = carried_out(interface(DriveStraight(-100, 100), settle=UntilDone()), (80,))
    assert seen[1][2] == pytest.approx(80, abs=4)


BASED = Robot(
    "based",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B")),
    drive_base=DriveBase("left", "right", 50.0, 100.0),
)
ROLLED_DEG = 360.0 / (math.pi * 50.0)
"""Turn of a wheel for a millimetre."""


@pytest.mark.parametrize(
    ("command", "amount", "turns_deg"),
    [
        (RunAngle("left", -90, 90, 300), 45.0, (45.0,)),
        # An endless move turns at least so far in a second, but a test of it no more than a little.
        (RunSpeed("left", -30, 30), 8.0, (8.0,)),
        (RunDuty("left"), -10.0, (-10.0,)),
        # A motor may already be at its target.
        (TrackTarget("left", -90, 90), 45.0, (0.0,)),
        (DriveStraight(-100, 100), 10.0, (10.0 * ROLLED_DEG,) * 2),
        (DriveStraight(-100, 100), -10.0, (-10.0 * ROLLED_DEG,) * 2),
        # Clockwise, the left wheel rolls forward, on a circle of the axle track.
        (Turn(-90, 90), 30.0, (60.0, -60.0)),
        (DriveSpeed(-20, 20), 4.0, (4.0 * ROLLED_DEG,) * 2),
        (DriveTurnRate(-20, 20), -4.0, (-8.0, 8.0)),
        # Around a point 200 mm to the right: the left wheel on 250 mm, the right one on 150.
        (Curve(-90, 90, 200), 9.0, (9.0 * 250 / 25, 9.0 * 150 / 25)),
        # With a negative radius backwards, around a point to the right too.
        (Curve(-90, 90, -200), 9.0, (-9.0 * 250 / 25, -9.0 * 150 / 25)),
        (Curve(-90, 90, 200), -9.0, (9.0 * 150 / 25, 9.0 * 250 / 25)),
    ],
)
def test_wheels_turn_as_far_as_a_command_takes_them(
    command: Command, amount: float, turns_deg: tuple[float, ...]
) -> None:
    assert command.turns_deg(BASED, amount) == pytest.approx(turns_deg)


@pytest.mark.parametrize("speed", [1e4, -1e4])
def test_an_endless_move_is_tested_by_a_small_turn(speed: float) -> None:
    (turn_deg,) = RunSpeed("left", -1e4, 1e4).turns_deg(BASED, speed)
    assert math.copysign(1.0, turn_deg) == math.copysign(1.0, speed) and 5 < abs(turn_deg) < 45
    both = DriveSpeed(-1e4, 1e4).turns_deg(BASED, speed)
    assert both == (turn_deg, turn_deg)
