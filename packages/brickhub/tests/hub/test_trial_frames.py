"""Frames of trials, byte by byte, and what comes of them."""

from __future__ import annotations

import math
import struct

import pytest
from described import SPINNING, TWO_WHEELER

from brickhub.entry import Entry
from brickhub.hub.protocol import ControlFrame, DataFrame, EncodingError, crc8, data_frame
from brickhub.hub.trial_protocol import TrialRecord, TrialWire


def wire_of(count: int) -> TrialWire:
    """A wire for numbers from 0 to 10."""
    return TrialWire(SPINNING, TWO_WHEELER, [Entry(f"n{i}", 0.0, 10.0) for i in range(count)])


@pytest.mark.parametrize(
    ("count", "pieces", "per_piece"), [(1, 1, 1), (6, 1, 6), (7, 1, 7), (8, 2, 7), (15, 3, 7)]
)
def test_seven_numbers_fit_a_piece(count: int, pieces: int, per_piece: int) -> None:
    wire = wire_of(count)
    assert (wire.pieces, wire.piece_format) == (pieces, "<" + "h" * per_piece)
    assert wire.down_frame_bytes == 3 + 2 + 2 * per_piece
    frames = wire.request(9, [5.0] * count, 20)
    assert [len(frame) for frame in frames] == [wire.down_frame_bytes] * pieces
    assert all(len(frame) <= 19 for frame in frames)


def test_request_carries_steps_pieces_and_shares() -> None:
    wire = wire_of(8)
    numbers = (0.0, 10.0, 5.0, 7.5, 2.5, 10.0, 0.0, 10.0)
    first, second = wire.request(9, numbers, 20)
    shares = (-32767, 32767, 0, 16384, -16384, 32767, -32767)
    assert first == data_frame(9, bytes((20, 0)) + struct.pack("<7h", *shares))
    # The last piece is filled with zeros.
    assert second == data_frame(9, bytes((20, 1)) + struct.pack("<7h", 32767, *[0] * 6))


@pytest.mark.parametrize(
    ("numbers", "steps", "message"),
    [
        ((1.0, 2.0), 0, "a trial of 0 steps; give 1 to 255"),
        ((1.0, 2.0), 256, "a trial of 256 steps; give 1 to 255"),
        ((1.0,), 5, "got 1 numbers for a trial; give 2"),
        ((1.0, 2.0, 3.0), 5, "got 3 numbers for a trial; give 2"),
        ((1.0, 10.1), 5, "'n1' is 10.1; give 0 to 10"),
        ((-0.1, 1.0), 5, "'n0' is -0.1; give 0 to 10"),
        ((math.nan, 1.0), 5, "'n0' is nan; give 0 to 10"),
    ],
)
def test_request_that_cannot_be_made(numbers: tuple[float, ...], steps: int, message: str) -> None:
    with pytest.raises(EncodingError, match=f"^{message}$"):
        wire_of(2).request(1, numbers, steps)


def end(seq: int, count: int) -> ControlFrame:
    return ControlFrame(ord("E"), struct.pack("<BH", seq, count))


def test_record_of_a_trial() -> None:
    record = TrialRecord(7)
    assert (record.is_over, record.is_whole, record.count) == (False, False, None)
    assert record.take(DataFrame(7, b"a"))
    # Those of other trials, and other words of the hub, are not of this one.
    assert not record.take(DataFrame(6, b"x"))
    assert not record.take(ControlFrame(ord("H"), b"12345"))
    assert not record.take(end(6, 1))
    assert not record.is_over
    assert record.take(DataFrame(7, b"b"))
    assert record.answers == [b"a", b"b"]
    assert record.take(end(7, 300))
    assert (record.is_over, record.count, record.is_whole) == (True, 300, False)
    # What comes after the end is a repetition of an earlier frame.
    assert not record.take(DataFrame(7, b"c"))
    assert record.answers == [b"a", b"b"]
    assert record.take(end(7, 2))
    assert record.is_whole


def test_decoder_reads_answers_and_ends() -> None:
    wire = wire_of(2)
    size = wire.answers.answer_bytes
    answer = data_frame(3, bytes(range(size)))
    head = bytes((0xA5, 0, ord("E"), 3, 1, 0))
    found = wire.decoder().feed(answer + head + bytes((crc8(head),)))
    assert found == [DataFrame(3, bytes(range(size))), end(3, 1)]
    assert wire.answer_format == wire.answers.answer_format
