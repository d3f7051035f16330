"""What of Bluetooth this computer lacks, and the remedy."""

from __future__ import annotations

import os
import sys
from pathlib import Path

_BLUETOOTH_FOLDER = Path("/sys/class/bluetooth")
_RFKILL_FOLDER = Path("/sys/class/rfkill")
_SYSTEM_BUS = Path("/run/dbus/system_bus_socket")
_SERVICES = "`sudo systemctl start dbus bluetooth`"

_REMEDIES = {
    "linux": f"see that Bluetooth's service runs ({_SERVICES}) and that you may use it (`bricksrl doctor` tells)",
    "darwin": "switch Bluetooth on, and allow the terminal to use it (System Settings, Privacy & Security, Bluetooth)",
    "win32": "switch Bluetooth on (Settings, Bluetooth & devices)",
}


def lack_of_bluetooth() -> str | None:
    """On Linux, what is missing, from the outside in: adapter, switch, service. ``None`` where nothing can be told."""
    if sys.platform != "linux":
        return None
    if not (_BLUETOOTH_FOLDER.is_dir() and any(_BLUETOOTH_FOLDER.glob("hci*"))):
        return "this computer has no Bluetooth adapter; plug one in"
    for switch in _RFKILL_FOLDER.glob("rfkill*"):
        if _text(switch / "type") == "bluetooth" and "1" in (_text(switch / "soft"), _text(switch / "hard")):
            return "Bluetooth is switched off; run `rfkill unblock bluetooth`, or use the switch of this computer"
    if not _SYSTEM_BUS.exists() and "DBUS_SYSTEM_BUS_ADDRESS" not in os.environ:
        return f"the system bus (D-Bus) does not run, which Bluetooth needs; start both: {_SERVICES}"
    return None


def remedy(platform: str = sys.platform) -> str:
    """What to do where Bluetooth fails for an unknown reason."""
    return _REMEDIES.get(platform, "switch this computer's Bluetooth on, and allow this program to use it")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except OSError:
        return ""
