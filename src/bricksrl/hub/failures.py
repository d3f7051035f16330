"""Why a link to a hub cannot be had, or breaks: children of ``HubError``, and what bleak's errors mean."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from bricksrl.errors import HubError, HubTimeoutError
from bricksrl.hub.adapter import lack_of_bluetooth, remedy
from bricksrl.hub.pybricks_profile import CommandError

_HUB_REMEDY = "switch the hub on and bring it near"


class MediumUnavailableError(HubError):
    """This computer lacks what is needed to reach a hub."""


class BluetoothUnavailableError(MediumUnavailableError):
    """This computer has no Bluetooth, or does not let us use it."""


class UsbUnavailableError(MediumUnavailableError):
    """This computer does not let us use its serial ports."""


class HubNotFoundError(HubError):
    """No hub, or not the one that was asked for, is in reach."""


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


@contextmanager
def bleak_errors(what: str, otherwise: type[HubError]) -> Iterator[None]:
    """Turns what bleak raises while it does ``what`` (e.g. ``"connect to the hub"``) into our errors.

    ``otherwise`` is the error for what bleak does not explain further.
    """
    from bleak.exc import BleakBluetoothNotAvailableError, BleakDeviceNotFoundError, BleakError, BleakGATTProtocolError

    try:
        yield
    except HubError:
        raise
    except BleakGATTProtocolError as error:
        raise refusal(what, int(error.code)) from error
    except BleakBluetoothNotAvailableError as error:
        raise no_bluetooth(what, error) from error
    except BleakDeviceNotFoundError as error:
        raise HubNotFoundError(f"could not {what}: it is not in reach any more; {_HUB_REMEDY}") from error
    except TimeoutError as error:
        raise HubTimeoutError(f"could not {what} in time; {_HUB_REMEDY}") from error
    except (BleakError, OSError, EOFError) as error:
        if otherwise is BluetoothUnavailableError:
            raise no_bluetooth(what, error) from error
        raise otherwise(f"could not {what} ({_one_line(error)}); {_HUB_REMEDY}") from error


def no_bluetooth(what: str, error: BaseException) -> BluetoothUnavailableError:
    """What this computer lacks, or else what the error says."""
    return BluetoothUnavailableError(f"could not {what}: {lack_of_bluetooth() or f'{_one_line(error)}; {remedy()}'}")


def refusal(what: str, code: int) -> HubError:
    """The error for an error code of the profile, with which a hub refused ``what``."""
    if code == CommandError.BUSY:
        return HubBusyError(f"could not {what}: the hub is busy; stop its program, or wait until it reads its input")
    name = CommandError(code).name.lower().replace("_", " ") if code in set(CommandError) else "unknown"
    return HubRefusedError(
        f"could not {what}: the hub refused it (error 0x{code:02x}, {name}); update its firmware on code.pybricks.com"
    )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
