"""Messages without Bluetooth."""

from __future__ import annotations

from pathlib import Path

import pytest
from bleak.exc import BleakBluetoothNotAvailableError
from bleak.exc import BleakBluetoothNotAvailableReason as BleakReason

from brickhub.errors import BluetoothUnavailableError, Reason
from brickhub.hub.transports import ble
from brickhub.hub.transports.ble import bleak_errors


@pytest.fixture
def linux(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A Linux computer with a Bluetooth adapter and a system bus."""
    (tmp_path / "bluetooth/hci0").mkdir(parents=True)
    (tmp_path / "bus").write_text("")
    for name, path in (
        ("_BLUETOOTH_FOLDER", "bluetooth"),
        ("_RFKILL_FOLDER", "rfkill"),
        ("_SYSTEM_BUS", "bus"),
    ):
        monkeypatch.setattr(ble, name, tmp_path / path)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DBUS_SYSTEM_BUS_ADDRESS", raising=False)
    return tmp_path


def said_when_the_bus_is_not_there(reason: Reason) -> str:
    with (
        pytest.raises(BluetoothUnavailableError) as caught,
        bleak_errors("look for hubs", BluetoothUnavailableError),
    ):
        raise FileNotFoundError(2, "No such file or directory")
    assert caught.value.reason is reason
    return str(caught.value)


def test_system_errors_name_cause(linux: Path) -> None:
    assert "brickhub doctor" in said_when_the_bus_is_not_there(Reason.UNKNOWN)
    (linux / "bus").unlink()
    assert said_when_the_bus_is_not_there(Reason.NO_SERVICE) == (
        "could not look for hubs: the system bus (D-Bus) does not run, which Bluetooth needs; "
        "start both: `sudo systemctl start dbus bluetooth`"
    )
    (linux / "bluetooth/hci0").rmdir()
    assert said_when_the_bus_is_not_there(Reason.NO_ADAPTER).endswith(
        "no Bluetooth adapter; plug one in, or use a cable and --hub usb"
    )


def test_bluetooth_off_is_named(linux: Path) -> None:
    (linux / "rfkill/rfkill0").mkdir(parents=True)
    for name, text in (("type", "bluetooth"), ("soft", "1"), ("hard", "0")):
        (linux / "rfkill/rfkill0" / name).write_text(text)
    assert "rfkill unblock" in said_when_the_bus_is_not_there(Reason.SWITCHED_OFF)


@pytest.mark.parametrize(
    ("told", "reason"),
    [
        (BleakReason.NO_BLUETOOTH, Reason.NO_ADAPTER),
        (BleakReason.POWERED_OFF, Reason.SWITCHED_OFF),
        (BleakReason.DENIED_BY_USER, Reason.DENIED),
        (BleakReason.UNKNOWN, Reason.UNKNOWN),
    ],
)
def test_other_systems_pass_message(
    monkeypatch: pytest.MonkeyPatch, told: BleakReason, reason: Reason
) -> None:
    monkeypatch.setattr("sys.platform", "darwin")
    with (
        pytest.raises(BluetoothUnavailableError) as caught,
        bleak_errors("look for hubs", BluetoothUnavailableError),
    ):
        raise BleakBluetoothNotAvailableError("no", told)
    assert caught.value.reason is reason


@pytest.mark.parametrize(
    ("platform", "says"),
    [("darwin", "Privacy & Security"), ("win32", "Settings"), ("beos", "allow")],
)
def test_other_systems_have_their_own_remedies(
    monkeypatch: pytest.MonkeyPatch, platform: str, says: str
) -> None:
    assert says in ble.remedy(platform)
    monkeypatch.setattr("sys.platform", platform)
    assert ble.bluetooth_problem() is None
