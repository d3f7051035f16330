"""A robot of LEGO's kits on a bench, its devices by their packets, and the link to it."""

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
from brickhub.kits.kit_protocol import COMMANDS, NOTIFICATION, REPORTS
from brickhub.kits.link import KitLink
from brickhub.kits.radio import parts
from brickhub.kits.virtual_devices import KitDevice, devices_of
from brickhub.kits.virtual_kit import VirtualKit
from brickhub.robot import Direction, DriveBase, KitKind, Motor, PoweredUpSensor, Robot, SensorKind
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.machine import Machine

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


class World:
    """A bench with a device of each kind, and its time."""

    def __init__(
        self, *readings: str, end_stops: dict[str, tuple[float, float]] | None = None
    ) -> None:
        bench = FittedBench(
            KitKind.DOUBLE_MOTOR, [parse_reading(text) for text in readings], end_stops or {}
        )
        for port in "ABC":
            bench.plug_in(port, "Motor")
        bench.plug_in("D", "ColorSensor")
        bench.put_on_wheels({"A": -0.25 / 1000, "B": -0.25 / 1000})
        self.machine = Machine(bench)
        devices = devices_of(self.machine, parts(KitKind.DOUBLE_MOTOR, "ABC", "D"))
        self.double, self.single, self.color, self.controller = devices
        for device in devices:
            device.connect()

    def send(self, device: KitDevice, *packets: bytes, ms: int = 0) -> list[bytes]:
        """Send packets as one, let time pass, and return the answers other than notifications."""
        device.receive(b"".join(packets))
        for _ in range(ms // 5):
            self.machine.advance(5)
            device.update()
        answers = [packet for packet in device.outbox if packet[0] != NOTIFICATION]
        device.outbox.clear()
        return answers

    def report(self, device: KitDevice, name: str) -> list[dict[str, int]]:
        """The reports of one kind in a notification."""
        device.receive(encode("notifications", 1000))
        found = [packet for packet in device.outbox if packet[0] == NOTIFICATION]
        device.outbox.clear()
        device.receive(encode("notifications", 0))
        return [values for kind, values in reports_in(found[0]) if kind == name]
