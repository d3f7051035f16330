"""Marks of what several hubs print."""

from __future__ import annotations

import io

from brickhub.hub.program.marked import Marked


class Counted(io.BytesIO):
    """A stream that counts how often it hands on what it keeps."""

    flushes = 0

    def flush(self) -> None:
        self.flushes += 1
        super().flush()


def test_lines_are_whole_and_handed_on_when_asked() -> None:
    out = Counted()
    left, right = Marked(out, b"left: ", b"\r\n"), Marked(out, b"right: ", b"\r\n")
    left.write(b"begins, ")
    right.write(b"one\r\ntwo\r\n")
    before = out.flushes
    right.flush()
    assert out.flushes == before + 1
    left.write(b"ends\r\n")
    left.write(b"no end")
    left.end()
    assert out.getvalue() == b"right: one\r\nright: two\r\nleft: begins, ends\r\nleft: no end\r\n"
