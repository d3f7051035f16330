"""Pybricks Profile as enums and pure functions: the protocol between a host and a hub's firmware
over Bluetooth.

Versions 1.3 to 1.7. Commands are written, with response, to one characteristic; events are notified
by the same one.
"""

import enum
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from brickhub.errors import HubBusyError, HubError, HubProtocolError, HubRefusedError
from brickhub.robot import HubKind

_UUID = "c5f5{:04x}-8280-46da-89f4-6d8051e4aeef"
_STANDARD_UUID = "0000{:04x}-0000-1000-8000-00805f9b34fb"

SERVICE_UUID = _UUID.format(1)
"""Service that every Pybricks hub advertises."""
COMMAND_EVENT_UUID = _UUID.format(2)
CAPABILITIES_UUID = _UUID.format(3)
DEVICE_INFORMATION_UUID = _STANDARD_UUID.format(0x180A)
"""Service of the characteristics whose values are of the hub itself."""
DEVICE_NAME_UUID = _STANDARD_UUID.format(0x2A00)
FIRMWARE_REVISION_UUID = _STANDARD_UUID.format(0x2A26)
PROFILE_VERSION_UUID = _STANDARD_UUID.format(0x2A28)
PNP_ID_UUID = _STANDARD_UUID.format(0x2A50)

LEGO_COMPANY_ID = 0x0397
STATUS_PERIOD_S = 0.5
"""Period of a hub's status reports; changes are reported at once."""

OLDEST_PROFILE = (1, 3)
"""Oldest version that this module was written for."""
NEWEST_PROFILE = (1, 7)
"""Newest version that this module was written for. A newer one adds to it, by its promise."""
_PEAK_PREFIX = "Peak-"
"""Begins the names of PeakHubs, of Sciurus Robotics, which run programs for a Prime hub
(``sciro.hubs``, scirodev 0.7.7)."""
_NXT = 0xE1
_KINDS = {kind.model.product_id: kind for kind in HubKind}
_STATUS_REPORT = struct.Struct("<IxB")
"""Flags, the program's id, and the slot."""
_CAPABILITIES = struct.Struct("<HIIB")
"""Largest write, features, largest program, number of slots."""
_DATA_HEAD = struct.Struct("<BI")
"""Command and size, or offset, of a download."""


class PybricksCommand(enum.IntEnum):
    """First byte of a command of the host."""

    STOP_USER_PROGRAM = 0
    START_USER_PROGRAM = 1
    """Followed by the slot, on a hub with slots. Refused as BUSY while a program runs."""
    START_REPL = 2
    WRITE_USER_PROGRAM_META = 3
    """Followed by u32: the size of the program, 0 while it is being written."""
    WRITE_USER_RAM = 4
    """Followed by u32 offset and a piece of the program."""
    REBOOT_TO_UPDATE_MODE = 5
    WRITE_STDIN = 6
    """Followed by bytes for the program. Refused as a whole, as BUSY, if they do not fit its
    buffer."""
    WRITE_APP_DATA = 7
    """Followed by u16 offset and bytes, which overwrite the buffer: the latest value, no queue."""


class CommandError(enum.IntEnum):
    """Error codes of the attribute protocol (ATT) of a refused command."""

    INVALID_HANDLE = 0x01
    NOT_SUPPORTED = 0x06
    UNLIKELY_ERROR = 0x0E
    VALUE_NOT_ALLOWED = 0x13
    INVALID_COMMAND = 0x80
    BUSY = 0x81


class Event(enum.IntEnum):
    """First byte of a notification of the hub."""

    STATUS_REPORT = 0
    WRITE_STDOUT = 1
    WRITE_APP_DATA = 2


class Status(enum.IntFlag):
    """Status flags of the hub, those that are looked at."""

    BATTERY_LOW = 1 << 0
    BATTERY_EMPTY = 1 << 1
    USER_PROGRAM_RUNNING = 1 << 6
    SHUTDOWN = 1 << 7
    SHUTDOWN_REQUESTED = 1 << 8
    BLE_HOST_CONNECTED = 1 << 9
    BATTERY_HOT = 1 << 10
    BATTERY_TOO_HOT = 1 << 11


class Feature(enum.IntFlag):
    """Feature of a hub's firmware, as far as it matters here."""

    REPL = 1 << 0
    MPY_V6 = 1 << 1
    """Programs of several MicroPython files, compiled for version 6."""


@dataclass(frozen=True)
class Capabilities:
    """Capabilities that a hub reports.

    Attributes:
        max_write_bytes: largest size of a command, including its first byte.
        features: features of the firmware.
        max_program_bytes: largest size of a program.
        slots: number of program slots; 0 before version 1.5 of the profile.
    """

    max_write_bytes: int
    features: Feature
    max_program_bytes: int
    slots: int


@dataclass(frozen=True, slots=True)
class StatusReport:
    """Status report of a hub.

    Attributes:
        flags: status flags.
        slot: selected slot; 0 before version 1.5.
    """

    flags: Status
    slot: int = 0


def parse_event(data: bytes) -> StatusReport | bytes | None:
    """Event in a notification: a report, or output of the program (standard output, at most 19
    bytes, or AppData); ``None`` for an unknown event. Raises HubProtocolError if the notification
    is truncated."""
    if not data:
        raise HubProtocolError(
            "a notification of the hub is empty; update its firmware on code.pybricks.com"
        )
    kind = data[0]
    payload = data[1:]
    if kind in (Event.WRITE_STDOUT, Event.WRITE_APP_DATA):
        return payload
    if kind != Event.STATUS_REPORT:
        return None
    if len(payload) < _STATUS_REPORT.size - 2:
        raise HubProtocolError(
            f"a status report of the hub has {len(payload)} bytes; update its firmware on "
            "code.pybricks.com"
        )
    # Older versions of the profile end before the program's id and the slot, so zeros are added.
    flags, slot = _STATUS_REPORT.unpack_from(payload + bytes(2))
    return StatusReport(Status(flags), slot)


def parse_capabilities(data: bytes) -> Capabilities:
    """Parse the value of the capabilities characteristic. Raises HubProtocolError if the value is
    too short."""
    if len(data) < _CAPABILITIES.size - 1:
        raise HubProtocolError(
            f"the hub's capabilities have {len(data)} bytes; update its firmware on "
            "code.pybricks.com"
        )
    # Before version 1.5 there was no number of slots.
    max_write, features, max_program, slots = _CAPABILITIES.unpack_from(data + b"\0")
    return Capabilities(
        max_write,
        Feature(features),
        max_program,
        slots,
    )


def parse_version(data: bytes) -> tuple[int, int]:
    """Major and minor version from the profile version characteristic, e.g. ``b"1.5.0"``. Raises
    HubProtocolError if the value is no version."""
    match = re.match(rb"(\d+)\.(\d+)", data)
    if match is None:
        raise HubProtocolError(
            f"the hub's profile version is {data!r}; update its firmware on code.pybricks.com"
        )
    return int(match[1]), int(match[2])


def kind_of(product: int) -> HubKind | None:
    """Kind of hub of a product; ``None`` if there is none of ours."""
    return _KINDS.get(product)


def parse_hub_kind(pnp_id: bytes, name: str = "") -> HubKind:
    """Kind of hub from its plug-and-play id, or its name. Raises HubProtocolError if neither is
    that of a known hub."""
    # A PeakHub is not made by LEGO, and is known only by its name.
    if name.startswith(_PEAK_PREFIX):
        return HubKind.PRIME
    try:
        _, vendor, product, _ = struct.unpack("<BHHH", pnp_id)
    except struct.error:
        raise HubProtocolError(
            f"the hub's product id is {pnp_id.hex()}; choose another device"
        ) from None
    if (vendor, product) == (LEGO_COMPANY_ID, _NXT):
        raise HubProtocolError(
            "it is an NXT brick, whose memory of 64 KB has no room for our programs; choose "
            "another hub"
        )
    if vendor != LEGO_COMPANY_ID or product not in _KINDS:
        raise HubProtocolError(
            f"the device is product 0x{product:02x} of company 0x{vendor:04x}, not a LEGO hub; "
            "choose another"
        )
    return _KINDS[product]


def download(blob: bytes, max_write_bytes: int) -> Iterator[bytes]:
    """Commands that download a program to the hub, in order; the program is invalid until the last
    one."""
    # Without a size the hub starts nothing, because an interrupted download must not run.
    yield _DATA_HEAD.pack(PybricksCommand.WRITE_USER_PROGRAM_META, 0)
    piece_bytes = max_write_bytes - _DATA_HEAD.size
    for offset in range(0, len(blob), piece_bytes):
        piece = blob[offset : offset + piece_bytes]
        yield _DATA_HEAD.pack(PybricksCommand.WRITE_USER_RAM, offset) + piece
    yield _DATA_HEAD.pack(PybricksCommand.WRITE_USER_PROGRAM_META, len(blob))


def refusal(operation: str, code: int) -> HubError:
    """Error for a refused command ``operation``, from its error code."""
    if code == CommandError.BUSY:
        return HubBusyError(
            f"could not {operation}: the hub is busy; stop its program, or wait until it reads "
            "its input"
        )
    name = "unknown"
    # A newer firmware may have codes that are not in this table.
    if code in set(CommandError):
        name = CommandError(code).name.lower().replace("_", " ")
    return HubRefusedError(
        f"could not {operation}: the hub refused it (error 0x{code:02x}, {name}); update its "
        "firmware on code.pybricks.com"
    )
