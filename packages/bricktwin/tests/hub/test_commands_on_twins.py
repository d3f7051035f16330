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
    Turn,
    UntilDone,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body

ANGLES = (MotorAngle("left", -3000, 3000), MotorAngle("right", -3000, 3000))


def interface(*commands: Command, settle: Wait | UntilDone | None = None) -> Interface:
    return Interface(
        commands,
        (*ANGLES, DriveDistance(-2000, 2000), DriveAngle(-360, 360), Heading()),
        settle or Wait(500),
    )


def carried_out(
    wanted: Interface, *steps: Sequence[float], robot: Any = TWO_WHEELER
) -> tuple[list[list[float]], VirtualHub]:
    """Readings after the steps ``[1 + steps, channels]``, relative to the first, and the hub."""
    hub = VirtualHub(make_body(robot))
    link = HubLink(hub, robot, wanted)
    link.open()
    first = link.read().values
    readings = [first, *(link.act(step).values for step in steps)]
    return [
        [value - start for value, start in zip(reading, first, strict=True)] for reading in readings
    ], hub


def test_drive_command_signs() -> None:
    seen, hub = carried_out(
        interface(DriveSpeed(-200, 200), DriveTurnRate(-90, 90)), *((200, 0),) * 3, *((0, 90),) * 3
    )
    assert seen[3][2] == pytest.approx(200 * 1.6, abs=60) and abs(seen[3][3]) < 4
    assert seen[6][3] - seen[3][3] == pytest.approx(90 * 1.6, abs=30)
    assert seen[6][4] == pytest.approx(seen[6][3], abs=8), "the gyroscope agrees"
    assert hub.body.pose().heading_deg == pytest.approx(seen[6][4], abs=5)


def test_turns_and_curves_end_correctly() -> None:
    until = UntilDone(5000)
    seen, _ = carried_out(interface(Turn(-90, 90), settle=until), (90,), (-45,))
    assert [row[3] for row in seen[1:]] == pytest.approx([90, 45], abs=4)
    assert [row[4] for row in seen[1:]] == pytest.approx([90, 45], abs=8), "the gyroscope agrees"
    curved, _ = carried_out(interface(Curve(-90, 90, radius_mm=100), settle=until), (90,), (-90,))
    assert curved[1][2:4] == pytest.approx([157, 90], abs=6)
    assert curved[2][2:4] == pytest.approx([314, 0], abs=8), "to the left now, and ahead again"


def test_preflight_tries_commands() -> None:
    commands = (Curve(-90, 90, radius_mm=100), HubLight(), HubSound())
    wanted = replace(
        interface(*commands), channels=(MotorAngle("left"), MotorAngle("right"), Distance("eyes"))
    )
    transport = VirtualHub(make_body(TWO_WHEELER))
    findings = list(check_robot(transport, TWO_WHEELER, wanted, may_move=lambda: True))
    assert [finding for finding in findings if finding.outcome is Outcome.ERROR] == []
    assert len(findings) > len(commands)
