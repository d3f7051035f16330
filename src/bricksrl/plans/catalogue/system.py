"""Bricks, plates, tiles and Technic bricks. The origin is the middle of the top, x the longer side.

Each row is ``X x Z`` studs and the LDraw numbers, the catalogue's first.
"""

from __future__ import annotations

import math

from bricksrl.plans.catalogue.build import part, sites
from bricksrl.plans.geometry import box, cylinder
from bricksrl.plans.part import ABS_G_CM3, MassSource, Part

_BRICK, _PLATE = 24.0, 8.0
_BRICKS = (
    "1x1 3005 30071 35382 | 1x2 3004 93792 3065 | 1x3 3622 45505 | 1x4 3010 | 1x6 3009 | 1x8 3008 63322 | 2x2 3003 6223"
    "| 2x3 3002 | 2x4 3001 | 2x6 2456 44237 | 2x8 3007 93888"
)
_PLATES = (
    "1x1 3024 63326 30008 | 1x2 3023b 3023 3023a 6225 | 1x3 3623 101 | 1x4 3710 | 1x5 78329 | 1x6 3666 | 1x8 3460 | 1x10 4477"
    "| 1x12 60479 | 2x2 3022 94148 | 2x3 3021 | 2x4 3020 | 2x6 3795 | 2x8 3034 | 2x10 3832 | 2x12 2445 | 2x16 4282 | 4x4 3031"
    "| 4x6 3032 | 4x8 3035 | 4x10 3030 | 4x12 3029 | 6x6 3958 | 6x8 3036 | 6x10 3033 | 6x12 3028 | 6x16 3027 | 8x8 41539 42534"
)
_TILES = (
    "1x1 3070b 3070 | 1x2 3069b 3069 30070 63286 | 1x3 63864 | 1x4 2431 91143 2431b | 1x6 6636 63324 | 1x8 4162 "
    "| 2x2 3068b 3068 63327 | 2x4 87079 | 2x6 69729"
)
_TECHNIC_BRICKS = "2 3700 | 4 3701 | 6 3894 | 8 3702 | 10 2730 | 12 3895 | 14 32018 | 16 3703"
_TECHNIC_PLATES = "2x4 3709b 3709 | 2x6 32001 | 2x8 3738"


def system() -> list[Part]:
    """All System parts."""
    return [
        *_rows(_BRICKS, "Brick", "bricks", _BRICK),
        *_rows(_PLATES, "Plate", "plates", _PLATE),
        *_rows(_TILES, "Tile", "tiles", _PLATE, is_smooth=True),
        *_technic_bricks(),
        *_technic_plates(),
        *_round(),
    ]


def _rows(text: str, name: str, family: str, height: float, *, is_smooth: bool = False) -> list[Part]:
    parts = []
    for row in text.split("|"):
        size, *numbers = row.split()
        across, along = (int(side) for side in size.split("x"))
        label = f"{name} {across} x {along}"
        parts.append(_block(numbers, label, family, (along, across), height, is_smooth=is_smooth))
    return parts


def _block(
    numbers: list[str],
    name: str,
    family: str,
    size: tuple[int, int],
    height: float,
    *,
    holes: str = "",
    mass_g: float = 0.0,
    is_smooth: bool = False,
) -> Part:
    """A block of ``size`` studs along x and z; by default its mass is that of its shell."""
    cells = _cells(size)
    below = " ".join(f"{x:g},{height - 2:g},{z:g}" for x, z in cells)
    above = " ".join(f"{x:g},-2,{z:g}" for x, z in cells)
    part_sites = sites(f"under y4: {below}" + ("" if is_smooth else f" | stud y4: {above}") + (f" | {holes}" if holes else ""))
    body = (box((0.0, height / 2, 0.0), (20.0 * size[0], height, 20.0 * size[1])),)
    mass = mass_g or shell_mass_g(size, height, is_smooth=is_smooth)
    return part(numbers[0], name, family, mass, part_sites, solids=body, aliases=tuple(numbers[1:]), source=MassSource.RULE)


def _cells(size: tuple[int, int]) -> list[tuple[float, float]]:
    """Positions x, z of the studs."""
    return [(20.0 * i - 10 * (size[0] - 1), 20.0 * k - 10 * (size[1] - 1)) for i in range(size[0]) for k in range(size[1])]


def shell_mass_g(size: tuple[int, int], height: float, *, is_smooth: bool = False) -> float:
    """Mass of a block: top and walls of 4 LDU, studs, tubes or bars between the studs.

    Within 0.06 g of the volumes at LDraw.org. Real walls are thinner: a 2 x 4 brick is 13 % lighter.
    """
    length, width = 20.0 * size[0], 20.0 * size[1]
    walls = (length * width - (length - 8) * (width - 8)) * (height - 4)
    volume = 4 * length * width + walls
    if not is_smooth:
        is_row = 1 in size
        tube_area = (max(size) - 1) * math.pi * 16 if is_row else (size[0] - 1) * (size[1] - 1) * math.pi * 28
        volume += size[0] * size[1] * 4 * math.pi * 36 + tube_area * (height - 4)
    return round(volume * 0.04**3 * ABS_G_CM3, 3)


def _technic_bricks() -> list[Part]:
    """Bricks with pin holes between the studs; masses are a linear fit to the volumes at LDraw.org."""
    parts = []
    for row in _TECHNIC_BRICKS.split("|"):
        studs, number = row.split()
        count = int(studs)
        centres = " ".join(f"{20 * i - 10 * (count - 2)},10,0" for i in range(count - 1))
        mass = round(0.3447 * count + 0.1225, 3)
        parts.append(
            _block([number], f"Technic brick 1 x {count}", "bricks", (count, 1), _BRICK, holes=f"o z20: {centres}", mass_g=mass)
        )
    others = [
        (["6541", "404"], "Technic brick 1 x 1", 1, "o z20: 0,10,0", 0.449),
        (["32000", "602"], "Technic brick 1 x 2, two holes", 2, "o z20: -10,10,0 10,10,0", 0.782),
        (["32064a", "32064", "32064b", "32064c", "31493"], "Technic brick 1 x 2, axle hole", 2, "+ z20: 0,10,0", 0.836),
    ]
    return [
        *parts,
        *(
            _block(numbers, name, "bricks", (count, 1), _BRICK, holes=holes, mass_g=mass)
            for numbers, name, count, holes, mass in others
        ),
        _block(
            ["39789"],
            "Brick 2 x 4, three axle holes",
            "bricks",
            (4, 2),
            _BRICK,
            holes="+ y20: -20,10,0 0,10,0 20,10,0",
            mass_g=2.66,
        ),
    ]


def _technic_plates() -> list[Part]:
    """Plates of two rows with pin holes between the studs."""
    parts = []
    for row in _TECHNIC_PLATES.split("|"):
        size, *numbers = row.split()
        count = int(size[2:])
        centres = " ".join(f"{20 * i - 10 * (count - 2)},4,0" for i in range(count - 1))
        mass = round(0.311 * count + 0.075, 3)
        name = f"Technic plate 2 x {count}"
        parts.append(_block(numbers, name, "plates", (count, 2), _PLATE, holes=f"o y8: {centres}", mass_g=mass))
    return parts


def _round() -> list[Part]:
    """Round bricks and plates, as cylinders."""
    four = "-10,{0},-10 -10,{0},10 10,{0},-10 10,{0},10"
    rows: list[tuple[str, str, str, float, str, tuple[str, ...]]] = [
        ("6141", "Round plate 1 x 1", "plates", 0.120, "under y4: 0,6,0 | stud y4: 0,-2,0", ("4073", "15570", "30057", "51809")),
        ("3062b", "Round brick 1 x 1", "bricks", 0.306, "under y4: 0,22,0 | stud y4: 0,-2,0", ("3062", "18860", "30068")),
        ("4150", "Round tile 2 x 2", "tiles", 0.405, f"under y4: {four.format(6)}", ("14769", "14769p0e")),
        (
            "4032a",
            "Round plate 2 x 2, axle hole",
            "plates",
            0.516,
            f"under y4: {four.format(6)} | stud y4: {four.format(-2)} | + y8: 0,4,0",
            ("4032", "4032b"),
        ),
        (
            "3941",
            "Round brick 2 x 2, axle hole",
            "bricks",
            1.113,
            f"under y4: {four.format(22)} | stud y4: {four.format(-2)} | + y24: 0,12,0",
            ("6143", "6116"),
        ),
    ]
    return [_round_part(*row) for row in rows]


def _round_part(number: str, name: str, family: str, mass_g: float, text: str, aliases: tuple[str, ...]) -> Part:
    height, radius = (_BRICK if family == "bricks" else _PLATE), (10.0 if "1 x 1" in name else 20.0)
    body = (cylinder((0.0, height / 2, 0.0), "y", height, radius),)
    return part(number, name, family, mass_g, sites(text), solids=body, aliases=aliases)
