"""The bytes of the Pybricks Profile."""

from __future__ import annotations

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import HubProtocolError
from brickhub.hub.transports import profile
from brickhub.hub.transports.profile import Feature, PybricksCommand, Status, StatusReport
from brickhub.robot import HubKind


def test_uuids() -> None:
    assert profile.SERVICE_UUID == "c5f50001-8280-46da-89f4-6d8051e4aeef"
    assert profile.PNP_ID_UUID == "00002a50-0000-1000-8000-00805f9b34fb"


def test_commands() -> None:
    names = (
        "STOP_USER_PROGRAM START_USER_PROGRAM START_REPL WRITE_USER_PROGRAM_META "
        "WRITE_USER_RAM REBOOT_TO_UPDATE_MODE"
    )
    assert [
        command.name for command in PybricksCommand
    ] == f"{names} WRITE_STDIN WRITE_APP_DATA".split()
    assert list(PybricksCommand) == list(range(8))


@given(st.binary(max_size=2000), st.integers(6, 512))
def test_download_writes_every_byte(blob: bytes, max_write_bytes: int) -> None:
    commands = list(profile.download(blob, max_write_bytes))
    assert all(len(command) <= max_write_bytes for command in commands)
    assert commands[0] == b"\x03\0\0\0\0" and commands[-1] == b"\x03" + struct.pack("<I", len(blob))
    memory = bytearray(len(blob))
    for command in commands[1:-1]:
        kind, offset = struct.unpack("<BI", command[:5])
        assert kind == 4
        memory[offset : offset + len(command) - 5] = command[5:]
    assert bytes(memory) == blob


@pytest.mark.parametrize(
    ("data", "report"),
    [
        (b"\x00\x41\x00\x00\x00", StatusReport(Status.USER_PROGRAM_RUNNING | Status.BATTERY_LOW)),
        (b"\x00\x00\x02\x00\x00\x80", StatusReport(Status.BLE_HOST_CONNECTED)),
        (b"\x00\x00\x00\x00\x00\x00\x02", StatusReport(Status(0), 2)),
    ],
)
def test_status_reports_of_all_versions(data: bytes, report: StatusReport) -> None:
    assert profile.parse_event(data) == report


def test_other_events() -> None:
    assert profile.parse_event(b"\x01hello") == b"hello"
    assert profile.parse_event(b"\x02\x00") == b"\x00"
    assert profile.parse_event(b"\x07?") is None


@given(st.binary(max_size=30))
def test_any_bytes_give_value_or_our_error(data: bytes) -> None:
    for parse in (
        profile.parse_event,
        profile.parse_capabilities,
        profile.parse_version,
        profile.parse_hub_kind,
    ):
        with contextlib.suppress(HubProtocolError):
            parse(data)


def test_capabilities_with_and_without_slots() -> None:
    data = struct.pack("<HIIB", 155, 3, 32768, 1)
    assert profile.parse_capabilities(data) == profile.Capabilities(
        155, Feature.REPL | Feature.MPY_V6, 32768, 1
    )
    assert profile.parse_capabilities(data[:-1]).slots == 0


def test_versions() -> None:
    assert profile.parse_version(b"1.5.0") == (1, 5) and profile.parse_version(b"1.10.2") == (1, 10)


@pytest.mark.parametrize(
    ("product", "kind"),
    [
        (0x40, HubKind.MOVE),
        (0x41, HubKind.CITY),
        (0x80, HubKind.TECHNIC),
        (0x81, HubKind.PRIME),
        (0x83, HubKind.ESSENTIAL),
    ],
)
def test_hub_kinds(product: int, kind: HubKind) -> None:
    assert profile.parse_hub_kind(struct.pack("<BHHH", 1, 0x0397, product, 0)) is kind


@pytest.mark.parametrize(("vendor", "product"), [(0x0397, 0x99), (0x004C, 0x81)])
def test_other_devices_are_not_hubs(vendor: int, product: int) -> None:
    with pytest.raises(HubProtocolError, match="not a LEGO hub"):
        profile.parse_hub_kind(struct.pack("<BHHH", 1, vendor, product, 0))
