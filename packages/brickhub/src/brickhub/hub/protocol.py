"""Protocol between host and hub: frames as pure functions, and a decoder for any stream of bytes.

Data frame, both ways: ``A5 seq payload crc8`` with ``seq`` 1..255. Down, the payload is the actions; up, it is
the hub's clock (u16 milliseconds) and the channels; each number is int16 little endian, ``round(value * scale)``.
Control frame: ``A5 00 kind payload crc8``, ``kind`` one ASCII byte with a fixed payload length. The lengths of
data frames follow from the ``Interface``. ``program/generate.py`` generates the hub's side from these definitions.
"""

from __future__ import annotations

import enum
import operator
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from brickhub.errors import BricksError, HubProtocolError
from brickhub.hub.interface import Interface

PROTOCOL_VERSION = 1
MAGIC = 0xA5
NOTIFICATION_BYTES = 19
"""Payload of one notification, on every hub; a longer answer takes a further connection interval."""
WRITE_BYTES = 20
"""Largest write that every hub's standard input buffer accepts."""
APP_DATA_BYTES = WRITE_BYTES + 2
"""Size of a program's AppData buffer: a count, a length, and a frame."""
MAX_ACTIONS = 8
CRC_POLYNOMIAL = 0x107

_INT16_LOW, _INT16_HIGH = -(2**15), 2**15 - 1
_TEXT_BYTES = 4096


class EncodingError(BricksError, ValueError):
    """Values that cannot be encoded."""


class Down(enum.IntEnum):
    """Kinds of control frames to the hub."""

    HELLO = ord("H")
    STOP = ord("S")
    READ = ord("R")
    WATCHDOG = ord("W")
    STREAM = ord("T")


class Up(enum.IntEnum):
    """Kinds of control frames from the hub."""

    HELLO = ord("H")
    BYE = ord("B")


class ByeReason(enum.IntEnum):
    """Reason why the program on the hub ended."""

    STOPPED = 1
    SILENCE = 2


DOWN_PAYLOAD_BYTES: dict[int, int] = {Down.HELLO: 0, Down.STOP: 0, Down.READ: 1, Down.WATCHDOG: 2, Down.STREAM: 2}
UP_PAYLOAD_BYTES: dict[int, int] = {Up.HELLO: 5, Up.BYE: 1}
DATA_OVERHEAD = 3
CONTROL_OVERHEAD = 4


def _crc_table() -> bytes:
    table = []
    for crc in range(256):
        for _ in range(8):
            crc = crc << 1 ^ (CRC_POLYNOMIAL if crc & 0x80 else 0)
        table.append(crc)
    return bytes(table)


_CRC_TABLE = _crc_table()


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 0x07 and initial value 0; over a frame with its own crc it is 0."""
    crc = 0
    for byte in data:
        crc = _CRC_TABLE[crc ^ byte]
    return crc


def next_seq(seq: int) -> int:
    """Sequence number after ``seq``: 1..255, never 0."""
    return seq % 255 + 1


def data_frame(seq: int, payload: bytes) -> bytes:
    """Bytes of a data frame. Raises EncodingError if ``seq`` is not in 1..255."""
    if not 1 <= seq <= 255:
        raise EncodingError(f"sequence number {seq} does not fit a data frame; use 1 to 255")
    head = bytes((MAGIC, seq)) + payload
    return head + bytes((crc8(head),))


def control_frame(kind: int, payload: bytes = b"") -> bytes:
    """Bytes of a control frame."""
    head = bytes((MAGIC, 0, kind)) + payload
    return head + bytes((crc8(head),))


def hello_payload(program_hash: int) -> bytes:
    """Payload of the hub's HELLO."""
    return struct.pack("<BI", PROTOCOL_VERSION, program_hash)


def parse_hello(payload: bytes) -> tuple[int, int]:
    """Protocol version and program hash of the hub's HELLO."""
    version, program_hash = _unpack("<BI", payload)
    return version, program_hash


@dataclass(frozen=True, slots=True)
class DataFrame:
    """Actions or channels, with a sequence number."""

    seq: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class ControlFrame:
    """Control frame; ``kind`` is a :class:`Down` or :class:`Up`."""

    kind: int
    payload: bytes


Frame = DataFrame | ControlFrame


@dataclass(frozen=True)
class WireFormat:
    """Format of an interface's data frames.

    Attributes:
        command_names, command_scales: names and scales of the actions, in order.
        channel_names, channel_scales: names and scales of the channels, in order.
    """

    command_names: tuple[str, ...]
    command_scales: tuple[int, ...]
    channel_names: tuple[str, ...]
    channel_scales: tuple[int, ...]

    @classmethod
    def of(cls, interface: Interface) -> WireFormat:
        """Format of an interface."""
        return cls(
            tuple(command.name for command in interface.commands),
            tuple(command.scale for command in interface.commands),
            tuple(channel.name for channel in interface.channels),
            tuple(channel.scale for channel in interface.channels),
        )

    @cached_property
    def action_format(self) -> str:
        """``struct`` format of the actions."""
        return "<" + "h" * len(self.command_scales)

    @cached_property
    def answer_format(self) -> str:
        """``struct`` format of an answer: the hub's clock and the channels."""
        return "<H" + "h" * len(self.channel_scales)

    @cached_property
    def _value_format(self) -> str:
        """``struct`` format of the channels' values as float32, to round them."""
        return "f" * len(self.channel_scales)

    @cached_property
    def action_bytes(self) -> int:
        return struct.calcsize(self.action_format)

    @cached_property
    def answer_bytes(self) -> int:
        return struct.calcsize(self.answer_format)

    @property
    def down_frame_bytes(self) -> int:
        return DATA_OVERHEAD + self.action_bytes

    def encode_actions(self, values: Iterable[float]) -> bytes:
        """Payload for the actions ``[n_commands]`` in the units of their names; values out of range saturate. Raises
        EncodingError for a wrong number of values, or one that is not a number."""
        return struct.pack(self.action_format, *_to_int16(values, self.command_scales, self.command_names))

    def encode_answer(self, time_ms: int, values: Iterable[float]) -> bytes:
        """Payload of an answer with the channels ``[n_channels]``; the clock wraps at 65536 ms. Raises EncodingError if the wrong
        number of values, or one that is not a number."""
        numbers = _to_int16(values, self.channel_scales, self.channel_names)
        return struct.pack(self.answer_format, time_ms & 0xFFFF, *numbers)

    def decode_answer(self, payload: bytes) -> tuple[int, tuple[float, ...]]:
        """Hub's clock (0..65535 ms) and the channels ``[n_channels]`` in their units, rounded to float32. Raises HubProtocolError
        if the payload has another length."""
        time_ms, *numbers = _unpack(self.answer_format, payload)
        values = map(operator.truediv, numbers, self.channel_scales)
        return time_ms, struct.unpack(self._value_format, struct.pack(self._value_format, *values))


class FrameDecoder:
    """Decoder of frames in a stream of bytes, with any other bytes between them.

    After garbage, it finds the second data frame at the latest, and every intact one before the garbage. It never raises.

    Attributes:
        crc_errors: candidates for a frame with a wrong CRC.
        skipped_bytes: bytes that belonged to no frame.
    """

    def __init__(self, data_payload_bytes: int, control_payload_bytes: Mapping[int, int]) -> None:
        self.crc_errors = 0
        self.skipped_bytes = 0
        self._data_size = DATA_OVERHEAD + data_payload_bytes
        self._control_sizes = {kind: CONTROL_OVERHEAD + size for kind, size in control_payload_bytes.items()}
        self._buffer = bytearray()
        self._text = bytearray()

    @property
    def text(self) -> str:
        """The last skipped bytes as text: a failing program prints its traceback between the frames."""
        return self._text.decode("utf-8", "replace")

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes and return the frames that they complete."""
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        start = 0
        while start < len(buffer):
            if buffer[start] != MAGIC:
                position = buffer.find(MAGIC, start)
                end = len(buffer) if position < 0 else position
                self._skip(buffer[start:end])
                start = end
                continue
            size = self._frame_size(start)
            if len(buffer) - start < size:
                break
            candidate = bytes(buffer[start : start + size])
            if size and crc8(candidate) == 0:
                frames.append(_parse(candidate))
                start += size
            else:
                self.crc_errors += size > 0
                self._skip(buffer[start : start + 1])
                start += 1
        del buffer[:start]
        return frames

    def _frame_size(self, start: int) -> int:
        """Length of the frame that begins here, 0 if none can; while unknown, more than the available bytes."""
        head = self._buffer[start : start + 3]
        if len(head) < 2:
            return 2
        if head[1]:
            return self._data_size
        return self._control_sizes.get(head[2], 0) if len(head) == 3 else 3

    def _skip(self, data: bytes | bytearray) -> None:
        self.skipped_bytes += len(data)
        self._text += data
        del self._text[:-_TEXT_BYTES]


def _parse(frame: bytes) -> Frame:
    return DataFrame(frame[1], frame[2:-1]) if frame[1] else ControlFrame(frame[2], frame[3:-1])


def _to_int16(values: Iterable[float], scales: tuple[int, ...], names: tuple[str, ...]) -> list[int]:
    numbers = [float(value) for value in values]
    if len(numbers) != len(scales):
        raise EncodingError(f"got {len(numbers)} values for {len(scales)} ({', '.join(names)}); give one for each")
    wire = []
    for number, scale, name in zip(numbers, scales, names, strict=True):
        if number != number:
            raise EncodingError(f"the value for '{name}' is not a number (NaN); look for what computed it")
        wire.append(round(min(max(number * scale, _INT16_LOW), _INT16_HIGH)))
    return wire


def _unpack(struct_format: str, payload: bytes) -> tuple[int, ...]:
    try:
        return struct.unpack(struct_format, payload)
    except struct.error:
        raise HubProtocolError(
            f"a payload has {len(payload)} bytes, not {struct.calcsize(struct_format)}; give hub and host the same interface"
        ) from None
