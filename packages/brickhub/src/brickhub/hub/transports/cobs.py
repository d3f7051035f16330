"""Framing over USB: the variant of Consistent Overhead Byte Stuffing (COBS) of SPIKE and Pybricks hubs.

Source: https://lego.github.io/spike-prime-docs/encoding.html. A message is split into blocks at its bytes 0, 1 and 2, which
are removed; a code before each block gives its length (including the code) and the byte that ended it:
``byte * 84 + length + 2``; 255 stands for 84 bytes that none of them ended. Then every byte is XORed with 3, so that no 1,
2 or 3 is left, and 2 ends the frame. A leading 1 (for messages of high priority) is ignored here.
"""

from __future__ import annotations

from brickhub.errors import HubProtocolError

END = 0x02
_HIGH_PRIORITY = 0x01
_XOR = 0x03
_LARGEST_DELIMITER = 2
_CODE_OFFSET = 2
_BLOCK_BYTES = 84
_FULL = 0xFF


def encode(message: bytes) -> bytes:
    """Encode a message into a frame, including its end."""
    out = bytearray((_FULL,))
    code_at = 0
    for byte in message:
        if byte <= _LARGEST_DELIMITER:
            out[code_at] = byte * _BLOCK_BYTES + len(out) - code_at + _CODE_OFFSET
        else:
            out.append(byte)
            if len(out) - code_at <= _BLOCK_BYTES:
                continue
        code_at = len(out)
        out.append(_FULL)
    out[code_at] = len(out) - code_at + _CODE_OFFSET
    return bytes(byte ^ _XOR for byte in out) + bytes((END,))


def decode(frame: bytes) -> bytes:
    """Decode a frame, given without its end, into a message. Raises HubProtocolError if the frame is invalid."""
    data = bytes(byte ^ _XOR for byte in frame.removeprefix(bytes((_HIGH_PRIORITY,))))
    out = bytearray()
    position = 0
    while position < len(data):
        delimiter, size = _parse_code(data[position])
        block = data[position + 1 : position + size]
        if len(block) != size - 1:
            raise HubProtocolError("a frame over USB is cut short; plug the hub in again")
        out += block
        position += size
        if delimiter is not None and position < len(data):
            out.append(delimiter)
    return bytes(out)


def _parse_code(code: int) -> tuple[int | None, int]:
    """The byte that ended a block, if any, and the length of the block including its code."""
    if code == _FULL:
        return None, _BLOCK_BYTES + 1
    if code <= _CODE_OFFSET:
        raise HubProtocolError("a frame over USB has a code that cannot be; plug the hub in again")
    delimiter, size = divmod(code - _CODE_OFFSET - 1, _BLOCK_BYTES)
    return delimiter, size + 1


class Framer:
    """Splitter of a stream into frames. Overlong input is dropped up to the next end. ``damaged``: number of invalid frames."""

    def __init__(self, longest_bytes: int = 2048) -> None:
        self.damaged = 0
        self._longest_bytes = longest_bytes
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the messages that they complete. Never raises."""
        messages = []
        *ended, rest = data.split(bytes((END,)))
        for part in ended:
            self._append(part)
            if message := self._message():
                messages.append(message)
        self._append(rest)
        return messages

    def _append(self, part: bytes) -> None:
        self._buffer += part
        del self._buffer[self._longest_bytes + 1 :]  # one byte tells that it is too long

    def _message(self) -> bytes:
        frame = bytes(self._buffer)
        self._buffer.clear()
        try:
            if len(frame) > self._longest_bytes:
                raise HubProtocolError("a frame over USB is too long; plug the hub in again")
            return decode(frame)
        except HubProtocolError:
            self.damaged += 1
            return b""
