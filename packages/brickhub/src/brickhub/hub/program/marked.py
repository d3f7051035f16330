"""Marks of what several hubs print: each line begins with the name of its program."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

AnyText = str | bytes


class Marked:
    """Stream of text or of bytes whose lines begin with a mark.

    Args:
        out: binary or text stream; mark and line end are of its kind.
        mark: begins each line.
        line_end: ends each line.
    """

    def __init__(self, out: Any, mark: AnyText, line_end: AnyText) -> None:
        self._out = out
        self._mark: Any = mark
        self._line_end: Any = line_end
        self._pieces: list[Any] = []

    def write(self, data: Any, /) -> int:
        """Take output; a line is written when it has ended."""
        *ended, rest = data.split(self._line_end)
        for piece in ended:
            self._pieces.append(piece)
            self._write_line()
        if rest:
            self._pieces.append(rest)
        return len(data)

    def _write_line(self) -> None:
        for piece in (self._mark, *self._pieces, self._line_end):
            self._out.write(piece)
        self._pieces.clear()

    def flush(self) -> None:
        """Hand on what the stream keeps, but for a line that has not ended."""
        self._out.flush()

    def end(self) -> None:
        """Write a last line that has no end."""
        if self._pieces:
            self._write_line()
        self.flush()


def names_of(paths: Sequence[Path]) -> list[str]:
    """Short names of programs; those of one name get their number."""
    stems = [path.stem for path in paths]
    names = []
    for number, stem in enumerate(stems, 1):
        names.append(f"{stem} {number}" if stems.count(stem) > 1 else stem)
    return names
