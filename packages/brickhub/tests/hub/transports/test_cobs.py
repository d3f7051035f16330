"""COBS frames of USB."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import HubProtocolError
from brickhub.hub.transports.cobs import FRAME_END, Framer, decode_cobs, encode_cobs

messages = (
    st.binary(max_size=300)
    | st.lists(st.integers(0, 4), max_size=300).map(bytes)
    | st.integers(0, 300).map(lambda n: b"x" * n)
)


def test_cobs_published_example() -> None:
    """From https://lego.github.io/spike-prime-docs/encoding.html, before the XOR."""
    assert bytes(byte ^ 3 for byte in encode_cobs(bytes((0, 1, 2, 3)))[:-1]) == bytes(
        (3, 87, 171, 4, 3)
    )


@given(messages)
def test_cobs_round_trip(message: bytes) -> None:
    frame = encode_cobs(message)
    assert frame[-1] == FRAME_END and not {1, 2, 3} & set(frame[:-1])
    assert len(frame) <= len(message) + len(message) // 84 + 2
    assert decode_cobs(frame[:-1]) == message == decode_cobs(b"\x01" + frame[:-1])


@given(st.binary(max_size=600))
def test_any_bytes_raise_only_our_error(data: bytes) -> None:
    with contextlib.suppress(HubProtocolError):
        assert len(decode_cobs(data)) <= len(data)


@given(
    st.binary(max_size=400),
    st.lists(st.binary(min_size=1, max_size=60), min_size=2, max_size=5),
    st.integers(1, 50),
)
def test_reader_resyncs_within_two_frames(garbage: bytes, sent: list[bytes], piece: int) -> None:
    framer = Framer()
    stream = garbage + b"".join(map(encode_cobs, sent))
    received = [
        m
        for start in range(0, len(stream), piece)
        for m in framer.feed(stream[start : start + piece])
    ]
    assert received[-len(sent) + 1 :] == sent[1:]


def test_endless_frame_is_bounded() -> None:
    framer = Framer(longest_bytes=100)
    for _ in range(1000):
        assert framer.feed(b"x" * 50) == []
    assert framer.damaged == 0
    assert framer.feed(bytes((FRAME_END,)) + encode_cobs(b"hello")) == [b"hello"]
    assert framer.damaged == 1


@pytest.mark.parametrize("frame", [b"\x03", b"\x02\x02", bytes((50 ^ 3,)) + b"short"])
def test_invalid_frames(frame: bytes) -> None:
    with pytest.raises(HubProtocolError):
        decode_cobs(frame)
