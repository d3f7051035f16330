"""Frames of the wire protocol."""

from __future__ import annotations

import ctypes
import itertools
import struct
from types import SimpleNamespace

import pytest
from described import RUN_AWAY, SPINNING, WALKING
from hypothesis import given
from hypothesis import strategies as st

from brickhub.hub.interface import RunAngle
from brickhub.hub.protocol import (
    APP_DATA_BYTES,
    CRC_POLYNOMIAL,
    DOWN_PAYLOAD_BYTES,
    MAX_ACTIONS,
    NOTIFICATION_BYTES,
    UP_PAYLOAD_BYTES,
    WRITE_BYTES,
    ByeReason,
    ControlFrame,
    DataFrame,
    Down,
    EncodingError,
    Frame,
    FrameDecoder,
    Up,
    WireFormat,
    control_frame,
    crc8,
    data_frame,
    hello_payload,
    next_seq,
    parse_hello,
)

PAYLOAD_BYTES = 12

payloads = st.binary(min_size=PAYLOAD_BYTES, max_size=PAYLOAD_BYTES)
data_frames = st.builds(DataFrame, st.integers(1, 255), payloads)
hellos = st.builds(
    lambda program_hash: ControlFrame(Up.HELLO, hello_payload(program_hash)),
    st.integers(0, 2**32 - 1),
)
byes = st.sampled_from([ControlFrame(Up.BYE, bytes([reason])) for reason in ByeReason])
frames = st.one_of(data_frames, hellos, byes)


def decoder() -> FrameDecoder:
    return FrameDecoder(PAYLOAD_BYTES, UP_PAYLOAD_BYTES)


def encode(frame: Frame) -> bytes:
    return (
        data_frame(frame.seq, frame.payload)
        if isinstance(frame, DataFrame)
        else control_frame(frame.kind, frame.payload)
    )


def crc8_bit_by_bit(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc << 1 ^ (CRC_POLYNOMIAL if crc & 0x80 else 0)
    return crc


@given(st.binary(max_size=40))
def test_crc(data: bytes) -> None:
    assert crc8(data) == crc8_bit_by_bit(data)
    assert crc8(data + bytes([crc8(data)])) == 0


def test_crc_check_value() -> None:
    assert crc8(b"123456789") == 0xF4  # published for CRC-8, polynomial 07


def test_sequence_numbers_are_1_to_255() -> None:
    seqs = list(
        itertools.islice(
            itertools.accumulate(itertools.repeat(0), lambda seq, _: next_seq(seq)), 1, 512
        )
    )
    assert seqs == [*range(1, 256), *range(1, 256), 1]


@pytest.mark.parametrize("seq", [0, 256, -1])
def test_invalid_sequence_numbers_raise(seq: int) -> None:
    with pytest.raises(EncodingError, match="sequence"):
        data_frame(seq, b"")


@given(st.lists(frames, max_size=8), st.lists(st.integers(0, 200), max_size=10))
def test_frames_survive_any_splitting(sent: list[Frame], cuts: list[int]) -> None:
    stream = b"".join(map(encode, sent))
    places = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    reader, received = decoder(), []
    for start, end in itertools.pairwise(places):
        received += reader.feed(stream[start:end])
    assert received == sent
    assert (reader.crc_errors, reader.skipped_bytes) == (0, 0)


@given(st.lists(st.binary(max_size=60), max_size=6))
def test_reader_accounts_for_all_bytes(chunks: list[bytes]) -> None:
    reader = decoder()
    received = [frame for chunk in chunks for frame in reader.feed(chunk)]
    used = sum(len(encode(frame)) for frame in received)
    waiting = sum(map(len, chunks)) - used - reader.skipped_bytes
    assert 0 <= waiting < PAYLOAD_BYTES + 3
    for frame in received:
        assert encode(frame) in b"".join(chunks)  # whole, crc included


@given(st.binary(max_size=60), data_frames, data_frames, data_frames)
def test_reader_resyncs_within_two_frames(
    garbage: bytes, first: DataFrame, second: DataFrame, third: DataFrame
) -> None:
    reader = decoder()
    reader.feed(garbage)
    received = reader.feed(encode(first)) + reader.feed(encode(second))
    # 1 in 256 of the things that look like a frame
    fooled = any(frame not in (first, second) for frame in received)
    assert second in received or fooled
    assert reader.feed(encode(third))[-1:] == [third] or fooled


@given(data_frames, st.integers(0, 8 * (PAYLOAD_BYTES + 3) - 1))
def test_a_flipped_bit_never_makes_another_data_frame(frame: DataFrame, bit: int) -> None:
    damaged = bytearray(encode(frame))
    damaged[bit // 8] ^= 1 << bit % 8
    reader = decoder()
    received = reader.feed(bytes(damaged))
    assert not any(isinstance(other, DataFrame) for other in received)
    if damaged[0] == 0xA5 and damaged[1]:
        assert reader.crc_errors >= 1


@given(data_frames, st.integers(0, PAYLOAD_BYTES + 2), st.integers(1, 255))
def test_a_burst_within_a_byte_is_detected(frame: DataFrame, place: int, change: int) -> None:
    damaged = bytearray(encode(frame))
    damaged[place] ^= change
    assert not any(isinstance(other, DataFrame) for other in decoder().feed(bytes(damaged)))


@given(data_frames)
def test_text_between_frames_is_kept(frame: DataFrame) -> None:
    reader = decoder()
    assert reader.feed(b"Traceback:\r\n" + encode(frame) + b"the end") == [frame]
    assert reader.text == "Traceback:\r\nthe end"
    reader.feed(b"x" * 100_000)
    assert len(reader.text) < 10_000


@given(st.integers(0, 2**32 - 1))
def test_hello(program_hash: int) -> None:
    assert parse_hello(hello_payload(program_hash))[1] == program_hash


def test_sizes_on_the_wire() -> None:
    sizes = {
        "run-away": WireFormat(RUN_AWAY),
        "spinning": WireFormat(SPINNING),
        "walker": WireFormat(WALKING),
    }
    up = {name: len(data_frame(1, bytes(wire.answer_bytes))) for name, wire in sizes.items()}
    assert up == {"run-away": 15, "spinning": 15, "walker": NOTIFICATION_BYTES}
    assert {name: wire.down_frame_bytes for name, wire in sizes.items()} == {
        "run-away": 5,
        "spinning": 7,
        "walker": 11,
    }
    assert all(wire.down_frame_bytes <= WRITE_BYTES for wire in sizes.values())


def _as_hub_reads(wire: WireFormat, values: tuple[float, ...]) -> tuple[float, ...]:
    """Actions as the hub decodes them."""
    numbers = struct.unpack(wire.action_format, wire.encode_actions(values))
    return tuple(number / RunAngle.scale for number in numbers)


@given(st.tuples(*[st.floats(-3276, 3276)] * 2))
def test_actions_keep_their_values(values: tuple[float, float]) -> None:
    wire = WireFormat(SPINNING)
    assert _as_hub_reads(wire, values) == pytest.approx(values, abs=0.0501)


@given(st.integers(0, 10**7), st.tuples(*[st.floats(-327, 327, width=32)] * 5))
def test_channels_keep_their_values(time_ms: int, values: tuple[float, ...]) -> None:
    wire = WireFormat(SPINNING)
    numbers = [
        round(value * channel.scale)
        for value, channel in zip(values, SPINNING.channels, strict=True)
    ]
    time, decoded = wire.decode_answer(struct.pack(wire.answer_format, time_ms & 0xFFFF, *numbers))
    assert time == time_ms % 65536
    assert decoded == pytest.approx(values, abs=0.051)


@given(st.integers(-(2**15), 2**15 - 1), st.sampled_from((1, 2, 10, 100, 1000)))
def test_channels_are_rounded_to_float32(number: int, scale: int) -> None:
    channel = SimpleNamespace(scale=scale, is_wide=lambda _robot: False)
    wire = WireFormat(SimpleNamespace(commands=(), channels=(channel,)))
    _, (value,) = wire.decode_answer(struct.pack("<Hh", 0, number))
    assert value == ctypes.c_float(number / scale).value


@given(st.floats(allow_nan=False))
def test_large_values_saturate(value: float) -> None:
    wire = WireFormat(SPINNING)
    decoded = _as_hub_reads(wire, (value, 0.0))[0]
    assert decoded == pytest.approx(min(max(value, -3276.8), 3276.7), abs=0.0501)


def test_nan_raises() -> None:
    wire = WireFormat(SPINNING)
    with pytest.raises(EncodingError, match="'right' is not a number"):
        wire.encode_actions([0.0, float("nan")])


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0, 3.0]])
def test_wrong_number_of_values_raises(values: list[float]) -> None:
    with pytest.raises(EncodingError, match="for 2 \\(left, right\\)"):
        WireFormat(SPINNING).encode_actions(values)


def wire_of(*are_wide: bool) -> WireFormat:
    """Format of channels that are called a, b, ...; each in tenths."""
    channels = [
        SimpleNamespace(name=name, scale=10, is_wide=lambda _robot, wide=wide: wide)
        for name, wide in zip("abcdef", are_wide, strict=False)
    ]
    return WireFormat(SimpleNamespace(commands=(), channels=channels))  # type: ignore[arg-type]


def test_channels_at_the_end_of_16_bits_are_named_unless_they_have_32() -> None:
    wire = wire_of(False, True, False, False, True)
    assert wire.answer_bytes == 2 + 2 + 4 + 2 + 2 + 4
    numbers = (-32768, 32767, 32766, 32767, -100_000)
    answer = struct.pack("<HhihhI", 61_000, *numbers[:4], numbers[4] & 0xFFFFFFFF)
    assert wire.saturated(answer) == ["a", "d"]
    assert wire.hub_time_ms(answer) == 61_000
    time_ms, values = wire.decode_answer(answer)
    assert time_ms == 61_000
    assert values == pytest.approx([number / 10 for number in numbers])
    assert wire.saturated(struct.pack("<Hhihhi", 0, -32767, 32767, 0, 32766, -32768)) == []


def test_most_actions_fit_one_write_and_one_buffer_of_the_hub() -> None:
    frame = data_frame(1, struct.pack(f"<{MAX_ACTIONS}h", *range(MAX_ACTIONS)))
    assert len(frame) <= WRITE_BYTES < len(frame) + 2
    # A buffer holds a count, a length and such a frame.
    assert 1 + 1 + WRITE_BYTES == APP_DATA_BYTES


@pytest.mark.parametrize("kind", Down)
def test_what_a_computer_sends_is_read_by_the_sizes_of_its_kinds(kind: Down) -> None:
    payload = bytes(range(DOWN_PAYLOAD_BYTES[kind]))
    reader = FrameDecoder(PAYLOAD_BYTES, DOWN_PAYLOAD_BYTES)
    after = data_frame(7, bytes(PAYLOAD_BYTES))
    assert reader.feed(control_frame(kind, payload) + after) == [
        ControlFrame(kind, payload),
        DataFrame(7, bytes(PAYLOAD_BYTES)),
    ]
    assert (reader.skipped_bytes, reader.crc_errors) == (0, 0)
