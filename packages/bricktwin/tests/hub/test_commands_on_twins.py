"""Commands that move a body: what its sensors say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from brickhub.finding import Outcome
from brickhub.hub.diagnostics.preflight import check_robot
from brickhub.hub.interface import (
    Command,
    Curve,
    Distance,
    DriveAngle,
    DriveDistance,
    DriveSpeed,
    DriveTurnRate,
    Heading,
    HubLight,
    HubSound,
    Interface,
    MotorAngle,
    RunSpeed,
    TrackTarget,
    Turn,
    UntilDone,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.make_body import make_body

ANGLES = (MotorAngle("left", -3000, 3000), MotorAngle("right", -3000, 3000))
MOVES = [
    (RunSpeed("left", -500, 500), RunSpeed("right", -500, 500)),
    (DriveSpeed(-200, 200), DriveTurnRate(-100, 100)),
    (Turn(-90, 90),),
    (Curve(-90, 90, radius_mm=100), HubLight(), HubSound()),
]


def interface(*commands: Command, settle: Wait | UntilDone | None = None) -> Interface:
    return Interface(commands, (*ANGLES, DriveDistance(-2000, 2000), DriveAngle(-360, 360), Heading()), settle or Wait(500))


def carried_out(wanted: Interface, *steps: Sequence[float], robot: Any = TWO_WHEELER) -> tuple[list[list[float]], VirtualHub]:
    """Readings after the steps ``[1 + steps, channels]``, relative to the first, and the hub."""
    hub = VirtualHub(make_body(robot))
    link = HubLink(hub, robot, wanted)
    link.open()
    first = link.read().values
    readings = [first, *(link.act(step).values for step in steps)]
    return [[value - start for value, start in zip(reading, first, strict=True)] for reading in readings], hub


def test_drive_command_signs() -> None:
    seen, hub = carried_out(interface(DriveSpeed(-200, 200), DriveTurnRate(-90, 90)), *((200, 0),) * 3, *((0, 90),) * 3)
    assert seen[3][2] == pytest.approx(200 * 1.6, abs=60) and abs(seen[3][3]) < 4
    assert seen[6][3] - seen[3][3] == pytest.approx(90 * 1.6, abs=30)
    assert seen[6][4] == pytest.approx(seen[6][3], abs=8), "the gyroscope agrees"
    assert hub.body.pose().heading_deg == pytest.approx(seen[6][4], abs=5)


def test_turns_and_curves_end_correctly() -> None:
    until = UntilDone(5000)
    seen, _ = carried_out(interface(Turn(-90, 90), settle=until), (90,), (-45,))
    assert [row[3] for row in seen[1:]] == pytest.approx([90, 45], abs=4)
    curved, _ = carried_out(interface(Curve(-90, 90, radius_mm=100), settle=until), (90,), (-90,))
    assert curved[1][2:4] == pytest.approx([157, 90], abs=6)
    assert curved[2][2:4] == pytest.approx([314, 0], abs=8), "to the left now, and ahead again"


def test_target_command_holds_angle() -> None:
    seen, hub = carried_out(interface(TrackTarget("left", -90, 90), settle=Wait(800)), (60,), (300,))
    start_deg = hub.machine.servos["E"].angle_deg() - seen[-1][0]
    assert [start_deg + row[0] for row in seen[1:]] == pytest.approx([60, 90], abs=12)


def test_joint_tracks_targets_in_range() -> None:
    wanted = Interface((TrackTarget("high", -120, 0),), (MotorAngle("high", -150, 10),), Wait(600))
    hub = VirtualHub(make_body(ROBO_ARM))
    link = HubLink(hub, ROBO_ARM, wanted)
    link.open()
    assert link.act((-40,)).values[0] == pytest.approx(-40, abs=12)


@pytest.mark.parametrize("commands", MOVES, ids=str)
def test_preflight_tries_commands(commands: tuple[Command, ...]) -> None:
    wanted = replace(interface(*commands), channels=(MotorAngle("left"), MotorAngle("right"), Distance("eyes")))
    transport = VirtualHub(make_body(TWO_WHEELER))
    findings = list(check_robot(transport, TWO_WHEELER, wanted, may_move=lambda: True))
    assert [finding for finding in findings if finding.outcome is Outcome.ERROR] == []
    assert len(findings) > len(commands)
