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
"""Radius of the inside of a hollow pin."""
_COLLAR_RADIUS = 7.8
_COLLAR_WIDTH = 2.4
_SLIT = (1.3, 9.0, 8.0)
"""Half sizes of the slit in an end of a pin: its width, across the pin, and into it."""
_RECESS_RADIUS = 8.0
"""Radius of the wider ends of a pin hole, into which a pin's collar goes."""
_RECESS_DEPTH = 2.0
_BLADE = (6.0, 2.2)
"""Half length and half width of an axle's blade."""
_CROSS = (6.2, 2.4)
"""Half length and half width of the arms of the cross that the blade goes into."""
_TOOTH_HEIGHT = 2.2
"""Height of teeth above the pitch circle."""
_TOOTH_DEPTH = 2.8
"""Depth of teeth below the pitch circle."""
_RUBBER = 0.4
"""Rings of a wheel that are wider than this share of its diameter are its tyre."""
_MIN_TYRE_MM = 50.0
"""Wheels up to this diameter are of one material."""
_PLAIN_GEARS = (GearForm.RACK, GearForm.WORM)
"""Gears whose teeth do not stand in a circle; they are drawn by their solids alone."""
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
    """The pieces that a part is drawn with."""
    drawn = _drawn_looks().get(part.number, ())
    # A drawing in the part's own colour replaces all of its solids; one in other colours only adds
    # details to them.
    is_whole = any(piece.tint is Tint.MAIN for piece in drawn)
    pieces = [*drawn]
    if not is_whole:
        pieces = [*_solids(part), *drawn]
    pieces += [Piece(solid, Tint.TURNING) for solid in part.turning]
    # The order of what follows is part of the drawing, because where two surfaces coincide the
    # earlier piece is seen.
    for site in part.sites:
        if site.fit is Fit.STUD:
            pieces.append(
                Piece(
                    cylinder(
                        site.centre,
                        site.axis,
                        site.length,
                        _STUD_RADIUS,
                    )
                )
            )
    for site in part.sites:
        if site.fit is Fit.AXLE:
            pieces += [Piece(blade) for blade in _cross(site, *_BLADE, site.length)]
    for site in part.sites:
        if _is_pin(site):
            pieces += _pin(site)
    if part.gears and part.gears[0].form not in _PLAIN_GEARS:
        pieces += [Piece(tooth) for tooth in _teeth(part)]
    holes: list[Solid] = []
    for site in part.holes:
        holes += _hole(site)
    bored = [_bored(piece, holes) for piece in pieces]
    return (*bored, *_cable(part))


def _bored(piece: Piece, holes: list[Solid]) -> Piece:
    """A piece with holes cut out of it. Holes that do not meet it are left out, because each cut
    costs rays."""
    near = [hole for hole in holes if solids_meet(piece.solid, hole)]
    return Piece(piece.solid, piece.tint, (*piece.cuts, *near))


@functools.cache
def _drawn_looks() -> dict[str, tuple[Piece, ...]]:
    """Pieces of the parts that are in ``looks.csv``."""
    looks: dict[str, tuple[Piece, ...]] = {}
    for row in read_table("bricktwin.plans.catalogue", "looks"):
        solids, notches = part_notation.solids(row["solids"])
        tint = Tint[row["tint"].upper()]
        pieces = tuple(
            Piece(solid, tint, _cuts(number, notches)) for number, solid in enumerate(solids)
        )
        # A row may serve several parts, and a part has a row for each of its materials.
        for part in row["numbers"].split():
            looks[part] = (*looks.get(part, ()), *pieces)
    return looks


def _solids(part: Part) -> Iterator[Piece]:
    """The solids of the catalogue, without those of pins, axles and a gear's teeth, which have
    looks of their own."""
    bars = [
        cylinder(
            site.centre,
            site.axis,
            site.length,
            _PIN_RADIUS,
        )
        for site in part.sites
        if site.fit is Fit.AXLE or _is_pin(site)
    ]
    rubber_radius = _rubber_radius(part)
    for number, solid in enumerate(part.solids):
        cuts = _cuts(number, part.notches)
        # The first solid of a gear is a disc that reaches to the tips of its teeth, so it is drawn
        # smaller here and `_teeth` adds the teeth.
        is_toothed = part.family == "gears" and number == 0
        if is_toothed and part.gears[0].form not in _PLAIN_GEARS:
            root = min(solid.half[0], _root(part.gears[0]))
            half = (root, min(root, solid.half[1]), solid.half[2])
            yield Piece(
                Solid(
                    solid.form,
                    solid.centre,
                    half,
                    solid.axes,
                ),
                Tint.MAIN,
                cuts,
            )
        elif solid not in bars:
            is_rubber = solid.form is Form.RING and solid.half[0] > rubber_radius
            yield Piece(solid, Tint.DARK if is_rubber else Tint.MAIN, cuts)


def _rubber_radius(part: Part) -> float:
    """Outer radius from which the rings of a part are rubber, LDU."""
    if part.family == "tyres":
        return 0.0
    if part.wheel_mm > _MIN_TYRE_MM:
        return _RUBBER * part.wheel_mm / MM_PER_LDU
    return math.inf


def _cuts(number: int, notches: tuple[tuple[int, Solid], ...]) -> tuple[Solid, ...]:
    # In its row of the table, a notch cuts only the solids that stand before it.
    return tuple(notch for count, notch in notches if number < count)


def _is_pin(site: Site) -> bool:
    return site.fit in (Fit.PIN, Fit.FRICTION_PIN)


def _frame(site: Site) -> tuple[Triple, Triple, Triple]:
    """Axes of a site: the arm of its cross, across, along."""
    if site.arm is None:
        return frame_of(site.axis)
    return site.arm, triple(np.cross(site.axis, site.arm)), site.axis


def _cross(
    site: Site,
    length: float,
    width: float,
    along: float,
) -> list[Solid]:
    """The two blades of a cross; half length and half width of one, and their length along the
    axis."""
    frame = _frame(site)
    first = Solid(
        Form.BOX,
        site.centre,
        (length, width, along / 2),
        frame,
    )
    second = Solid(
        Form.BOX,
        site.centre,
        (width, length, along / 2),
        frame,
    )
    return [first, second]


def _hole(site: Site) -> list[Solid]:
    """The empty space of a hole."""
    if site.fit is Fit.AXLE_HOLE:
        return _cross(site, *_CROSS, site.length + 1.0)
    # The bore is longer than the hole, so that no film of material is left at its ends.
    length = site.length + 1.0
    bore = cylinder(
        site.centre,
        site.axis,
        length,
        HOLE_RADIUS,
    )
    depth = _RECESS_DEPTH + 0.5
    # In a thin part, two recesses would leave nothing between them.
    if site.length <= 3 * depth:
        return [bore]
    recesses = []
    for side in (-1, 1):
        end = _along(site, side * (length - depth) / 2)
        recesses.append(
            cylinder(
                end,
                site.axis,
                depth,
                _RECESS_RADIUS,
            )
        )
    return [bore, *recesses]


def hole_ends(site: Site, offset: float) -> list[Solid]:
    """Solids that fill a hole and stand out of both of its ends."""
    if site.fit is Fit.AXLE_HOLE:
        return _cross(site, *_BLADE, site.length + 2 * offset)
    return [
        cylinder(
            site.centre,
            site.axis,
            site.length + 2 * offset,
            _PIN_RADIUS,
        )
    ]


def _along(site: Site, offset: float) -> Triple:
    """A point on the axis of a site."""
    return triple(np.array(site.centre) + offset * np.array(site.axis))


def _pin(site: Site) -> Iterator[Piece]:
    """A pin: hollow, its ends slit, with a collar a module from them."""
    frame = frame_of(site.axis)
    half = site.length / 2
    ends = (_along(site, -half), _along(site, half))
    slits = tuple(Solid(Form.BOX, end, _SLIT, frame) for end in ends)
    shaft = ring(
        site.centre,
        site.axis,
        site.length,
        _PIN_RADIUS,
        _BORE_RADIUS,
    )
    yield Piece(shaft, Tint.MAIN, slits)
    for offset in _collars(site.length):
        middle = _along(site, offset)
        yield Piece(
            ring(
                middle,
                site.axis,
                _COLLAR_WIDTH,
                _COLLAR_RADIUS,
                _BORE_RADIUS,
            )
        )


def _collars(length: float) -> tuple[float, ...]:
    """Places of a pin's collars, LDU from its middle. A module is 20: a pin of two has one, a
    longer one has two, and what is shorter has none."""
    if length == 40:
        return (0.0,)
    if length > 40:
        return (-10.0, 10.0)
    return ()


def _root(gear: Gear) -> float:
    """Radius between the teeth of a gear."""
    return gear.pitch_radius - _TOOTH_DEPTH


def _teeth(part: Part) -> Iterator[Solid]:
    """The teeth of a gear, and the ring that they stand on."""
    gear = part.gears[0]
    width = gear.width
    if part.family == "gears":
        width = min(gear.width, 2 * part.solids[0].half[2])
    root = _root(gear)
    tip = gear.pitch_radius + _TOOTH_HEIGHT
    # The teeth of a crown gear point along the axis, so they stand on its rim and not beyond it.
    if gear.form is GearForm.CROWN:
        root = part.solids[0].half[0] - _TOOTH_HEIGHT - _TOOTH_DEPTH
        tip = part.solids[0].half[0]
    # `_solids` draws a gear only up to below its teeth, so the ring under them is added; parts of
    # other families keep theirs.
    if part.family == "gears":
        yield ring(
            gear.centre,
            gear.axis,
            width,
            root,
            max(root - 4.0, 5.0),
        )
    first, second, axis = (np.array(direction) for direction in frame_of(gear.axis))
    # Each tooth begins a little below its root, so that there is no gap to the ring.
    half_height = (tip - root + 1.0) / 2
    # Gears of any size have a pitch of 2 pi times 1.25 LDU. A tooth fills a little less than half
    # of it, so that meshing teeth fit into the gaps.
    half_thickness = 0.23 * 2 * math.pi * 1.25
    half = (half_height, half_thickness, width / 2)
    for tooth in range(gear.teeth):
        angle = 2 * math.pi * tooth / gear.teeth
        outward = math.cos(angle) * first + math.sin(angle) * second
        centre = triple(np.array(gear.centre) + outward * (root - 1.0 + tip) / 2)
        axes = (triple(outward), triple(np.cross(axis, outward)), triple(axis))
        yield Solid(Form.BOX, centre, half, axes)


def _cable(part: Part) -> Iterator[Piece]:
    """The beginning of a device's cable, out of the side that its exit is nearest to."""
    if part.device is None or part.device.cable_mm <= 0:
        return
    plug = np.array(part.device.plug)
    low, high = part.bounds
    # The place of the exit in the bounding box is -0.5..0.5 along each axis, so the axis with the
    # largest is that of the nearest side.
    exit_place = (plug - (low + high) / 2) / (high - low)
    axis = int(np.argmax(np.abs(exit_place)))
    direction = triple(np.sign(exit_place[axis]) * np.eye(3)[axis])
    middle = plug + np.array(direction) * _CABLE_LENGTH / 2
    yield Piece(
        cylinder(
            triple(middle),
            direction,
            _CABLE_LENGTH,
            _CABLE_RADIUS,
        ),
        Tint.DARK,
    )


def solids_meet(solid: Solid, other: Solid) -> bool:
    """Whether the bounding boxes of two solids touch."""
    first = solid.corners()
    second = other.corners()
    is_low_enough = first.min(axis=0) <= second.max(axis=0)
    is_high_enough = second.min(axis=0) <= first.max(axis=0)
    return bool((is_low_enough & is_high_enough).all())
