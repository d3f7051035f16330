"""Hub addresses."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from described import SPINNING, TWO_WHEELER
from played_usb_hub import PlayedUsbHub

from brickhub.errors import UnknownNameError
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.program.generate import generate
from brickhub.hub.transports.address import HubAddress, parse_hub
from brickhub.hub.transports.ble import BleTransport
from brickhub.hub.transports.usb import UsbTransport


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("virtual", HubAddress("virtual")),
        ("ble", HubAddress("ble")),
        ("ble:Rover 2", HubAddress("ble", "Rover 2")),
        ("ble:90:84:2B:01:02:03", HubAddress("ble", "90:84:2B:01:02:03")),
        ("usb", HubAddress("usb")),
        ("usb:COM3", HubAddress("usb", "COM3")),
    ],
)
def test_valid_addresses(text: str, meant: HubAddress) -> None:
    assert parse_hub(text) == meant


@pytest.mark.parametrize("text", ["", "wifi", "ble:", "usb:", "virtual:", "virtual:2", "BLE"])
def test_invalid_addresses(text: str) -> None:
    with pytest.raises(UnknownNameError, match="choose 'virtual', 'ble' or 'usb'"):
        parse_hub(text)


def test_transports() -> None:
    named, addressed = (
        parse_hub(f"ble:{which}").transport() for which in ("Rover", "90:84:2b:01:02:03")
    )
    assert isinstance(named, BleTransport) and (named._name, named._address) == ("Rover", None)
    assert isinstance(addressed, BleTransport) and (addressed._name, addressed._address) == (
        None,
        "90:84:2b:01:02:03",
    )
    mac = parse_hub("ble:0A1B2C3D-0A1B-0A1B-0A1B-0A1B2C3D4E5F").transport()
    assert isinstance(mac, BleTransport) and mac._name is None
    assert isinstance(parse_hub("usb:COM3").transport(), UsbTransport)
    with pytest.raises(UnknownNameError, match="no transport of its own"):
        parse_hub("virtual").transport()


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are a thing of POSIX")
@pytest.mark.parametrize("link_class", [HubLink, StreamingLink])
def test_address_to_moving_motors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link_class: type[HubLink]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("brickhub.hub.program.generate.END_MS", 500)
    hub = PlayedUsbHub(TWO_WHEELER)
    hub.library.append(generate(TWO_WHEELER, SPINNING).source)
    try:
        with link_class(
            parse_hub(f"usb:{hub.attach_terminal()}").transport(), TWO_WHEELER, SPINNING
        ) as link:
            for _ in range(3):
                reading = link.act([100, 100])
            assert reading.values[0] > 5
            assert hub.is_running
    finally:
        hub.close()
    assert not hub.is_running
