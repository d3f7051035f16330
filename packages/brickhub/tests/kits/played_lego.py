"""LEGO's package and its radio, as far as a link to one robot needs them: devices that note what
they are told, and report what a test sets."""

from __future__ import annotations

import asyncio
import contextlib
import types
from collections.abc import Callable, Iterator
from typing import Any

from kit_world import ROBOT

from brickhub.hub.interface import Interface
from brickhub.kits.link import KitLink
from brickhub.kits.radio import KitPart
from brickhub.robot import Robot


class PlayedDevice:
    """An object of LEGO's package. ``calls``: what it was told, each with its arguments."""

    def __init__(self, radio: PlayedRadio) -> None:
        radio.devices.append(self)
        self.connected = False
        self.is_in_reach = True
        self.is_silent = False
        self.calls: list[tuple[Any, ...]] = []
        self.fails: Exception | None = None
        self.moves_left = 0
        self.report: Callable[[object], None] = lambda _: None
        motors = [types.SimpleNamespace(position=angle_deg) for angle_deg in (30, -400)]
        is_pair = type(self).__name__ == "DoubleMotor"
        self.motor: Any = motors if is_pair else motors[1]
        self.imu_device = types.SimpleNamespace(pitch=7, roll=-8, gyroscopeZ=55)
        self.sensor = types.SimpleNamespace(reflection=42, hue=200, saturation=60, value=35)
        self.version_firmware = (1, 2, 3)
        self.info_device = types.SimpleNamespace(batteryLevel=80)

    def set_notification_callback(self, report: Callable[[object], None]) -> None:
        self.report = report

    def connect(self, **options: object) -> None:
        self.calls.append(("connect", options))
        if self.fails is not None:
            raise self.fails
        self.connected = self.is_in_reach

    def disconnect(self) -> None:
        self.calls.append(("disconnect",))
        if self.fails is not None:
            raise self.fails
        self.connected = False

    @contextlib.contextmanager
    def batch(self, **options: object) -> Iterator[None]:
        self.calls.append(("batch", options))
        yield
        self.calls.append(("batch ends",))

    def _told(self, name: str, *values: object, **options: object) -> None:
        if self.fails is not None:
            raise self.fails
        self.calls.append((name, *values, options))

    def motor_run_for_degrees(self, degrees: int, **options: object) -> None:
        self._told("degrees", degrees, **options)

    def motor_run_for_time(self, time_ms: int, **options: object) -> None:
        self._told("time", time_ms, **options)

    def motor_stop(self, **options: object) -> None:
        self._told("stop", **options)

    def movement_stop(self, **options: object) -> None:
        self._told("stop both", **options)

    def done(self) -> bool:
        self.moves_left -= 1
        return self.moves_left < 0


class PlayedRadio:
    """Time that passes by sleeping, and reports each 15 ms of it.

    Attributes:
        devices: objects of LEGO's package, in the order in which they were made.
        links: links over it, which are closed with it.
        limits_s: limits of the calls that waited for a device.
    """

    def __init__(self) -> None:
        self.devices: list[PlayedDevice] = []
        self.links: list[KitLink] = []
        self.limits_s: list[float | None] = []
        self.attached = 0
        self.loop = asyncio.new_event_loop()
        self.time_ms = 1000.0
        self.at_next_sleep: Callable[[], None] | None = None

    def attach(self) -> None:
        self.attached += 1

    def search(self, part: KitPart) -> dict[str, Any]:
        return {"part": part.ports}

    def run(self, function: Callable[[], Any], limit_s: float | None = None) -> Any:
        self.limits_s.append(limit_s)
        return function()

    def now_s(self) -> float:
        return self.time_ms / 1000

    def sleep(self, seconds: float) -> None:
        happens = self.at_next_sleep
        self.at_next_sleep = None
        if happens is not None:
            happens()
        end_ms = self.time_ms + 1000 * seconds
        while self.time_ms < end_ms:
            self.time_ms += 1
            if self.time_ms % 15 == 0:
                self.loop.run_until_complete(self._report())

    def close(self) -> None:
        """No device fails any more, and no link is left for the end of Python."""
        for device in self.devices:
            device.fails = None
        for link in self.links:
            link.close()
        self.loop.close()

    async def _report(self) -> None:
        for device in self.devices:
            if device.connected and not device.is_silent:
                device.report(None)


def package_of(radio: PlayedRadio) -> types.ModuleType:
    """A module ``legoeducation`` with the kinds of devices of a robot."""
    package = types.ModuleType("legoeducation")
    for name in ("DoubleMotor", "SingleMotor", "ColorSensor"):
        kind = type(name, (PlayedDevice,), {})
        setattr(package, name, lambda kind=kind: kind(radio))
    return package


def link_over(radio: PlayedRadio, interface: Interface, robot: Robot = ROBOT) -> KitLink:
    """A link to a robot, by default that of `kit_world`."""
    link = KitLink(radio, robot, interface)
    radio.links.append(link)
    return link


def linked(radio: PlayedRadio, interface: Interface) -> tuple[KitLink, list[PlayedDevice]]:
    """An open link to the robot of `kit_world`, and its devices without what came before."""
    link = link_over(radio, interface)
    link.open()
    for device in radio.devices:
        device.calls.clear()
    return link, radio.devices
