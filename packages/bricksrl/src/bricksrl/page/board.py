"""Board: the latest state of everything on the page, written by the program and read by each
browser's connection.

A write is an assignment or an append, so that it does not delay the thread that steps the robot;
readers do the encoding. Every thread may write and read.
"""

import json
import math
import struct
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bricktwin.view.drawing_of_body import Drawing, Floats

MAX_STEPS = 400
"""Maximum number of values of steps that are kept, for browsers that connect later."""
MAX_EPISODES = 4000
"""The same of values of episodes."""
Poses = Floats | Callable[[], Floats]
"""Poses ``[bodies, 7]``, or a function that computes them on demand, in the thread that serves the
page."""
# Kinds of a binary message, its first byte.
POSES = 1
IMAGE = 2


@dataclass
class Series:
    """Series of rows of numbers, of which the last ones are kept.

    Attributes:
        names: names of the columns.
        max_rows: number of rows to keep.
        count: number of rows since the start, including dropped ones.
    """

    names: tuple[str, ...]
    max_rows: int = MAX_STEPS
    count: int = 0

    def __post_init__(self) -> None:
        self.rows: deque[Sequence[float]] = deque(maxlen=self.max_rows)

    def add(self, row: Sequence[float]) -> None:
        """Append a row."""
        self.rows.append(row)
        self.count += 1

    def since(self, count: int) -> tuple[int, list[Sequence[float]]]:
        """The kept rows from number ``count`` on, and the number of the first of them."""
        end = self.count
        rows = list(self.rows)
        missing = min(max(0, end - count), len(rows))
        return end - missing, rows[len(rows) - missing :]


class Board:
    """State of the page. Each part has a version, which is incremented when the part changes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.drawing: tuple[int, Drawing | None] = (0, None)
        self.poses: tuple[int, Poses | None] = (0, None)
        self.image: tuple[int, NDArray[np.uint8] | None] = (0, None)
        self.status: tuple[int, dict[str, Any]] = (0, {})
        self.series: dict[str, Series] = {}

    def show_drawing(
        self,
        drawing: Drawing,
        poses: Poses,
    ) -> None:
        """Show another drawing, with its bodies in these poses."""
        self.drawing = (self.drawing[0] + 1, drawing)
        self.show_poses(poses)

    def show_poses(self, poses: Poses) -> None:
        """Move the bodies of the drawing."""
        self.poses = (self.poses[0] + 1, poses)

    def show_image(self, image: NDArray[np.uint8]) -> None:
        """Show a camera image ``[height, width, 3]``."""
        self.image = (self.image[0] + 1, image)

    def update_status(self, **parts: Any) -> None:
        """Update parts of the status: plain values by name."""
        # Two threads may update different parts at once, and neither may undo the other's.
        with self._lock:
            version, status = self.status
            updated = {**status, **parts}
            if updated != status:
                self.status = (version + 1, updated)

    def new_series(
        self,
        name: str,
        columns: Sequence[str],
        *,
        max_rows: int = MAX_STEPS,
    ) -> Series:
        """Add a series to plot; one of the same name is replaced."""
        series = Series(tuple(columns), max_rows)
        self.series = {**self.series, name: series}
        return series


class BoardReader:
    """Reader of a board's changes for one browser. ``board``: the board to read."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._drawing = self._poses = self._image = self._status = -1
        self._series: dict[str, tuple[int, int]] = {}

    def changes(self, *, numbers: bool) -> list[bytes | dict[str, Any]]:
        """Messages with the changes since the last call, in order; ``numbers`` includes image,
        status and series."""
        board = self._board
        messages = list[bytes | dict[str, Any]]()
        version, _ = board.drawing
        if version != self._drawing and version:
            self._drawing = version
            # Poses belong to a drawing: those of the new one follow it at once.
            self._poses = -1
            messages.append({"drawing": version})
        version, poses = board.poses
        if poses is not None and version != self._poses:
            self._poses = version
            array = poses() if callable(poses) else poses
            # Four bytes, as a browser reads float32 at multiples of four alone.
            header = struct.pack("<4B", POSES, 0, 0, 0)
            messages.append(header + np.ascontiguousarray(array, "<f4").tobytes())
        if not numbers:
            return messages
        version, image = board.image
        if image is not None and version != self._image:
            self._image = version
            height, width, _ = image.shape
            header = struct.pack("<BxHHxx", IMAGE, height, width)
            messages.append(header + np.ascontiguousarray(image).tobytes())
        version, status = board.status
        if version != self._status:
            self._status = version
            messages.append({"status": status})
        changed = {}
        for name, series in board.series.items():
            rows = self._rows(name, series)
            if rows is not None:
                changed[name] = rows
        if changed:
            messages.append({"series": changed})
        return messages

    def _rows(
        self,
        name: str,
        series: Series,
    ) -> dict[str, Any] | None:
        series_id, count = self._series.get(name, (0, -1))
        # A series may have been replaced by another one of the same name.
        if series_id != id(series):
            count = -1
        if count == series.count:
            return None
        first, rows = series.since(max(count, 0))
        self._series[name] = (id(series), first + len(rows))
        changes: dict[str, Any] = {
            "first": first,
            "rows": [[round(float(value), 4) for value in row] for row in rows],
        }
        # The first message says what the columns are.
        if count < 0:
            changes |= {"names": series.names, "kept": series.max_rows}
        return changes


def to_json(message: dict[str, Any]) -> str:
    """A message as JSON, with ``null`` for numbers that JSON lacks, such as a reward that is
    NaN."""

    def finite(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: finite(item) for name, item in value.items()}
        if isinstance(value, list | tuple):
            return [finite(item) for item in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps(finite(message))
