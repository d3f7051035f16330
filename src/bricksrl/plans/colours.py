"""LDraw colours: names, RGB values and numbers in shops."""

from __future__ import annotations

from dataclasses import dataclass

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


_TABLE = {
    0: ("black", "1b2a34", 11),
    1: ("blue", "1e5aa8", 7),
    2: ("green", "00852b", 6),
    3: ("dark turquoise", "069d9f", 39),
    4: ("red", "b40000", 5),
    5: ("dark pink", "d3359d", 47),
    7: ("light grey", "8a928d", 9),
    8: ("dark grey", "545955", 10),
    10: ("bright green", "58ab41", 36),
    14: ("yellow", "fac80a", 3),
    15: ("white", "f4f4f4", 1),
    19: ("tan", "d7ba8c", 2),
    22: ("purple", "671f81", 24),
    25: ("orange", "d67923", 4),
    26: ("magenta", "901f76", 71),
    27: ("lime", "a5ca18", 34),
    28: ("dark tan", "897d62", 69),
    70: ("reddish brown", "5f3109", 88),
    71: ("light bluish grey", "969696", 86),
    72: ("dark bluish grey", "646464", 85),
    73: ("medium blue", "7396c8", 42),
    191: ("bright light orange", "fcac00", 110),
    226: ("bright light yellow", "ffec6c", 103),
    272: ("dark blue", "19325a", 63),
    288: ("dark green", "00451a", 80),
    320: ("dark red", "720012", 59),
    321: ("dark azure", "469bc3", 153),
    322: ("medium azure", "68c3e2", 156),
    323: ("light aqua", "d3f2ea", 152),
    330: ("olive green", "77774e", 155),
    484: ("dark orange", "91501c", 68),
    494: ("electric contact", "d0d0d0", 0),
}


def colour_of(code: int) -> Colour:
    """The colour of a code; grey if unknown."""
    if code >= _DIRECT:
        return Colour(code, f"#{code & 0xFFFFFF:06x}", _rgb(f"{code & 0xFFFFFF:06x}"), 0)
    name, value, bricklink = _TABLE.get(code, (f"colour {code}", "808080", 0))
    return Colour(code, name, _rgb(value), bricklink)


def _rgb(value: str) -> tuple[float, float, float]:
    red, green, blue = bytes.fromhex(value)
    return red / 255, green / 255, blue / 255
