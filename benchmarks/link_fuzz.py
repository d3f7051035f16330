"""Fuzzing of the frame decoders: for any bytes, only our exceptions, and resynchronisation within
two frames.

    python -m benchmarks link_fuzz --seconds 600

Every decoded stream is compared with what was sent. A checksum of 8 bits misses some damage: of
streams damaged in several places, about one frame in 256 candidates passes; these are counted. It
always detects one flipped bit, and a burst within a byte.
"""

from __future__ import annotations

import random
import time
from collections import Counter

from benchmarks.session import Session
from brickhub.hub.protocol import (
    UP_PAYLOAD_BYTES,
    DataFrame,
    FrameDecoder,
    Up,
    control_frame,
    data_frame,
    hello_payload,
)
from brickhub.hub.transports.cobs import Framer, decode_cobs, encode_cobs
from brickhub.hub.transports.profile import (
    parse_capabilities,
    parse_event,
    parse_hub_kind,
    parse_version,
)
from bricksrl.errors import HubProtocolError

PAYLOAD_BYTES = 16


def frames(rng: random.Random, count: int) -> list[bytes]:
    """Frames as a hub sends them."""
    result = []
    for _ in range(count):
        if rng.random() < 0.1:
            result.append(control_frame(Up.HELLO, hello_payload(rng.getrandbits(32))))
        else:
            result.append(data_frame(rng.randint(1, 255), rng.randbytes(PAYLOAD_BYTES)))
    return result


def damage(rng: random.Random, stream: bytes) -> bytes:
    """A stream with bytes lost, added, flipped, repeated or swapped."""
    data = bytearray(stream)
    for _ in range(rng.randint(1, 5)):
        start, size = rng.randrange(len(data) + 1), rng.randint(1, 30)
        damage_type = rng.randrange(5)
        if damage_type == 0:
            del data[start : start + size]
        elif damage_type == 1:
            data[start:start] = rng.choices((0xA5, 0, 1, 72, rng.randrange(256)), k=size)
        elif damage_type == 2 and start < len(data):
            data[start] ^= 1 << rng.randrange(8)
        elif damage_type == 3:
            data[start:start] = data[start : start + size]
        else:
            data[start : start + size] = data[start : start + size][::-1]
    return bytes(data)


def pieces(rng: random.Random, stream: bytes) -> list[bytes]:
    """The stream, split into notifications."""
    cuts = sorted(rng.randrange(len(stream) + 1) for _ in range(rng.randint(0, 12)))
    return [stream[start:end] for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)]


def fuzz_frames(rng: random.Random, counts: Counter[str]) -> None:
    """Fuzz our frames: after the damage they are received from the second one on."""
    decoder = FrameDecoder(PAYLOAD_BYTES, UP_PAYLOAD_BYTES)
    sent = frames(rng, rng.randint(1, 8))
    received = [
        frame for piece in pieces(rng, damage(rng, b"".join(sent))) for frame in decoder.feed(piece)
    ]
    known = {frame[2:-1] for frame in sent if frame[1]}
    counts["frames heard"] += len(received)
    counts["damage that the checksum cannot see"] += sum(
        isinstance(f, DataFrame) and f.payload not in known for f in received
    )
    after = [
        data_frame(1, bytes(PAYLOAD_BYTES)),
        data_frame(2, rng.randbytes(PAYLOAD_BYTES)),
        data_frame(3, bytes(PAYLOAD_BYTES)),
    ]
    received_after = [frame for data in after for frame in decoder.feed(data)]
    expected = DataFrame(2, after[1][2:-1])
    undetected = any(
        isinstance(f, DataFrame) and data_frame(f.seq, f.payload) not in after
        for f in received_after
    )
    assert expected in received_after or undetected, "not back in step with the second frame"
    counts["fooled on the way back"] += undetected
    flipped = bytearray(after[1])
    flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    lone = FrameDecoder(PAYLOAD_BYTES, UP_PAYLOAD_BYTES).feed(bytes(flipped))
    assert not any(isinstance(frame, DataFrame) for frame in lone), "one flipped bit was not seen"


def fuzz_cobs(rng: random.Random, counts: Counter[str]) -> None:
    """Fuzz frames over USB."""
    framer = Framer()
    messages = [rng.randbytes(rng.randint(1, 200)) for _ in range(4)]
    for piece in pieces(rng, damage(rng, b"".join(map(encode_cobs, messages)))):
        framer.feed(piece)
    last = [rng.randbytes(20), rng.randbytes(20)]
    received = [message for frame in map(encode_cobs, last) for message in framer.feed(frame)]
    assert received[-1] == last[1], "not back in step with the second frame"
    counts["frames over USB that were damaged"] += framer.damaged


def fuzz_profile(rng: random.Random, counts: Counter[str]) -> None:
    """Fuzz the parsers of a hub's properties."""
    for parse in (parse_event, parse_capabilities, parse_version, parse_hub_kind, decode_cobs):
        try:
            parse(rng.randbytes(rng.randint(0, 40)))
        except HubProtocolError:
            counts["refused with our error"] += 1


def main(session: Session) -> None:
    """Fuzz for some time."""
    args = session.parse(seconds=60.0, seed=0)
    rng, counts = random.Random(args.seed), Counter[str]()
    end_s = time.monotonic() + args.seconds
    while time.monotonic() < end_s:
        for _ in range(100):
            for fuzz in (fuzz_frames, fuzz_cobs, fuzz_profile):
                fuzz(rng, counts)
            counts["streams"] += 2
    print(dict(counts))
    session.write(
        {"seed": args.seed, "seconds": args.seconds, "counts": dict(sorted(counts.items()))}
    )
