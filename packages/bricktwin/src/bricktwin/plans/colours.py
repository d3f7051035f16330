"""LDraw colours: names, RGB values and numbers in shops."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from brickhub.tables import read_table

_DIRECT = 0x2000000


@dataclass(frozen=True)
class Colour:
    """A colour.

    Attributes:
        rgb: components 0..1.
        bricklink: BrickLink's number, 0 if unknown.
    """

    code: int
    name: str
    rgb: tuple[float, float, float]
    bricklink: int

    @property
    def rebrickable(self) -> int:
        """Rebrickable's number: LDraw's, or that of any colour for a direct colour of LDraw."""
        return self.code if self.code < _DIRECT else 9999


@functools.cache
def _known() -> dict[int, Colour]:
    rows = read_table("bricktwin.plans.catalogue", "colours")
    return {int(row["code"]): Colour(int(row["code"]), row["name"], _rgb(row["rgb"]), int(row["bricklink"])) for row in rows}


def code_of(word: str) -> int:
    """Code of a colour in a line of an LDraw file: hexadecimal after 0x, else decimal, also with leading zeros. Raises ValueError
    if it is no number."""
    return int(word, 16 if word.lower().startswith("0x") else 10)


def colour_of(code: int) -> Colour:
    """The colour of a code; grey if unknown."""
    if code >= _DIRECT:
        value = f"{code & 0xFFFFFF:06x}"
        return Colour(code, f"#{value}", _rgb(value), 0)
    return _known().get(code) or Colour(code, f"colour {code}", _rgb("808080"), 0)


def _rgb(value: str) -> tuple[float, float, float]:
    red, green, blue = bytes.fromhex(value)
    return red / 255, green / 255, blue / 255
