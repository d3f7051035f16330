"""Beams and frames. Positions of holes from LDraw.org's part library."""

from __future__ import annotations

import numpy as np

from bricksrl.plans.catalogue.build import part, points_of, sites, tubes, webs
from bricksrl.plans.geometry import AXES, Triple, box, triple
from bricksrl.plans.part import Fit, MassSource, Part, Site

_Y = AXES["y"]
_STRAIGHT = {1: "18654", 2: "43857", 3: "32523", 5: "32316", 7: "32524", 9: "40490", 11: "32525", 13: "41239", 15: "32278"}
_OLD = {3: ("17141",), 5: ("41616", "151"), 7: ("16615",), 9: ("64289", "120"), 11: ("64290",), 13: ("64871",), 15: ("64872",)}
_KINDS = {"o": Fit.HOLE, "+": Fit.AXLE_HOLE}
_Chain = tuple[str, list[Triple]]
"""Kinds of holes (``o`` pin, ``+`` axle, ``-`` none) and their positions."""


def beams() -> list[Part]:
    """All beams and frames."""
    straight = [
        _beam(
            number,
            f"Beam {holes}",
            straight_beam_mass_g(holes),
            [("o" * holes, _run((0, 0, 10 - 10 * holes), (0, 20), holes))],
            aliases=_OLD.get(holes, ()),
            source=MassSource.RULE,
        )
        for holes, number in _STRAIGHT.items()
    ]
    return [*straight, *_bent(), *_thin(), *_frames(), *_panels()]


def straight_beam_mass_g(holes: int) -> float:
    """Mass of a thick beam; within 0.02 g of the volumes at LDraw.org from 2 holes on."""
    return round(0.2658 * holes - 0.103, 3)


def _run(start: Triple, step: tuple[float, float], count: int) -> list[Triple]:
    """Positions in the plane of a beam, ``step`` apart in x and z."""
    return [(start[0] + step[0] * i, 0.0, start[2] + step[1] * i) for i in range(count)]


def _beam(
    number: str,
    name: str,
    mass_g: float,
    chains: list[_Chain],
    *,
    thickness: float = 20.0,
    aliases: tuple[str, ...] = (),
    source: MassSource = MassSource.VOLUME,
) -> Part:
    """A beam with holes along chains; chains that meet share a hole."""
    sites_by_point: dict[Triple, Site] = {}
    for kinds, points in chains:
        for index, (kind, point) in enumerate(zip(kinds, points, strict=True)):
            if kind != "-":
                arm = np.array(point) - np.array(points[index - 1 if index else min(1, len(points) - 1)])
                arm /= max(float(np.linalg.norm(arm)), 1e-9)
                sites_by_point.setdefault(point, Site(_KINDS[kind], point, _Y, thickness, arm=triple(arm)))
    part_sites = tuple(sites_by_point.values())
    solids = (*webs([points for _, points in chains], _Y, thickness), *tubes(part_sites))
    return part(number, name, "beams", mass_g, part_sites, solids=solids, aliases=aliases, source=source)


def _bent() -> list[Part]:
    origin, up, slope = (0.0, 0.0, 0.0), (0.0, 20.0), (16.0, 12.0)  # 3-4-5: 53.13 degrees
    twice = [*_run((0, 0, -160), up, 7), (28.28, 0.0, -11.72), *_run((40, 0, 0), (20, 0), 3)]
    return [
        _beam("60483", "Beam 2 with an axle hole", 0.463, [("+o", _run(origin, up, 2))], aliases=("74695",)),
        _beam("32140", "Beam 2 x 4 bent 90", 1.241, [("+oooo", points_of("0,0,0 0,0,20 0,0,40 0,0,60 20,0,60"))]),
        _beam(
            "32526",
            "Beam 3 x 5 bent 90",
            1.732,
            [("ooooooo", [*_run(origin, up, 5), *_run((20, 0, 80), (20, 0), 2)])],
            aliases=("153",),
        ),
        _beam("32348", "Beam 4 x 4 bent 53", 1.830, [("+ooooo+", [*_run(origin, up, 4), *_run((16, 0, 72), slope, 3)])]),
        _beam("6629", "Beam 4 x 6 bent 53", 2.361, [("+ooooooo+", [*_run(origin, up, 6), *_run((16, 0, 112), slope, 3)])]),
        _beam(
            "32271",
            "Beam 3 x 7 bent 53",
            2.362,
            [("+ooooooo+", [*_run(origin, up, 7), *_run((16, 0, 132), slope, 2)])],
            aliases=("16616", "152"),
        ),
        _beam("32009", "Beam 3 x 4 x 7 bent twice 45", 2.999, [("+oooooo-oo+", twice)], aliases=("41486",)),
        _beam("43464", "Triangle 4 x 3", 1.621, [("+-+", _run((-20, 0, 0), (20, 0), 3)), ("-ooo", _run(origin, up, 4))]),
        part(
            "2391",
            "Beam 7, holes in turn",
            "beams",
            1.797,
            sites("o x20: 0,0,-40 0,0,0 0,0,40 | o y20: 0,0,-60 0,0,-20 0,0,20 0,0,60"),
            solids=(box((0.0, 0.0, 0.0), (20.0, 20.0, 138.0)),),
        ),
        part(
            "3167",
            "Beam 2 x 3 C",
            "beams",
            1.134,
            sites("o y20: -20,0,-20 -20,0,0 20,0,-20 20,0,0 | o z20: 0,0,0"),
            solids=(*(box((x, 0.0, -10.0), (18.0, 20.0, 38.0)) for x in (-20, 20)), box((0.0, 0.0, 0.0), (40.0, 20.0, 20.0))),
        ),
        _beam("60484", "Beam 3 x 3 T", 1.183, [("ooo", _run((-20, 0, 40), (20, 0), 3)), ("ooo", _run(origin, up, 3))]),
    ]


def _thin() -> list[Part]:
    up = (0.0, 20.0)
    rows = [
        ("41677", "Thin beam 2", 0.283, "++", 0.0),
        ("6632", "Thin beam 3", 0.370, "+o+", 0.0),
        ("32449", "Thin beam 4", 0.497, "+oo+", -30.0),
        ("32017", "Thin beam 5", 0.579, "ooooo", -40.0),
        ("11478", "Thin beam 5 with axle holes", 0.625, "+ooo+", -40.0),
        ("32063", "Thin beam 6", 0.706, "oooooo", -50.0),
        ("32065", "Thin beam 7", 0.833, "ooooooo", -60.0),
    ]
    straight = [
        _beam(number, name, mass, [(kinds, _run((0, 0, start), up, len(kinds)))], thickness=10)
        for number, name, mass, kinds, start in rows
    ]
    corner = [*_run((0, 0, 40), (0, -20), 3), *_run((20, 0, 0), (20, 0), 2)]
    ellipse = [*_run((0, 0, 80), (0, -20), 5), *_run((20, 0, 0), (20, 0), 2)]
    triangle = [("+ooo+", _run((-40, 0, 0), (20, 0), 5)), ("ooo", _run((0, 0, 0), (0, 20), 3))]
    others = [
        _beam("32250", "Thin beam 3 x 5 quarter ellipse", 1.247, [("+ooo+o+", ellipse)], thickness=10),
        _beam("2905", "Thin triangle 5 x 3", 0.900, triangle, thickness=10, aliases=("99773",)),
    ]
    bossed = sites("+ y10: 0,5,0 0,5,60 | o y10: 0,5,20 0,5,40 | pin y10: 0,-5,0")
    bar = (box((0.0, 5.0, 30.0), (18.0, 10.0, 78.0)), *tubes(bossed[-1:]))
    return [
        *straight,
        *others,
        _beam("32056", "Thin beam 3 x 3 bent 90", 0.638, [("+o+o+", corner)], thickness=10),
        part("2825", "Thin beam 4 with a boss", "beams", 0.503, bossed, solids=bar, aliases=("32006",)),
    ]


def _frames() -> list[Part]:
    return [
        _frame("64179", "Frame 5 x 7", 5, 7, 5.715, "yzzzy"),
        _frame("39794", "Frame 7 x 11", 7, 11, 9.182, "yzyzyzy"),
        _frame("39790", "Frame 11 x 15", 11, 15, 13.836, "yzyzyzyzyzy"),
        _long_frame(),
        _h_frame(),
    ]


def _frame(number: str, name: str, across: int, along: int, mass_g: float, ends: str) -> Part:
    """An open frame: holes along z alternate between vertical and sideways; along x they are ``ends``."""
    half_width, half_length = 10.0 * (across - 1), 10.0 * (along - 1)
    sites_by_point: dict[Triple, Site] = {}
    for side in (-1, 1):
        for index in range(along):
            point = (side * half_width, 0.0, 20.0 * index - half_length)
            sites_by_point[point] = Site(Fit.HOLE, point, _Y if index % 2 == 0 else AXES["x"], 20.0)
        for index, axis in enumerate(ends[1:-1], 1):
            point = (20.0 * index - half_width, 0.0, side * half_length)
            sites_by_point[point] = Site(Fit.HOLE, point, AXES[axis], 20.0)
    bars = [box((side * half_width, 0, 0), (20, 20, 2 * half_length + 20)) for side in (-1, 1)]
    bars += [box((0, 0, side * half_length), (2 * half_width, 20, 20)) for side in (-1, 1)]
    return part(number, name, "frames", mass_g, tuple(sites_by_point.values()), solids=tuple(bars))


def _long_frame() -> Part:
    part_sites = sites(
        "o x20: -40,0,-100 -40,0,-80 -40,0,-40 -40,0,0 -40,0,40 -40,0,80 -40,0,100"
        " 40,0,-100 40,0,-80 40,0,-40 40,0,0 40,0,40 40,0,80 40,0,100"
        "| o y20: -40,0,-60 -40,0,-20 -40,0,20 -40,0,60 40,0,-60 40,0,-20 40,0,20 40,0,60"
        "| o z20: -20,0,-60 0,0,-60 20,0,-60 -20,0,60 0,0,60 20,0,60"
    )
    bars = [box((x, 0, 0), (20, 20, 218)) for x in (-40, 40)] + [box((0, 0, z), (60, 20, 20)) for z in (-60, 60)]
    return part("64178", "Frame 5 x 11", "frames", 7.366, part_sites, solids=tuple(bars))


def _h_frame() -> Part:
    part_sites = sites("o x20: 0,0,-20 0,0,0 0,0,20 | o y20: -20,0,-40 -20,0,40 0,0,-40 0,0,40 20,0,-40 20,0,40")
    bars = (box((0, 0, -40), (58, 20, 18)), box((0, 0, 40), (58, 20, 18)), box((0, 0, 0), (18, 18, 62)))
    return part("14720", "Frame 3 x 5 H", "frames", 1.853, part_sites, solids=bars, aliases=("71710",))


def _panels() -> list[Part]:
    """The base plate, with vertical holes where its edge has no sideways hole, and panels."""
    points = []
    for column in range(11):
        for row in range(19):
            on_side, on_end = column in (0, 10), row in (0, 18)
            odd = (row if on_side else column) % 2 == 1
            if not ((on_side or on_end) and odd):
                points.append((20.0 * column - 100, 0.0, 20.0 * row - 180))
    part_sites = [Site(Fit.HOLE, point, _Y, 20.0) for point in points]
    part_sites += [Site(Fit.HOLE, (side * 100.0, 0.0, 40.0 * k - 160), AXES["x"], 20.0) for side in (-1, 1) for k in range(9)]
    part_sites += [Site(Fit.HOLE, (40.0 * k - 80, 0.0, side * 180.0), AXES["z"], 20.0) for side in (-1, 1) for k in range(5)]
    plate = (box((0, 0, 0), (220, 20, 380)),)
    return [
        part("39369", "Base plate 11 x 19", "frames", 57.891, tuple(part_sites), solids=plate),
        _panel("15458", 3, 5.946),
        _panel("64782", 5, 7.845),
    ]


def _panel(number: str, wide: int, mass_g: float) -> Part:
    """A panel of length 11: a sheet at -y, holes into the edges and through the corners."""
    edge = 10.0 * (wide - 1)
    ends = " ".join(f"{x},0,{20 * k - edge:g}" for x in (-101, 101) for k in range(wide))
    sides = " ".join(f"{x},0,{z:g}" for x in range(-60, 61, 20) for z in (-edge - 1, edge + 1))
    corners = " ".join(f"{x},0,{z:g}" for x in (-80, 80) for z in (-edge, edge))
    sheet = box((0.0, -8.0, 0.0), (216.0, 2.0, 2 * edge + 16))
    bars = [box((x, 0.0, 0.0), (18.0, 20.0, 2 * edge + 20)) for x in (-101, 101)]
    bars += [box((0.0, 0.0, z), (180.0, 20.0, 18.0)) for z in (-edge - 1, edge + 1)]
    part_sites = sites(f"o x18: {ends} | o z18: {sides} | o y20: {corners}")
    return part(number, f"Panel {wide} x 11", "frames", mass_g, part_sites, solids=(sheet, *bars))
