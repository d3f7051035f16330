"""Bluetooth of this computer: diagnosis, remedies, and translation of bleak's errors."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from brickhub.errors import HubError, HubTimeoutError, message_of
from brickhub.hub.hub_errors import BluetoothUnavailableError, HubNotFoundError, Reason
from brickhub.hub.transports.profile import refusal

_HUB_REMEDY = "switch the hub on and bring it near"
_BLUETOOTH_FOLDER = Path("/sys/class/bluetooth")
_RFKILL_FOLDER = Path("/sys/class/rfkill")
_SYSTEM_BUS = Path("/run/dbus/system_bus_socket")
_SERVICES = "`sudo systemctl start dbus bluetooth`"

# Names in bleak's BleakBluetoothNotAvailableReason.
_REASONS = {
    "NO_BLUETOOTH": Reason.NO_ADAPTER,
    "NO_BLE_CENTRAL_ROLE": Reason.NO_ADAPTER,
    "POWERED_OFF": Reason.SWITCHED_OFF,
    "DENIED_BY_USER": Reason.DENIED,
    "DENIED_BY_SYSTEM": Reason.DENIED,
    "DENIED_BY_UNKNOWN": Reason.DENIED,
}
_REMEDIES = {
    "linux": f"see that Bluetooth's service runs ({_SERVICES}) and that you may use it (`brickhub doctor` tells)",
    "darwin": "switch Bluetooth on, and allow the terminal to use it (System Settings, Privacy & Security, Bluetooth)",
    "win32": "switch Bluetooth on (Settings, Bluetooth & devices)",
}


def bluetooth_problem() -> tuple[Reason, str] | None:
    """Reason why Bluetooth is unavailable on Linux: adapter, switch or service. ``None`` if none is found."""
    if sys.platform != "linux":
        return None
    if not (_BLUETOOTH_FOLDER.is_dir() and any(_BLUETOOTH_FOLDER.glob("hci*"))):
        return Reason.NO_ADAPTER, "this computer has no Bluetooth adapter; plug one in"
    for switch in _RFKILL_FOLDER.glob("rfkill*"):
        if _text(switch / "type") == "bluetooth" and "1" in (_text(switch / "soft"), _text(switch / "hard")):
            remedy = "run `rfkill unblock bluetooth`, or use the switch of this computer"
            return Reason.SWITCHED_OFF, f"Bluetooth is switched off; {remedy}"
    if not _SYSTEM_BUS.exists() and "DBUS_SYSTEM_BUS_ADDRESS" not in os.environ:
        return Reason.NO_SERVICE, f"the system bus (D-Bus) does not run, which Bluetooth needs; start both: {_SERVICES}"
    return None


def remedy(platform: str = sys.platform) -> str:
    """Remedy for Bluetooth that fails for an unknown reason."""
    return _REMEDIES.get(platform, "switch this computer's Bluetooth on, and allow this program to use it")


@contextmanager
def bleak_errors(operation: str, default_error: type[HubError]) -> Iterator[None]:
    """Translate bleak's errors during ``operation`` (e.g. ``"connect to the hub"``) into our errors.

    ``default_error`` is the type for errors that bleak does not specify further.
    """
    from bleak.exc import BleakBluetoothNotAvailableError, BleakDeviceNotFoundError, BleakError, BleakGATTProtocolError

    try:
        yield
    except HubError:
        raise
    except BleakGATTProtocolError as error:
        raise refusal(operation, int(error.code)) from error
    except BleakBluetoothNotAvailableError as error:
        raise no_bluetooth(operation, error) from error
    except BleakDeviceNotFoundError as error:
        raise HubNotFoundError(f"could not {operation}: it is not in reach any more; {_HUB_REMEDY}") from error
    except TimeoutError as error:
        raise HubTimeoutError(f"could not {operation} in time; {_HUB_REMEDY}") from error
    except (BleakError, OSError, EOFError) as error:
        if default_error is BluetoothUnavailableError:
            raise no_bluetooth(operation, error) from error
        raise default_error(f"could not {operation} ({message_of(error)}); {_HUB_REMEDY}") from error


def no_bluetooth(operation: str, error: BaseException) -> BluetoothUnavailableError:
    """Error with the reason found on this computer, or else with bleak's."""
    name = getattr(getattr(error, "reason", None), "name", "")
    reason, why = bluetooth_problem() or (_REASONS.get(name, Reason.UNKNOWN), f"{message_of(error)}; {remedy()}")
    return BluetoothUnavailableError(f"could not {operation}: {why}", reason)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except OSError:
        return ""
