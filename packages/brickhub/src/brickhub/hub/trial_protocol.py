"""Protocol of trials, between a host and a hub that makes them by itself: frames as pure functions.

A trial is asked for by data frames, each with the trial's number as ``seq``: steps (u8), index of
the piece (u8), and up to seven numbers (int16, -32767..32767 for the whole range). The hub answers
with a data frame before each step and after the last one, as in `protocol`: its clock and the
channels. It ends with a control frame ``E``: the trial's number (u8) and how many observations
there were (u16), so that the host knows of one that was lost.

All frames may be repeated: a trial is made once, and its end is told again.
"""

import struct
from collections.abc import Sequence

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub import protocol
from brickhub.hub.interface import Interface
from brickhub.robot import Robot

TRIAL_END = ord("E")
"""Kind of the control frame from the hub that ends a trial."""
UP_PAYLOAD_BYTES = {**protocol.UP_PAYLOAD_BYTES, TRIAL_END: 3}
SHARE_MAX = 2**15 - 1
"""Half of a number's range, on the wire."""
MOST_STEPS = 255
MOST_NUMBERS = 64
_NUMBERS_PER_PIECE = 7
"""Two bytes each: with steps, index and the frame's own bytes 19, and every hub takes 20."""


class TrialWire:
    """Format of the frames of trials.

    Args:
        numbers: the numbers ``[p]`` of a trial, with their ranges.

    Attributes:
        answers: format of the observations.
        pieces: frames that carry the numbers of a trial; ``piece_format`` is the ``struct`` format
            of the numbers of one.

    Raises DescriptionError if there are no numbers or too many.
    """

    def __init__(
        self,
        interface: Interface,
        robot: Robot,
        numbers: Sequence[Entry],
    ) -> None:
        if not 1 <= len(numbers) <= MOST_NUMBERS:
            raise DescriptionError(f"a trial has {len(numbers)} numbers; give 1 to {MOST_NUMBERS}")
        self.answers = protocol.WireFormat(interface, robot)
        self.answer_format = self.answers.answer_format
        self.numbers = tuple(numbers)
        self._per_piece = min(len(numbers), _NUMBERS_PER_PIECE)
        self.pieces = -(-len(numbers) // self._per_piece)
        self.piece_format = "<" + "h" * self._per_piece
        payload_bytes = 2 + struct.calcsize(self.piece_format)
        self.down_frame_bytes = protocol.DATA_OVERHEAD + payload_bytes

    def request(
        self,
        seq: int,
        numbers: Sequence[float],
        steps: int,
    ) -> list[bytes]:
        """Frames that ask for a trial of so many steps by numbers ``[p]`` in their units.

        Raises EncodingError for a wrong number of either, and for a number out of its range.
        """
        if not 1 <= steps <= MOST_STEPS:
            raise protocol.EncodingError(f"a trial of {steps} steps; give 1 to {MOST_STEPS}")
        if len(numbers) != len(self.numbers):
            raise protocol.EncodingError(
                f"got {len(numbers)} numbers for a trial; give {len(self.numbers)}"
            )
        shares: list[int] = []
        for number, entry in zip(numbers, self.numbers, strict=True):
            # Written so that a NaN is refused too.
            if not entry.low <= number <= entry.high:
                raise protocol.EncodingError(
                    f"'{entry.name}' is {number}; give {entry.low:g} to {entry.high:g}"
                )
            share = 2.0 * (number - entry.low) / (entry.high - entry.low) - 1.0
            shares.append(round(SHARE_MAX * share))
        # The last piece is as long as the others.
        shares += [0] * (self.pieces * self._per_piece - len(shares))
        frames: list[bytes] = []
        for piece in range(self.pieces):
            start = piece * self._per_piece
            packed = struct.pack(self.piece_format, *shares[start : start + self._per_piece])
            frames.append(protocol.data_frame(seq, bytes((steps, piece)) + packed))
        return frames

    def decoder(self) -> protocol.FrameDecoder:
        """Decoder of what the hub sends."""
        return protocol.FrameDecoder(self.answers.answer_bytes, UP_PAYLOAD_BYTES)


class TrialRecord:
    """What has come of one trial.

    Attributes:
        seq: the trial's number.
        answers: payloads of its observations, in the order of their coming.
        count: how many observations there were, or ``None`` before the trial's end.
    """

    def __init__(self, seq: int) -> None:
        self.seq = seq
        self.answers: list[bytes] = []
        self.count: int | None = None

    def take(self, frame: protocol.Frame) -> bool:
        """Take a frame from the hub. Returns whether it is of this trial."""
        if isinstance(frame, protocol.DataFrame):
            is_of_this = frame.seq == self.seq and self.count is None
            if is_of_this:
                self.answers.append(frame.payload)
            return is_of_this
        if frame.kind != TRIAL_END:
            return False
        seq, count = struct.unpack("<BH", frame.payload)
        if seq == self.seq:
            self.count = count
        return bool(seq == self.seq)

    @property
    def is_over(self) -> bool:
        """Whether the trial has ended, and the motors stand."""
        return self.count is not None

    @property
    def is_whole(self) -> bool:
        """Whether the trial has ended, and no observation of it was lost."""
        return self.count == len(self.answers)
