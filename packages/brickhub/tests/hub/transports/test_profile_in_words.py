"""Numbers and words of the Pybricks Profile, as the firmware's headers have them."""

from __future__ import annotations

import struct

import pytest

from brickhub.errors import HubBusyError, HubProtocolError, HubRefusedError
from brickhub.hub.transports import profile
from brickhub.hub.transports.profile import CommandError, Event, Feature, Status, StatusReport
from brickhub.robot import HubKind


@pytest.mark.parametrize(
    ("uuid", "number"),
    [
        (profile.SERVICE_UUID, "c5f50001-8280-46da-89f4-6d8051e4aeef"),
        (profile.COMMAND_EVENT_UUID, "c5f50002-8280-46da-89f4-6d8051e4aeef"),
        (profile.CAPABILITIES_UUID, "c5f50003-8280-46da-89f4-6d8051e4aeef"),
        (profile.DEVICE_INFORMATION_UUID, "0000180a-0000-1000-8000-00805f9b34fb"),
        (profile.DEVICE_NAME_UUID, "00002a00-0000-1000-8000-00805f9b34fb"),
        (profile.FIRMWARE_REVISION_UUID, "00002a26-0000-1000-8000-00805f9b34fb"),
        (profile.PROFILE_VERSION_UUID, "00002a28-0000-1000-8000-00805f9b34fb"),
    ],
)
def test_services_and_characteristics(uuid: str, number: str) -> None:
    assert uuid == number


def test_flags_of_a_status_are_bits_of_pbio() -> None:
    """``pbsys_status_t`` of the firmware."""
    bits = {
        Status.BATTERY_LOW: 0,
        Status.BATTERY_EMPTY: 1,
        Status.USER_PROGRAM_RUNNING: 6,
        Status.SHUTDOWN: 7,
        Status.SHUTDOWN_REQUESTED: 8,
        Status.BLE_HOST_CONNECTED: 9,
        Status.BATTERY_HOT: 10,
        Status.BATTERY_TOO_HOT: 11,
    }
    assert list(bits) == list(Status)
    for flag, bit in bits.items():
        event = bytes((Event.STATUS_REPORT,)) + struct.pack("<I", 1 << bit)
        assert profile.parse_event(event) == StatusReport(flag)


@pytest.mark.parametrize("size", [0, 1, 3])
def test_report_that_is_cut_off(size: int) -> None:
    with pytest.raises(HubProtocolError, match=f"a status report of the hub has {size} bytes; up"):
        profile.parse_event(b"\x00" + bytes(size))


def test_report_of_four_bytes_is_whole() -> None:
    assert profile.parse_event(b"\x00" + bytes(4)) == StatusReport(Status(0), 0)


def test_empty_notification() -> None:
    with pytest.raises(HubProtocolError, match="a notification of the hub is empty; update its"):
        profile.parse_event(b"")


def test_capabilities_of_ten_bytes_are_whole() -> None:
    whole = struct.pack("<HII", 20, 2, 7168)
    assert profile.parse_capabilities(whole) == profile.Capabilities(20, Feature.MPY_V6, 7168, 0)
    with pytest.raises(HubProtocolError, match="the hub's capabilities have 9 bytes; update its"):
        profile.parse_capabilities(whole[:-1])


@pytest.mark.parametrize("data", [b"", b"1", b"one.five", b".5"])
def test_version_that_is_none(data: bytes) -> None:
    with pytest.raises(HubProtocolError, match="the hub's profile version is b'.*'; update its"):
        profile.parse_version(data)


def pnp_id(vendor: int, product: int) -> bytes:
    return struct.pack("<BHHH", 1, vendor, product, 0)


def test_a_peak_hub_is_known_by_its_name() -> None:
    assert profile.parse_hub_kind(b"", "Peak-1") is HubKind.PRIME
    with pytest.raises(HubProtocolError, match="the hub's product id is 0102; choose another"):
        profile.parse_hub_kind(b"\x01\x02", "A Peak-1")


@pytest.mark.parametrize(
    ("vendor", "product", "says"),
    [
        (0x0397, 0xE1, "it is an NXT brick, whose memory of 64 KB has no room"),
        (0x0398, 0xE1, "product 0xe1 of company 0x0398, not a LEGO hub; choose another"),
        (0x0397, 0x42, "product 0x42 of company 0x0397, not a LEGO hub; choose another"),
        (0x0694, 0x81, "product 0x81 of company 0x0694, not a LEGO hub; choose another"),
    ],
)
def test_device_that_runs_no_program_of_ours(vendor: int, product: int, says: str) -> None:
    with pytest.raises(HubProtocolError, match=says):
        profile.parse_hub_kind(pnp_id(vendor, product))


def test_ev3_is_a_hub_of_ours() -> None:
    assert profile.parse_hub_kind(pnp_id(0x0397, 0xE2)) is HubKind.EV3
    assert profile.kind_of(0xE2) is HubKind.EV3
    assert profile.kind_of(0xE1) is None


def test_download_is_cut_into_writes_of_the_largest_size() -> None:
    commands = list(profile.download(b"abcdefg", 5 + 3))
    assert commands == [
        b"\x03" + struct.pack("<I", 0),
        b"\x04" + struct.pack("<I", 0) + b"abc",
        b"\x04" + struct.pack("<I", 3) + b"def",
        b"\x04" + struct.pack("<I", 6) + b"g",
        b"\x03" + struct.pack("<I", 7),
    ]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x01, "0x01, invalid handle"),
        (0x06, "0x06, not supported"),
        (0x0E, "0x0e, unlikely error"),
        (0x13, "0x13, value not allowed"),
        (0x80, "0x80, invalid command"),
        (0x82, "0x82, unknown"),
    ],
)
def test_refusal_has_the_name_of_its_code(code: int, words: str) -> None:
    error = profile.refusal("start the program", code)
    assert type(error) is HubRefusedError
    refused = f"could not start the program: the hub refused it (error {words})"
    assert str(error) == f"{refused}; update its firmware on code.pybricks.com"


def test_busy_hub_is_no_refusal() -> None:
    assert CommandError.BUSY == 0x81
    error = profile.refusal("start the program", 0x81)
    assert type(error) is HubBusyError
    busy = "could not start the program: the hub is busy"
    assert str(error) == f"{busy}; stop its program, or wait until it reads its input"
