"""Messages of a framed port, byte by byte: what it asks a hub, and what it takes of its answers."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable

import pytest

from brickhub.errors import HubBusyError, HubProtocolError, HubRefusedError
from brickhub.hub.transports import profile
from brickhub.hub.transports.cobs import Framer, decode_cobs, encode_cobs
from brickhub.hub.transports.framed_port import UNSUBSCRIBED, FramedPort, command_frame


class Carried(FramedPort):
    """A port whose frames a test answers. ``answers``: called with each message to the hub."""

    def __init__(self, answers: Callable[[bytes], list[bytes]], product: int = 0x81) -> None:
        super().__init__("COM3", "39AF", product)
        self.answers = answers
        self.frames: list[bytes] = []
        self.messages: list[bytes] = []

    async def _open(self) -> None:
        self.messages.append(b"open")

    async def _put(self, frame: bytes, operation: str) -> None:
        self.frames.append(frame)
        if frame == b"\x02":
            return
        message = decode_cobs(frame[:-1])
        self.messages.append(message)
        for answer in self.answers(message):
            self._take(encode_cobs(answer))

    async def close(self) -> None: ...


VALUES = {
    (1, 0x2A00): b"Rover",
    (1, 0x2A26): b"4.1.0",
    (1, 0x2A28): b"1.6.0",
    (1, 0x2A50): b"",
    (2, 0x0003): b"caps",
}


def answered(message: bytes) -> list[bytes]:
    """A hub's answers to a message."""
    if message[0] == 3:
        return [b"\x03" + message[1:] + VALUES[struct.unpack("<BH", message[1:])]]
    if message[0] == 2:
        return [struct.pack("<BBI", 1, message[1], 0)]
    return []


def test_port_is_opened_and_asked_for_its_name() -> None:
    async def run() -> None:
        port = Carried(answered)
        await port.open(lambda event: None, lambda reason: None)
        # An end of a frame first, for what another program may have left.
        assert port.frames[0] == b"\x02"
        assert port.messages == [b"open", b"\x03\x01\x00\x2a"]
        assert port.name == "Rover"
        await port.subscribe()
        assert port.messages[-1] == b"\x01\x01"

    asyncio.run(run())


def test_port_without_a_name_keeps_the_one_it_has() -> None:
    async def run() -> None:
        port = Carried(lambda message: [b"\x03" + message[1:]])
        await port.open(lambda event: None, lambda reason: None)
        assert port.name == "COM3"

    asyncio.run(run())


@pytest.mark.parametrize(
    ("characteristic", "asked", "value"),
    [
        (profile.FIRMWARE_REVISION_UUID, b"\x03\x01\x26\x2a", b"4.1.0"),
        (profile.PROFILE_VERSION_UUID, b"\x03\x01\x28\x2a", b"1.6.0"),
        (profile.CAPABILITIES_UUID, b"\x03\x02\x03\x00", b"caps"),
        # Of the first betas, USB itself tells the product.
        (profile.PNP_ID_UUID, b"\x03\x01\x50\x2a", struct.pack("<BHHH", 1, 0x0397, 0x81, 0)),
    ],
)
def test_values_of_a_hub(characteristic: str, asked: bytes, value: bytes) -> None:
    async def run() -> None:
        port = Carried(answered)
        assert await port.read(characteristic) == value
        assert port.messages == [asked]

    asyncio.run(run())


def test_commands_have_tags_from_1_to_255() -> None:
    async def run() -> None:
        port = Carried(answered)
        for _ in range(256):
            await port.write(b"\x06ab", "write")
        assert port.messages[0] == b"\x02\x01\x06ab"
        assert [message[1] for message in port.messages] == [*range(1, 256), 1]

    asyncio.run(run())


@pytest.mark.parametrize(
    ("code", "error"), [(0x81, HubBusyError), (0x80, HubRefusedError), (1 << 16, HubRefusedError)]
)
def test_refused_command(code: int, error: type[Exception]) -> None:
    async def run() -> None:
        port = Carried(lambda message: [struct.pack("<BBI", 1, message[1], code)])
        with pytest.raises(error, match="could not write"):
            await port.write(b"\x06", "write")

    asyncio.run(run())


def test_answer_that_came_too_late_or_is_cut_off_is_none() -> None:
    def late_then_right(message: bytes) -> list[bytes]:
        tag = message[1]
        late = struct.pack("<BBI", 1, tag - 1, 0x80)
        cut_off = struct.pack("<BBI", 1, tag, 0x80)[:-1]
        right = struct.pack("<BBI", 1, tag, 0)
        return [late, cut_off, right, late]

    async def run() -> None:
        port = Carried(late_then_right)
        await port.write(b"\x06", "write")

    asyncio.run(run())


def test_events_and_nothing_else_go_on() -> None:
    async def run() -> None:
        port = Carried(answered)
        events: list[bytes] = []
        await port.open(events.append, lambda reason: None)
        port._take(encode_cobs(b"\x02\x01out") + encode_cobs(b"\x07?")[:-1])
        assert events == [b"\x01out"]
        port._take(b"\x02" + encode_cobs(b"\x03\x01") + encode_cobs(b"\x03\x01\x99\x99x"))
        assert events == [b"\x01out"]
        # A value that nobody waits for any more.
        port._take(encode_cobs(b"\x03\x01\x00\x2aAgain"))
        assert port.name == "Rover"

    asyncio.run(run())


def test_frames_that_nobody_answers() -> None:
    assert decode_cobs(command_frame(b"\x00")[:-1]) == b"\x02\x00\x00"
    assert decode_cobs(UNSUBSCRIBED[:-1]) == b"\x01\x00"


@pytest.mark.parametrize(
    ("message", "frame"),
    [
        # A code is 84 times the byte that ends a block, its length with the code, and 2; each
        # byte is XORed with 3.
        (b"", bytes((3 ^ 3, 2))),
        (b"\x00", bytes((3 ^ 3, 3 ^ 3, 2))),
        (b"\x01", bytes((87 ^ 3, 3 ^ 3, 2))),
        (b"\x02", bytes((171 ^ 3, 3 ^ 3, 2))),
        (b"a\x02b", bytes((172 ^ 3, 97 ^ 3, 4 ^ 3, 98 ^ 3, 2))),
        (b"\x03", bytes((4 ^ 3, 3 ^ 3, 2))),
    ],
)
def test_frames_byte_by_byte(message: bytes, frame: bytes) -> None:
    assert encode_cobs(message) == frame
    assert decode_cobs(frame[:-1]) == message
    # What has a high priority begins with a 1.
    assert decode_cobs(b"\x01" + frame[:-1]) == message


@pytest.mark.parametrize("size", [83, 84, 85, 168, 169])
def test_blocks_without_an_end_have_84_bytes(size: int) -> None:
    message = b"x" * size
    frame = encode_cobs(message)
    assert decode_cobs(frame[:-1]) == message
    codes = 1 + size // 84
    assert len(frame) == size + codes + 1
    assert frame.count(255 ^ 3) == size // 84


@pytest.mark.parametrize(
    "frame",
    # Codes of 0, 1 and, after a whole block, 2; each byte is XORed with 3.
    [b"\x03", b"\x02", encode_cobs(b"a")[:-1] + b"\x01"],
)
def test_code_that_cannot_be(frame: bytes) -> None:
    with pytest.raises(HubProtocolError, match="has a code that cannot be; plug the hub in again"):
        decode_cobs(frame)


def test_frame_that_is_cut_short() -> None:
    with pytest.raises(HubProtocolError, match="is cut short; plug the hub in again"):
        decode_cobs(encode_cobs(b"abc")[:-2])


def test_stream_is_split_and_overlong_input_dropped() -> None:
    framer = Framer(longest_bytes=6)
    assert framer.feed(encode_cobs(b"abc") + b"\x02" + encode_cobs(b"de")) == [b"abc", b"de"]
    assert framer.damaged == 0
    # Six bytes are not too long, seven are.
    assert framer.feed(encode_cobs(b"12345")) == [b"12345"]
    assert framer.feed(encode_cobs(b"123456")) == []
    assert framer.damaged == 1
    assert framer.feed(b"y" * 5000) == []
    assert framer.feed(b"\x02" + encode_cobs(b"f")) == [b"f"]
    assert framer.damaged == 2
