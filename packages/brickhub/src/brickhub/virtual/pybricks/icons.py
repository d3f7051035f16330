"""Icons of a 5x5 light matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from brickhub.virtual.pybricks.context import get_int
from brickhub.virtual.pybricks.matrix import Matrix

_ROWS = {
    "UP": (4, 14, 31, 14, 14),
    "DOWN": (14, 14, 31, 14, 4),
    "LEFT": (4, 15, 31, 15, 4),
    "RIGHT": (4, 30, 31, 30, 4),
    "ARROW_RIGHT_UP": (7, 3, 5, 8, 16),
    "ARROW_RIGHT_DOWN": (16, 8, 5, 3, 7),
    "ARROW_LEFT_UP": (28, 24, 20, 2, 1),
    "ARROW_LEFT_DOWN": (1, 2, 20, 24, 28),
    "ARROW_UP": (4, 14, 21, 4, 4),
    "ARROW_DOWN": (4, 4, 21, 14, 4),
    "ARROW_LEFT": (4, 8, 31, 8, 4),
    "ARROW_RIGHT": (4, 2, 31, 2, 4),
    "HAPPY": (27, 27, 0, 17, 14),
    "SAD": (27, 27, 0, 14, 17),
    "EYE_LEFT": (0, 0, 24, 24, 0),
    "EYE_RIGHT": (0, 0, 3, 3, 0),
    "EYE_LEFT_BLINK": (0, 0, 0, 24, 0),
    "EYE_RIGHT_BLINK": (0, 0, 0, 3, 0),
    "EYE_RIGHT_BROW": (0, 3, 0, 0, 0),
    "EYE_LEFT_BROW": (0, 24, 0, 0, 0),
    "EYE_LEFT_BROW_UP": (24, 0, 0, 0, 0),
    "EYE_RIGHT_BROW_UP": (3, 0, 0, 0, 0),
    "HEART": (10, 31, 31, 14, 4),
    "PAUSE": (0, 10, 10, 10, 0),
    "EMPTY": (0, 0, 0, 0, 0),
    "FULL": (31, 31, 31, 31, 31),
    "SQUARE": (0, 14, 14, 14, 0),
    "TRIANGLE_RIGHT": (8, 12, 14, 12, 8),
    "TRIANGLE_LEFT": (2, 6, 14, 6, 2),
    "TRIANGLE_UP": (0, 4, 14, 31, 0),
    "TRIANGLE_DOWN": (0, 31, 14, 4, 0),
    "CIRCLE": (14, 31, 31, 31, 14),
    "CLOCKWISE": (30, 18, 18, 23, 2),
    "COUNTERCLOCKWISE": (15, 9, 9, 29, 8),
    "TRUE": (1, 2, 20, 8, 0),
    "FALSE": (17, 10, 4, 10, 17),
}


class Icon:
    """Named icons, and pictures from the bits of numbers, 100 for set bits."""

    def __call__(self, *bits: Any) -> Any:
        if len(bits) != 1:
            raise ValueError("Invalid argument")
        return _picture([get_int(bits[0]) >> shift for shift in (20, 15, 10, 5, 0)])

    def __getattr__(self, name: str) -> Any:
        if name not in _ROWS:
            raise AttributeError(f"'Icon' object has no attribute '{name}'")
        return _picture(_ROWS[name])


def _picture(rows: Sequence[int]) -> Any:
    return Matrix([[100 if row >> bit & 1 else 0 for bit in (4, 3, 2, 1, 0)] for row in rows])
