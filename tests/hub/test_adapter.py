"""What is said where this computer has no Bluetooth."""

from __future__ import annotations

from pathlib import Path

import pytest

from bricksrl.hub import adapter
from bricksrl.hub.failures import BluetoothUnavailableError, bleak_errors


@pytest.fixture
def linux(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A computer with Linux that has an adapter, and a system bus."""
    (tmp_path / "bluetooth/hci0").mkdir(parents=True)
    (tmp_path / "bus").write_text("")
    for name, path in (("_BLUETOOTH_FOLDER", "bluetooth"), ("_RFKILL_FOLDER", "rfkill"), ("_SYSTEM_BUS", "bus")):
        monkeypatch.setattr(adapter, name, tmp_path / path)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DBUS_SYSTEM_BUS_ADDRESS", raising=False)
    return tmp_path


def said_when_the_bus_is_not_there() -> str:
    with pytest.raises(BluetoothUnavailableError) as caught, bleak_errors("look for hubs", BluetoothUnavailableError):
        raise FileNotFoundError(2, "No such file or directory")
    return str(caught.value)


def test_an_error_of_the_system_is_told_as_what_is_missing(linux: Path) -> None:
    assert "bricksrl doctor" in said_when_the_bus_is_not_there()
    (linux / "bus").unlink()
    assert said_when_the_bus_is_not_there() == (
        "could not look for hubs: the system bus (D-Bus) does not run, which Bluetooth needs; "
        "start both: `sudo systemctl start dbus bluetooth`"
    )
    (linux / "bluetooth/hci0").rmdir()
    assert said_when_the_bus_is_not_there().endswith("no Bluetooth adapter; plug one in")


@pytest.mark.parametrize(("platform", "says"), [("darwin", "Privacy & Security"), ("win32", "Settings"), ("beos", "allow")])
def test_other_systems_have_their_own_remedies(monkeypatch: pytest.MonkeyPatch, platform: str, says: str) -> None:
    assert says in adapter.remedy(platform)
    monkeypatch.setattr("sys.platform", platform)
    assert adapter.lack_of_bluetooth() is None
