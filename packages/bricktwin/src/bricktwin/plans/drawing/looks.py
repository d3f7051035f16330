"""The look of a part: solids with their materials, and the empty spaces that are cut out of them.
LDraw units, the part's frame.

Two drawings follow from it: the pictures of a booklet (`picture`, by rays) and the meshes of a twin
(`meshes`, by triangles).
"""

import enum
import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from brickhub.tables import read_table
from bricktwin.plans.catalogue import part_notation
from bricktwin.plans.geometry import (
    MM_PER_LDU,
    Form,
    Solid,
    Triple,
    cylinder,
    frame_of,
    ring,
    triple,
)
from bricktwin.plans.part import HOLE_RADIUS, Fit, Gear, GearForm, Part, Site

_STUD_RADIUS = 6.0
_PIN_RADIUS = 6.0
_BORE_RADIUS = 4.0
_COLLAR_RADIUS = 7.8
_RECESS_RADIUS = 8.0
_RECESS_DEPTH = 2.0
"""The wider ends of a pin hole."""
_BLADE = (6.0, 2.2)
_CROSS = (6.2, 2.4)
"""Half length and half width of an axle's blade, and of the cross that it goes into."""
_TOOTH_HEIGHT = 2.2
_TOOTH_DEPTH = 2.8
"""Height of teeth above the pitch circle, and below it."""
_RUBBER = 0.4
"""Rings of a wheel that are wider than this share of its diameter are its tyre."""
_CABLE_RADIUS = 5.0
_CABLE_LENGTH = 14.0


class Tint(enum.IntEnum):
    """Materials of a surface."""

    MAIN = 0
    DARK = 1
    TURNING = 2
    FACE = 3
    WHITE = 4
    GREY = 5
    TEAL = 6
    LIT = 7


TINTS = {
    Tint.DARK: (0.16, 0.17, 0.19),
    Tint.TURNING: (0.45, 0.47, 0.50),
    Tint.FACE: (0.10, 0.11, 0.13),
    Tint.WHITE: (0.93, 0.93, 0.92),
    Tint.GREY: (0.66, 0.68, 0.70),
    Tint.TEAL: (0.02, 0.60, 0.62),
    Tint.LIT: (1.00, 0.90, 0.45),
}
"""Red, green and blue, in 0..1, of the materials that do not have the part's colour."""


@dataclass(frozen=True)
class Piece:
    """A solid, its material, and what is cut out of it."""

    solid: Solid
    tint: Tint = Tint.MAIN
    cuts: tuple[Solid, ...] = ()


@functools.lru_cache(maxsize=1024)
def look_of(part: Part) -> tuple[Piece, ...]:
    """The pieces of a part."""
    own = _own_looks().get(part.number, ())
    pieces = [*own] if any(piece.tint is Tint.MAIN for piece in own) else [*_solids(part), *own]
    pieces += [Piece(solid, Tint.TURNING) for solid in part.turning]
    pieces += [
        Piece(cylinder(site.centre, site.axis, site.length, _STUD_RADIUS))
        for site in part.sites
        if site.fit is Fit.STUD
    ]
    pieces += [
        piece
        for site in part.sites
        if site.fit is Fit.AXLE
        for piece in map(Piece, _cross(site, *_BLADE, site.length))
    ]
    pieces += [piece for site in part.sites if _is_pin(site) for piece in _pin(site)]
    if part.gears and part.gears[0].form not in (GearForm.RACK, GearForm.WORM):
        pieces += [Piece(tooth) for tooth in _teeth(part)]
    holes = [cut for site in part.holes for cut in _hole(site)]
    cut = [
        Piece(
            piece.solid,
            piece.tint,
            (*piece.cuts, *(h for h in holes if solids_meet(piece.solid, h))),
        )
        for piece in pieces
    ]
    return (*cut, *_cable(part))


@functools.cache
def _own_looks() -> dict[str, tuple[Piece, ...]]:
    """Pieces of the parts that are in ``looks.csv``."""
    looks: dict[str, tuple[Piece, ...]] = {}
    for row in read_table("bricktwin.plans.catalogue", "looks"):
        solids, notches = part_notation.solids(row["solids"])
        pieces = tuple(
            Piece(solid, Tint[row["tint"].upper()], _cuts(number, notches))
            for number, solid in enumerate(solids)
        )
        for part in row["numbers"].split():
            looks[part] = (*looks.get(part, ()), *pieces)
    return looks


def _solids(part: Part) -> Iterator[Piece]:
    """The solids of the catalogue, without those of pins, axles and a gear's teeth, which have
    looks of their own."""
    bars = [
        cylinder(s.centre, s.axis, s.length, _PIN_RADIUS)
        for s in part.sites
        if s.fit is Fit.AXLE or _is_pin(s)
    ]
    rubber = (
        0.0
        if part.family == "tyres"
        else _RUBBER * part.wheel_mm / MM_PER_LDU
        if part.wheel_mm > 50
        else math.inf
    )
    for number, solid in enumerate(part.solids):
        cuts = _cuts(number, part.notches)
        if (
            part.family == "gears"
            and number == 0
            and part.gears[0].form not in (GearForm.RACK, GearForm.WORM)
        ):
            root = min(solid.half[0], _root(part.gears[0]))
            half = root, min(root, solid.half[1]), solid.half[2]
            yield Piece(Solid(solid.form, solid.centre, half, solid.axes), Tint.MAIN, cuts)
        elif solid not in bars:
            is_rubber = solid.form is Form.RING and solid.half[0] > rubber
            yield Piece(solid, Tint.DARK if is_rubber else Tint.MAIN, cuts)


def _cuts(number: int, notches: tuple[tuple[int, Solid], ...]) -> tuple[Solid, ...]:
    return tuple(notch for count, notch in notches if number < count)


def _is_pin(site: Site) -> bool:
    return site.fit in (Fit.PIN, Fit.FRICTION_PIN)


def _frame(site: Site) -> tuple[Triple, Triple, Triple]:
    """Axes of a site: the arm of its cross, across, along."""
    if site.arm is None:
        return frame_of(site.axis)
    return site.arm, triple(np.cross(site.axis, site.arm)), site.axis


def _cross(site: Site, length: float, width: float, along: float) -> list[Solid]:
    """The two blades of a cross; half length and half width of one, and their length along the
    axis."""
    return [
        Solid(Form.BOX, site.centre, (x, y, along / 2), _frame(site))
        for x, y in ((length, width), (width, length))
    ]


def _hole(site: Site) -> list[Solid]:
    """The empty space of a hole."""
    if site.fit is Fit.AXLE_HOLE:
        return _cross(site, *_CROSS, site.length + 1.0)
    through = cylinder(site.centre, site.axis, site.length + 1.0, HOLE_RADIUS)
    depth = _RECESS_DEPTH + 0.5
    ends = (
        [_along(site, side * (site.length + 1.0 - depth) / 2) for side in (-1, 1)]
        if site.length > 3 * depth
        else []
    )
    return [through, *(cylinder(end, site.axis, depth, _RECESS_RADIUS) for end in ends)]


def hole_ends(site: Site, offset: float) -> list[Solid]:
    """Solids that fill a hole and stand out of both of its ends."""
    if site.fit is Fit.AXLE_HOLE:
        return _cross(site, *_BLADE, site.length + 2 * offset)
    return [cylinder(site.centre, site.axis, site.length + 2 * offset, _PIN_RADIUS)]


def _along(site: Site, offset: float) -> Triple:
    """A point on the axis of a site."""
    return triple(np.array(site.centre) + offset * np.array(site.axis))


def _pin(site: Site) -> Iterator[Piece]:
    """A pin: hollow, its ends slit, with a collar a module from them."""
    frame = frame_of(site.axis)
    half = site.length / 2
    slits = tuple(
        Solid(Form.BOX, _along(site, side * half), (1.3, 9.0, 8.0), frame) for side in (-1, 1)
    )
    yield Piece(
        ring(site.centre, site.axis, site.length, _PIN_RADIUS, _BORE_RADIUS), Tint.MAIN, slits
    )
    collars = (0.0,) if site.length == 40 else (-10.0, 10.0) if site.length > 40 else ()
    for offset in collars:
        yield Piece(ring(_along(site, offset), site.axis, 2.4, _COLLAR_RADIUS, _BORE_RADIUS))


def _root(gear: Gear) -> float:
    """Radius between the teeth of a gear."""
    return gear.pitch_radius - _TOOTH_DEPTH


def _teeth(part: Part) -> Iterator[Solid]:
    """The teeth of a gear, and the ring that they stand on."""
    gear = part.gears[0]
    width = min(gear.width, 2 * part.solids[0].half[2]) if part.family == "gears" else gear.width
    root = _root(gear)
    tip = gear.pitch_radius + _TOOTH_HEIGHT
    if gear.form is GearForm.CROWN:  # its teeth stand on the rim, along the axis
        root = part.solids[0].half[0] - _TOOTH_HEIGHT - _TOOTH_DEPTH
        tip = part.solids[0].half[0]
    if part.family == "gears":
        yield ring(gear.centre, gear.axis, width, root, max(root - 4.0, 5.0))
    first, second, axis = (np.array(direction) for direction in frame_of(gear.axis))
    for tooth in range(gear.teeth):
        angle = 2 * math.pi * tooth / gear.teeth
        out = math.cos(angle) * first + math.sin(angle) * second
        centre = triple(np.array(gear.centre) + out * (root - 1.0 + tip) / 2)
        size = ((tip - root + 1.0) / 2, 0.23 * 2 * math.pi * 1.25, width / 2)
        yield Solid(
            Form.BOX, centre, size, (triple(out), triple(np.cross(axis, out)), triple(axis))
        )


def _cable(part: Part) -> Iterator[Piece]:
    """The beginning of a device's cable, out of the side that its exit is nearest to."""
    if part.device is not None and part.device.cable_mm > 0:
        low, high = part.bounds
        exits = (np.array(part.device.plug) - (low + high) / 2) / (high - low)
        axis = int(np.argmax(np.abs(exits)))
        direction = triple(np.sign(exits[axis]) * np.eye(3)[axis])
        start = np.array(part.device.plug) + np.array(direction) * _CABLE_LENGTH / 2
        yield Piece(cylinder(triple(start), direction, _CABLE_LENGTH, _CABLE_RADIUS), Tint.DARK)


def solids_meet(solid: Solid, other: Solid) -> bool:
    """Whether the bounding boxes of two solids touch."""
    first = solid.corners()
    second = other.corners()
    return bool(
        (
            (first.min(axis=0) <= second.max(axis=0)) & (second.min(axis=0) <= first.max(axis=0))
        ).all()
    )
