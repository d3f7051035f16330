"""Notation of ``parts.csv`` and ``devices.csv``: points, connection sites, solids, gears. LDraw
units, the part's frame.

Points are words ``x,y,z``. A coordinate is a number, ``±40`` (-40 and 40), ``0..60`` (each module
of 20), ``0..80/40`` (each 40), or several of these with ``;``; the last coordinate runs fastest.
Groups are separated by ``|``:

- sites: kind, axis with length, centres, as in ``o y20: 0,0,±20``. Kinds: ``o`` pin hole, ``+``
  axle hole, and those of `_FITS`. ``z20 tilted 45`` turns a group about x by 45 degrees, ``y10
  turned 120`` about z by 120.
- beams: an axis with the thickness, a hole for each point (``-`` for none), and the points that
  bars connect, as in ``chain y20 +oo: 0,0,0..40``.
- solids: ``box 0,0,±60 80,20,20``, ``cylinder z20 0,0,0 9.5``, ``ring y15 0,0,0 74.5 68`` (outer
  and inner radius), ``ball 0,0,0 24``, or ``tubes`` around all sites. ``notch box 0,20,±30
  60,20,20`` is cut out of the solids before it.
- gears: form, teeth, axis with width, centre and further fields, as in ``bevel 12 z10 0,0,2
  set_back=0``.
"""

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from bricktwin.plans.geometry import AXES, Solid, Triple, ball, bar, box, cylinder, ring, triple
from bricktwin.plans.part import Fit, Gear, GearForm, Site

_FITS = {
    "o": Fit.HOLE,
    "+": Fit.AXLE_HOLE,
    "pin": Fit.PIN,
    "friction": Fit.FRICTION_PIN,
    "axle": Fit.AXLE,
    "turntable": Fit.TURNTABLE,
    "stud": Fit.STUD,
    "under": Fit.STUD_HOLE,
    "peg": Fit.PEG,
    "ball": Fit.BALL,
    "socket": Fit.SOCKET,
    "rim": Fit.RIM,
    "tyre": Fit.TYRE,
}
_WITHOUT_SOLIDS = (Fit.TURNTABLE, Fit.STUD, Fit.STUD_HOLE, Fit.BALL, Fit.SOCKET, Fit.RIM, Fit.TYRE)
"""Kinds of sites without solids. Collisions ignore studs, sockets and the hollows for them, and the
head of a towball is added to its part."""
_NOTCH = "notch "
_MODULE = 20.0
"""Distance between holes, LDU."""
_WALL_RADIUS = 9.0
"""Outer radius of the tube around a hole, LDU."""
_PIN_RADIUS = 6.0
"""Radius of a pin or an axle, LDU."""


def points(text: str) -> list[Triple]:
    """Points of a text such as ``"0,0,-20 ±40,0,0..60"``."""
    found: list[Triple] = []
    for word in text.split():
        # A coordinate may list several values. A word then stands for all of their combinations.
        values = [_coordinates(coordinate) for coordinate in word.split(",")]
        found += [(x, y, z) for x, y, z in itertools.product(*values)]
    return found


def point(text: str) -> Triple:
    """A single point."""
    return points(text)[0]


def _coordinates(text: str) -> list[float]:
    """The values that a coordinate stands for, in order."""
    values: list[float] = []
    for word in text.split(";"):
        ends, _, step = word.partition("/")
        first, _, last = ends.partition("..")
        if last:
            values += _range(float(first), float(last), float(step or _MODULE))
        elif first.startswith("±"):
            size = float(first[1:])
            values += [-size, size]
        else:
            values.append(float(first))
    return values


def _range(
    first: float,
    last: float,
    step: float,
) -> list[float]:
    """Values from the first one to the last one, both included."""
    span = last - first
    # A range may run downwards, as from 60 to 0, because its order is the order of the holes in a
    # beam.
    stride = math.copysign(step, span)
    count = round(span / stride) + 1
    return [first + stride * index for index in range(count)]


def sites(text: str, *, turns: bool = False) -> tuple[Site, ...]:
    """Connection sites; ``turns``: of a motor's rotor."""
    found = []
    for group in _groups(text):
        head, _, centres = group.partition(":")
        fit, along, *turn = head.split()
        axis, length = _axis(along)
        turned_axis = _turned(axis, turn)
        for centre in points(centres):
            turned_centre = _turned(centre, turn)
            found.append(
                Site(
                    _FITS[fit],
                    turned_centre,
                    turned_axis,
                    length,
                    turns,
                )
            )
    return tuple(found)


def _turned(vector: Triple, turn: list[str]) -> Triple:
    """A vector after a turn: the word ``tilted`` for one about x, ``turned`` for one about z, and
    its angle; or no words."""
    if not turn:
        return vector
    word, angle = turn
    x, y, z = vector
    sine = math.sin(math.radians(float(angle)))
    cosine = math.cos(math.radians(float(angle)))
    if word == "tilted":
        return x, y * cosine - z * sine, y * sine + z * cosine
    return x * cosine - y * sine, x * sine + y * cosine, z


def beam(text: str) -> tuple[tuple[Site, ...], tuple[Solid, ...]]:
    """Holes and solids of a beam; chains that meet share a hole."""
    found: dict[Triple, Site] = {}
    bars = []
    for chain in _groups(text):
        head, _, places = chain.partition(":")
        _, along, kinds = head.split()
        (axis, thickness) = _axis(along)
        centres = points(places)
        # Bars between the holes are enough, because the tubes around the holes round the ends of
        # the beam.
        for start, end in itertools.pairwise(centres):
            bars.append(
                bar(
                    start,
                    end,
                    axis,
                    2 * _WALL_RADIUS,
                    thickness,
                )
            )
        for index, (kind, centre) in enumerate(zip(kinds, centres, strict=True)):
            if kind == "-":
                continue
            # The cross of a hole lies along its beam: towards the hole before it, or for the first
            # hole towards the next.
            neighbour = index - 1 if index else min(1, len(centres) - 1)
            arm = np.array(centre) - np.array(centres[neighbour])
            arm /= max(float(np.linalg.norm(arm)), 1e-9)
            hole = Site(
                _FITS[kind],
                centre,
                axis,
                thickness,
                arm=triple(arm),
            )
            # Where chains meet, the first one decides how the cross lies.
            found.setdefault(centre, hole)
    holes = tuple(found.values())
    return holes, (*bars, *_tubes(holes))


def solids(
    text: str, part_sites: Iterable[Site] = ()
) -> tuple[tuple[Solid, ...], tuple[tuple[int, Solid], ...]]:
    """Solids of a part with these sites; and notches in them, each with the number of solids before
    it."""
    found: list[Solid] = []
    notches: list[tuple[int, Solid]] = []
    for group in _groups(text):
        shape = group.removeprefix(_NOTCH)
        made = list(_solids(shape.split(), part_sites))
        is_notch = shape != group
        if is_notch:
            notches += [(len(found), solid) for solid in made]
        else:
            found += made
    return tuple(found), tuple(notches)


def _solids(words: list[str], part_sites: Iterable[Site]) -> Iterable[Solid]:
    """The solids of a group, by its words."""
    match words:
        case ["tubes"]:
            return _tubes(part_sites)
        case ["box", centres, size]:
            return [box(centre, point(size)) for centre in points(centres)]
        case ["ball", centre, radius]:
            return [ball(point(centre), float(radius))]
        case ["cylinder", along, centres, radius]:
            axis, length = _axis(along)
            return [
                cylinder(
                    centre,
                    axis,
                    length,
                    float(radius),
                )
                for centre in points(centres)
            ]
        case ["ring", along, centres, outer, inner]:
            axis, length = _axis(along)
            radii = (float(outer), float(inner))
            return [ring(centre, axis, length, *radii) for centre in points(centres)]
    return ()


def _tubes(part_sites: Iterable[Site]) -> list[Solid]:
    """A tube around each hole, a round bar for each pin and axle."""
    found = []
    for site in part_sites:
        if site.fit not in _WITHOUT_SOLIDS:
            radius = _PIN_RADIUS if site.fit.is_male else _WALL_RADIUS
            found.append(
                cylinder(
                    site.centre,
                    site.axis,
                    site.length,
                    radius,
                )
            )
    return found


def gears(text: str) -> tuple[Gear, ...]:
    """Gears of a part."""
    found = []
    for group in _groups(text):
        form, teeth, along, centre, *further = group.split()
        axis, width = _axis(along)
        gear = Gear(
            GearForm[form.upper()],
            int(teeth),
            point(centre),
            axis,
            width,
        )
        for word in further:
            name, _, value = word.partition("=")
            if name == "up":
                gear = replace(gear, up=point(value))
            else:
                gear = replace(gear, set_back=float(value))
        found.append(gear)
    return tuple(found)


def _axis(text: str) -> tuple[Triple, float]:
    """Direction and length of a text such as ``"z20"``."""
    return AXES[text[0]], float(text[1:])


def _groups(text: str) -> list[str]:
    return [group.strip() for group in text.split("|") if group.strip()]
