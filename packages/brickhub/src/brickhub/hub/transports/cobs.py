"""Frames of a message over USB.

They are the variant of Consistent Overhead Byte Stuffing (COBS) of SPIKE and Pybricks hubs
(https://lego.github.io/spike-prime-docs/encoding.html). A message is split into blocks at its bytes
0, 1 and 2, which are removed; a code before each block gives its length (including the code) and
the byte that ended it: ``byte * 84 + length + 2``; 255 stands for 84 bytes that none of them ended.
Then every byte is XORed with 3, so that no 1, 2 or 3 is left, and 2 ends the frame. A leading 1
(for messages of high priority) is ignored here.
"""

from brickhub import errors

FRAME_END = 0x02
_HIGH_PRIORITY = 0x01
_XOR = 0x03
_LARGEST_DELIMITER = 2
"""Bytes from 0 to this one end a block."""
_CODE_OFFSET = 2
"""Added to every code, so that none is one of the reserved bytes."""
_BLOCK_BYTES = 84
"""Largest block without its code: three delimiters times this many lengths fit a byte."""
_FULL = 0xFF
"""Code of a block of the full size that no delimiter ended."""


def encode_cobs(message: bytes) -> bytes:
    """Encode a message into a frame, including its end."""
    # The code of a block stands before it but is known only at its end; until then it is that of a
    # full block.
    out = bytearray((_FULL,))
    code_at = 0
    for byte in message:
        if byte <= _LARGEST_DELIMITER:
            block_bytes = len(out) - code_at
            out[code_at] = byte * _BLOCK_BYTES + block_bytes + _CODE_OFFSET
        else:
            out.append(byte)
            is_full = len(out) - code_at > _BLOCK_BYTES
            if not is_full:
                continue
        code_at = len(out)
        out.append(_FULL)
    # The last block ends as if a 0 followed, which the decoder leaves out.
    out[code_at] = len(out) - code_at + _CODE_OFFSET
    stuffed = bytes(byte ^ _XOR for byte in out)
    return stuffed + bytes((FRAME_END,))


def decode_cobs(frame: bytes) -> bytes:
    """Decode a frame, given without its end, into a message. Raises HubProtocolError if the frame
    is invalid."""
    stuffed = frame.removeprefix(bytes((_HIGH_PRIORITY,)))
    data = bytes(byte ^ _XOR for byte in stuffed)
    out = bytearray()
    position = 0
    while position < len(data):
        delimiter, size = _parse_code(data[position])
        block = data[position + 1 : position + size]
        if len(block) != size - 1:
            raise errors.HubProtocolError("a frame over USB is cut short; plug the hub in again")
        out += block
        position += size
        # What ended the last block is the end of the message and no byte of it.
        if delimiter is not None and position < len(data):
            out.append(delimiter)
    return bytes(out)


def _parse_code(code: int) -> tuple[int | None, int]:
    """The byte that ended a block, if any, and the length of the block including its code."""
    if code == _FULL:
        return None, _BLOCK_BYTES + 1
    if code <= _CODE_OFFSET:
        raise errors.HubProtocolError(
            "a frame over USB has a code that cannot be; plug the hub in again"
        )
    delimiter, size = divmod(code - _CODE_OFFSET - 1, _BLOCK_BYTES)
    return delimiter, size + 1


class Framer:
    """Splitter of a stream into frames. Overlong input is dropped up to the next end. ``damaged``:
    number of invalid frames."""

    def __init__(self, longest_bytes: int = 2048) -> None:
        self.damaged = 0
        self._longest_bytes = longest_bytes
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the messages that they complete. Never raises."""
        messages = []
        *frames, rest = (self._buffer + data).split(bytes((FRAME_END,)))
        for frame in frames:
            try:
                if len(frame) > self._longest_bytes:
                    raise errors.HubProtocolError(
                        "a frame over USB is too long; plug the hub in again"
                    )
                message = decode_cobs(frame)
            except errors.HubProtocolError:
                self.damaged += 1
                continue
            # Two ends in a row have no message between them.
            if message:
                messages.append(message)
        # One byte more than allowed is kept, by which a frame that is too long is recognised.
        self._buffer = rest[: self._longest_bytes + 1]
        return messages
