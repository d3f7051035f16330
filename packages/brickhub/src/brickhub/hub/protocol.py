"""Protocol between host and hub: frames as pure functions, and a decoder for any stream of bytes.

Data frame, both ways: ``A5 seq payload crc8`` with ``seq`` 1..255. Down, the payload is the
actions; up, it is the hub's clock (u16 milliseconds) and the channels; each number is int16 little
endian, ``round(value * scale)``, or int32 for a channel that counts without end. Other channels
saturate, which the host says. Control frame: ``A5 00 kind payload crc8``, ``kind`` one ASCII byte
with a fixed payload length. The lengths of data frames follow from the ``Interface``.
``program/generate.py`` generates the hub's side from these definitions.
"""

import enum
import operator
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from brickhub.errors import BricksError
from brickhub.hub.interface import Interface
from brickhub.robot import Robot

PROTOCOL_VERSION = 1
MAGIC = 0xA5
NOTIFICATION_BYTES = 19
"""Payload of one notification, on every hub; a longer answer takes a further connection
interval."""
WRITE_BYTES = 20
"""Largest write that every hub's standard input buffer accepts."""
APP_DATA_BYTES = WRITE_BYTES + 2
"""Size of a program's AppData buffer: a count, a length, and a frame."""
MAX_ACTIONS = 8
"""Actions of two bytes that fit one write, beside the frame's own bytes."""
CRC_POLYNOMIAL = 0x107

_INT16_LOW = -(2**15)
_INT16_HIGH = 2**15 - 1
_TEXT_BYTES = 4096
"""Size of what is kept of the bytes between frames: more than any traceback."""


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


DOWN_PAYLOAD_BYTES: dict[int, int] = {
    Down.HELLO: 0,
    Down.STOP: 0,
    Down.READ: 1,
    Down.WATCHDOG: 2,
    Down.STREAM: 2,
}
UP_PAYLOAD_BYTES: dict[int, int] = {Up.HELLO: 5, Up.BYE: 1}
DATA_OVERHEAD = 3
CONTROL_OVERHEAD = 4


def _crc_table() -> bytes:
    """Checksum of each single byte."""
    table = []
    for crc in range(256):
        for _ in range(8):
            # This is division by the polynomial, bit by bit. The upper one of its nine bits removes
            # the bit that is shifted out.
            divisor = CRC_POLYNOMIAL if crc & 0x80 else 0
            crc = crc << 1 ^ divisor
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
    # Sequence number 0 marks a control frame, so it is left out.
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
    version, program_hash = struct.unpack("<BI", payload)
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


class WireFormat:
    """Format of an interface's data frames.

    Args:
        robot: the robot of the interface, see `Channel.is_wide`.

    Attributes:
        action_format, answer_format: ``struct`` formats of the actions, and of an answer: the hub's
            clock and the channels.
        down_frame_bytes, answer_bytes: size of a frame with actions, and of an answer's payload.
    """

    def __init__(
        self,
        interface: Interface,
        robot: Robot | None = None,
    ) -> None:
        self._commands = interface.commands
        self._channels = interface.channels
        self._scales = [channel.scale for channel in interface.channels]
        self.action_format = "<" + "h" * len(self._commands)
        self._value_format = "f" * len(self._scales)
        self._are_wide = [channel.is_wide(robot) for channel in interface.channels]
        channel_formats = ["i" if is_wide else "h" for is_wide in self._are_wide]
        self.answer_format = "<H" + "".join(channel_formats)
        self.down_frame_bytes = DATA_OVERHEAD + struct.calcsize(self.action_format)
        self.answer_bytes = struct.calcsize(self.answer_format)

    def encode_actions(self, values: Iterable[float]) -> bytes:
        """Payload for the actions ``[n_commands]`` in the units of their names; values out of range
        saturate. Raises EncodingError for a wrong number of values, or one that is not a number."""
        numbers = [float(value) for value in values]
        names = [command.name for command in self._commands]
        if len(numbers) != len(names):
            raise EncodingError(
                f"got {len(numbers)} values for {len(names)} ({', '.join(names)}); give one "
                "for each"
            )
        wire = []
        for number, command in zip(numbers, self._commands, strict=True):
            # Only NaN differs from itself. Infinities saturate instead.
            if number != number:
                raise EncodingError(
                    f"the value for '{command.name}' is not a number (NaN); look for what "
                    "computed it"
                )
            scaled = number * command.scale
            wire.append(round(min(max(scaled, _INT16_LOW), _INT16_HIGH)))
        return struct.pack(self.action_format, *wire)

    @staticmethod
    def hub_time_ms(payload: bytes) -> int:
        """Hub's clock (0..65535 ms) of an answer."""
        return int.from_bytes(payload[:2], "little")

    def decode_answer(self, payload: bytes) -> tuple[int, tuple[float, ...]]:
        """Hub's clock (0..65535 ms) and the channels ``[n_channels]`` in their units, rounded to
        float32."""
        time_ms, *numbers = struct.unpack(self.answer_format, payload)
        values = map(operator.truediv, numbers, self._scales)
        # Packing and unpacking rounds to float32 without NumPy, so that these are the numbers that
        # a tensor will hold.
        packed = struct.pack(self._value_format, *values)
        return time_ms, struct.unpack(self._value_format, packed)

    def saturated(self, payload: bytes) -> list[str]:
        """Names of the channels of an answer that are at an end of what 16 bits hold, or beyond."""
        _, *numbers = struct.unpack(self.answer_format, payload)
        names = []
        for number, is_wide, channel in zip(
            numbers,
            self._are_wide,
            self._channels,
            strict=True,
        ):
            is_at_end = number in (_INT16_LOW, _INT16_HIGH)
            # No robot ever counts beyond 32 bits, so only narrower fields saturate.
            if is_at_end and not is_wide:
                names.append(channel.name)
        return names


class FrameDecoder:
    """Decoder of frames in a stream of bytes, with any other bytes between them.

    After garbage, it finds the second data frame at the latest, and every intact one before the
    garbage. It never raises.

    Attributes:
        crc_errors: candidates for a frame with a wrong CRC.
        skipped_bytes: bytes that belonged to no frame.
    """

    def __init__(
        self,
        data_payload_bytes: int,
        control_payload_bytes: Mapping[int, int],
    ) -> None:
        self.crc_errors = 0
        self.skipped_bytes = 0
        self._data_size = DATA_OVERHEAD + data_payload_bytes
        self._control_sizes = {
            kind: CONTROL_OVERHEAD + size for kind, size in control_payload_bytes.items()
        }
        self._buffer = bytearray()
        self._text = bytearray()

    @property
    def text(self) -> str:
        """The last skipped bytes as text: a failing program prints its traceback between the
        frames."""
        return self._text.decode("utf-8", "replace")

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes and return the frames that they complete."""
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        start = 0
        while start < len(buffer):
            # Bytes before the next one that may begin a frame belong to no frame.
            if buffer[start] != MAGIC:
                position = buffer.find(MAGIC, start)
                end = len(buffer) if position < 0 else position
                self._skip(buffer[start:end])
                start = end
                continue
            size = self._frame_size(start)
            # Nothing more can be read until the rest of this frame has come.
            if len(buffer) - start < size:
                break
            candidate = bytes(buffer[start : start + size])
            if size and crc8(candidate) == 0:
                frames.append(_frame(candidate))
                start += size
            else:
                # Only one byte is dropped, because a true frame may begin within what looked like
                # one.
                self.crc_errors += size > 0
                self._skip(buffer[start : start + 1])
                start += 1
        del buffer[:start]
        return frames

    def _frame_size(self, start: int) -> int:
        """Length of the frame that begins here, 0 if none can; while unknown, more than the
        available bytes."""
        head = self._buffer[start : start + 3]
        if len(head) < 2:
            return 2
        if head[1]:
            return self._data_size
        if len(head) < 3:
            return 3
        return self._control_sizes.get(head[2], 0)

    def _skip(self, data: bytes | bytearray) -> None:
        self.skipped_bytes += len(data)
        self._text += data
        del self._text[:-_TEXT_BYTES]


def _frame(data: bytes) -> Frame:
    """The frame of these bytes, whose checksum is right."""
    seq = data[1]
    if seq:
        return DataFrame(seq, data[2:-1])
    return ControlFrame(data[2], data[3:-1])
