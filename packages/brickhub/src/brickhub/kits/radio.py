"""Bluetooth to the devices of LEGO's kits, through LEGO's own package; and which devices a robot
has.

The package ``legoeducation`` is optional: its licence, BUSL-1.1, permits non-commercial use.
"""

import concurrent.futures
import importlib
import logging
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from brickhub.errors import (
    DescriptionError,
    HubTimeoutError,
    MediumUnavailableError,
    Reason,
    UnknownNameError,
    an,
)
from brickhub.futures import is_done, settle
from brickhub.hub.transports.address import HubAddress
from brickhub.kits.kit_protocol import Product
from brickhub.robot import AnyHub, KitKind, Robot

LEGO_PACKAGE = "legoeducation"
_T = TypeVar("_T")
_SILENT = logging.NullHandler()
"""One for all calls: a logger takes the same handler once."""
_CARD_COLORS = ("RED", "YELLOW", "BLUE", "GREEN", "PURPLE", "MAGENTA", "AZURE", "ORANGE")


def lego_package(*, is_silent: bool = False) -> Any:
    """LEGO's package. ``is_silent``: what it logs is not printed, as errors say it. Raises
    MediumUnavailableError if it is not installed."""
    # Without any handler, Python prints a library's warnings, so one that does nothing is added.
    if is_silent:
        logging.getLogger(LEGO_PACKAGE).addHandler(_SILENT)
    try:
        return importlib.import_module(LEGO_PACKAGE)
    except ImportError:
        remedy = (
            f'run `pip install "brickhub[{LEGO_PACKAGE}]"` (its licence, BUSL-1.1, permits '
            "non-commercial use)"
        )
        raise MediumUnavailableError(
            f"LEGO's package {LEGO_PACKAGE} is not installed; {remedy}", Reason.NO_SERVICE
        ) from None


@dataclass(frozen=True)
class KitPart:
    """Device of a robot, and the ports that it stands for in the robot's description."""

    product: Product
    ports: str


def parts(
    hub: AnyHub,
    motor_ports: Iterable[str],
    sensor_ports: Iterable[str],
) -> tuple[KitPart, ...]:
    """The devices for motors and color sensors on these ports. Raises DescriptionError if a motor
    of the first one is missing."""
    carrier_ports = hub.model.own_motors
    motors = list(motor_ports)
    for port in carrier_ports:
        if port not in motors:
            raise DescriptionError(
                f"no motor is described on port {port}, where {an(hub.value)} has one; describe it"
            )
    carrier = Product.DOUBLE_MOTOR if hub is KitKind.DOUBLE_MOTOR else Product.SINGLE_MOTOR
    # The device that carries the robot comes first, because the IMU is read from the first one.
    found = [KitPart(carrier, carrier_ports)]
    found += [KitPart(Product.SINGLE_MOTOR, port) for port in motors if port not in carrier_ports]
    found += [KitPart(Product.COLOR_SENSOR, port) for port in sensor_ports]
    return tuple(found)


def parts_of(robot: Robot) -> tuple[KitPart, ...]:
    """The devices of a robot. Raises DescriptionError if a motor of the one that carries it is
    missing."""
    return parts(
        robot.hub, [motor.port for motor in robot.motors], [sensor.port for sensor in robot.sensors]
    )


class Radio(Protocol):
    """Devices in reach, and their time."""

    def attach(self) -> None:
        """Let LEGO's package use this radio."""

    def search(self, part: KitPart) -> dict[str, Any]:
        """Arguments of ``connect`` in LEGO's package that find a device."""

    def run(
        self,
        function: Callable[[], _T],
        limit_s: float | None = None,
    ) -> _T:
        """The result of a function that waits for a device. Raises HubTimeoutError after a time."""

    def now_s(self) -> float:
        """Time of the devices, in seconds."""

    def sleep(self, seconds: float) -> None:
        """Let time pass."""


@dataclass(frozen=True)
class RealRadio:
    """Bluetooth of this computer. ``card``: color and serial of the devices' connection card, such
    as ``"azure-3683"``; ``None`` for the first devices in reach."""

    card: str | None = None

    def attach(self) -> None:
        """LEGO's package uses it by itself."""

    def search(self, part: KitPart) -> dict[str, Any]:
        """Raises UnknownNameError if the card has no such color or serial."""
        if self.card is None:
            return {}
        color, _, serial = self.card.partition("-")
        is_color = color.upper() in _CARD_COLORS
        is_serial = serial.isdigit() and len(serial) <= 4
        if not (is_color and is_serial):
            raise UnknownNameError(
                f"'{self.card}' is no connection card; give its color and serial, such as "
                "ble:azure-3683"
            )
        return {
            "card_color": vars(lego_package())[f"LEGO_COLOR_{color.upper()}"],
            "card_serial": serial,
        }

    def run(
        self,
        function: Callable[[], _T],
        limit_s: float | None = None,
    ) -> _T:
        # A thread can be left behind, because the package may wait for a device for ever.
        future: concurrent.futures.Future[_T] = concurrent.futures.Future()
        threading.Thread(
            target=settle,
            args=(future, function),
            daemon=True,
        ).start()
        if not is_done(future, limit_s):
            raise HubTimeoutError(
                f"a device did not answer within {limit_s:g} s; check that it is on and near"
            )
        return future.result()

    def now_s(self) -> float:
        # Unlike the monotonic clock of Windows, this one tells milliseconds.
        return time.perf_counter()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def real_radio(address: HubAddress) -> RealRadio:
    """Bluetooth to devices of LEGO's kits; what the address names is their connection card. Raises
    UnknownNameError for another medium."""
    if address.medium != "ble":
        raise UnknownNameError(
            f"devices of LEGO's kits are reached over Bluetooth, not '{address.medium}'; choose "
            "'ble'"
        )
    return RealRadio(address.which)
