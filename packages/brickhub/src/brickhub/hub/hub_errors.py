"""Errors of the link to a hub: subclasses of ``HubError`` for links that cannot be made, or break."""

from __future__ import annotations

import enum
from typing import ClassVar

from brickhub.errors import HubError


class Reason(enum.Enum):
    """Reason why a hub cannot be reached, for programs that react to it."""

    NO_ADAPTER = "this computer has no Bluetooth"
    SWITCHED_OFF = "Bluetooth is switched off"
    NO_SERVICE = "the system's service does not run"
    DENIED = "this program may not use Bluetooth or the port"
    NOT_FOUND = "no such hub is in reach"
    SEVERAL = "several such hubs are in reach"
    UNKNOWN = "the message says what is known"

    @property
    def is_lasting(self) -> bool:
        """Whether it lasts until a person acts."""
        return self not in (Reason.NOT_FOUND, Reason.UNKNOWN)


class MediumUnavailableError(HubError):
    """This computer cannot reach hubs this way: ``reason`` says why."""

    def __init__(self, message: str, reason: Reason = Reason.UNKNOWN) -> None:
        super().__init__(message)
        self.reason = reason


class BluetoothUnavailableError(MediumUnavailableError):
    """This computer has no Bluetooth, or does not let us use it."""


class UsbUnavailableError(MediumUnavailableError):
    """This computer does not let us use its serial ports."""


class HubNotFoundError(HubError):
    """No hub, or not the requested one, is in reach."""

    reason: ClassVar[Reason] = Reason.NOT_FOUND


class HubDisconnectedError(HubError):
    """The link to the hub broke."""


class HubBusyError(HubError):
    """The hub could not take a command because a program runs, or because the program's input buffer is full."""


class HubRefusedError(HubError):
    """The hub refused a command."""


class ProgramStoppedError(HubError):
    """The program on the hub ended, or was stopped, for example with the hub's button."""


class SilentHubError(ProgramStoppedError):
    """The program on the hub ended with a BYE frame, for example after silence of this computer."""


class AmbiguousHubError(HubNotFoundError):
    """Several such hubs are in reach."""

    reason: ClassVar[Reason] = Reason.SEVERAL
