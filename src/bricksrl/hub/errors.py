"""Errors of the link to a hub: children of ``HubError`` for links that cannot be had, or break."""

from __future__ import annotations

import enum
from typing import ClassVar

from bricksrl.errors import HubError


class Reason(enum.Enum):
    """Reason why a hub cannot be reached, for programs that have to decide what to do."""

    NO_ADAPTER = "this computer has no Bluetooth"
    SWITCHED_OFF = "Bluetooth is switched off"
    NO_SERVICE = "the system's service does not run"
    DENIED = "this program may not use Bluetooth or the port"
    NOT_FOUND = "no such hub is in reach"
    SEVERAL = "several hubs are in reach, and none was named"
    UNKNOWN = "the message says what is known"


class MediumUnavailableError(HubError):
    """This computer lacks what is needed to reach a hub: ``reason`` says what."""

    def __init__(self, message: str, reason: Reason = Reason.UNKNOWN) -> None:
        super().__init__(message)
        self.reason = reason


class BluetoothUnavailableError(MediumUnavailableError):
    """This computer has no Bluetooth, or does not let us use it."""


class UsbUnavailableError(MediumUnavailableError):
    """This computer does not let us use its serial ports."""


class HubNotFoundError(HubError):
    """No hub, or not the one that was asked for, is in reach."""

    reason: ClassVar[Reason] = Reason.NOT_FOUND


class HubDisconnectedError(HubError):
    """The link to the hub broke."""


class HubBusyError(HubError):
    """The hub could not take a command because a program runs, or because the program's input buffer is full."""


class HubRefusedError(HubError):
    """The hub refused a command."""


class ProgramStoppedError(HubError):
    """The program on the hub has ended, or was stopped, for example with the hub's button."""


class SilentHubError(ProgramStoppedError):
    """The program on the hub said good-bye, for example because it had not heard from this computer."""


class AmbiguousHubError(HubNotFoundError):
    """Several hubs are in reach, and none was named."""

    reason: ClassVar[Reason] = Reason.SEVERAL
