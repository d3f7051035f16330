"""A robot of LEGO's kits on a bench, and the link to it."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from brickhub.hub.interface import (
    DriveSpeed,
    DriveTurnRate,
    Interface,
    MotorAngle,
    RunAngle,
    SensorReading,
    UntilDone,
    Wait,
)
from brickhub.hub.link.profiles import PROFILES, LinkProfile
from brickhub.kits.kit_protocol import COMMANDS, REPORTS
from brickhub.kits.link import KitLink
from brickhub.kits.virtual_kit import VirtualKit
from brickhub.robot import Direction, DriveBase, KitKind, Motor, PoweredUpSensor, Robot, SensorKind
from brickhub.virtual.bench_body import BenchBody

ROBOT = Robot(
    "kit",
    KitKind.DOUBLE_MOTOR,
    (
        Motor("left", "A", direction=Direction.COUNTERCLOCKWISE),
        Motor("right", "B"),
        Motor("arm", "C"),
    ),
    (PoweredUpSensor("light", "D", SensorKind.COLOR),),
    DriveBase("left", "right", 56, 112),
    needs_imu=True,
)
ANGLES = (
    *(MotorAngle(name, -9999, 9999) for name in ("left", "right", "arm")),
    SensorReading("light", "reflection", 0, 100, "%"),
)
DRIVE = Interface((DriveSpeed(-200, 200), DriveTurnRate(-90, 90)), ANGLES, Wait(100))
TURN = Interface(
    (RunAngle("left", -360, 360, 400), RunAngle("arm", -360, 360, 400)), ANGLES, UntilDone(3000)
)


def encode(name: str, *values: int) -> bytes:
    """Bytes of one command."""
    return COMMANDS[name].struct.pack(COMMANDS[name].number, *values)


def reports_in(notification: bytes) -> Iterator[tuple[str, dict[str, int]]]:
    """Names and fields of the reports in a notification."""
    layouts = {layout.number: (name, layout) for name, layout in REPORTS.items()}
    _, size = struct.unpack_from("<BH", notification)
    position = 3
    while position < 3 + size:
        name, layout = layouts[notification[position]]
        _, *fields = layout.struct.unpack_from(notification, position)
        yield name, dict(zip(layout.fields, fields, strict=True))
        position += layout.struct.size


def connected(
    interface: Interface = DRIVE, profile: LinkProfile = PROFILES["mac"]
) -> tuple[VirtualKit, KitLink]:
    """A robot and an open link to it."""
    kit = VirtualKit(BenchBody(ROBOT, readings={"light": lambda angles: 50.0}), link=profile)
    link = KitLink(kit, ROBOT, interface)
    link.open()
    return kit, link
