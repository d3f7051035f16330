"""A kind of part: where it connects to others, the room that it takes, its mass and its names in shops. LDraw units."""

from __future__ import annotations

import enum
import functools
from dataclasses import dataclass

import numpy as np

from bricksrl.plans.geometry import Bools, Floats, Solid, Triple

HOLE_RADIUS = 6.2
"""Of pin and axle holes; a pin's radius is 6."""
ABS_G_CM3 = 1.05
"""Density of the plastic."""


class Fit(enum.Enum):
    """Ways in which a place of a part takes, or goes into, another."""

    HOLE = "pin hole"
    AXLE_HOLE = "axle hole"
    PIN = "pin"
    FRICTION_PIN = "friction pin"
    AXLE = "axle"
    TURNTABLE = "turntable"
    STUD = "stud"
    STUD_HOLE = "stud hole"
    PEG = "peg"
    """Of a differential: round, with room for the axle hole of a gear that turns on it."""

    @property
    def is_male(self) -> bool:
        """It goes into another part."""
        return self in (Fit.PIN, Fit.FRICTION_PIN, Fit.AXLE, Fit.STUD, Fit.PEG)


@dataclass(frozen=True)
class Site:
    """A place where a part connects.

    Attributes:
        centre: its middle.
        axis: direction of length 1.
        length: along the axis.
        turns: whether it belongs to the piece of the part that a motor turns, not to its case.
        arm: of an axle hole, a direction of its cross; where it is missing, a coordinate axis.
    """

    fit: Fit
    centre: Triple
    axis: Triple
    length: float
    turns: bool = False
    arm: Triple | None = None


class GearForm(enum.Enum):
    """Shapes of teeth."""

    SPUR = "spur"
    BEVEL = "bevel"
    DOUBLE_BEVEL = "double bevel"
    CROWN = "crown"
    WORM = "worm"
    RACK = "rack"


@dataclass(frozen=True)
class Gear:
    """Teeth around an axis; two gears side by side mesh at half a millimetre for each of their teeth.

    Attributes:
        teeth: of a rack those on it, of a worm its threads.
        axis: of a rack the direction in which it runs.
        width: along the axis.
        up: of a rack, from its pitch line to its teeth.
        set_back: where two mesh at a right angle, how much farther from the other's axis its middle is than that one's pitch
            radius.
    """

    form: GearForm
    teeth: int
    centre: Triple
    axis: Triple
    width: float
    up: Triple = (0.0, 0.0, 0.0)
    set_back: float = 5.0

    @property
    def pitch_radius(self) -> float:
        """1.25 LDU for each tooth."""
        return 1.25 * self.teeth


class DeviceKind(enum.Enum):
    """What a part is to the electronics."""

    HUB = "hub"
    MOTOR = "motor"
    SENSOR = "sensor"


@dataclass(frozen=True)
class Device:
    """An electric part.

    Attributes:
        name: of the hub, motor or sensor as ``bricksrl.robots`` has it.
        plug: where the cable leaves the part; of a hub its middle.
        cable_mm: length of the cable, 0 for a hub.
        ports: of a hub, where each port is.
        shaft: of a motor, the direction in which its shaft points out.
        looks: of a sensor, the direction in which it looks.
    """

    kind: DeviceKind
    name: str
    plug: Triple
    cable_mm: float = 0.0
    ports: tuple[tuple[str, Triple], ...] = ()
    shaft: Triple | None = None
    looks: Triple | None = None


class MassSource(enum.Enum):
    """Where a mass comes from."""

    VOLUME = "volume of the shape at LDraw.org, 1.05 g/cm3"
    RULE = "rule fitted to the volumes of the family's shapes at LDraw.org, 1.05 g/cm3"
    ESTIMATE = "estimate"


@dataclass(frozen=True)
class Part:
    """A kind of part.

    Attributes:
        number: of the LDraw file, without ``.dat``.
        aliases: other LDraw numbers of the same shape.
        name: what a builder calls it.
        family: beams, pins and so on.
        sites: where it connects.
        solids: the room that it takes, holes not subtracted.
        turning: the solids of the piece that a motor turns.
        mass_g: in grams.
        bricklink, rebrickable: its numbers there.
        gears: its teeth.
        length: in modules, for the drawing of axles; 0 where that says nothing.
        wheel_mm: diameter of a wheel that rolls on the floor, 0 for others.
        is_loose: whether it holds by something that is not modelled here (a tyre on its rim, a ball in its cup).
    """

    number: str
    name: str
    family: str
    sites: tuple[Site, ...]
    solids: tuple[Solid, ...]
    mass_g: float
    mass_source: MassSource
    bricklink: str
    rebrickable: str
    aliases: tuple[str, ...] = ()
    turning: tuple[Solid, ...] = ()
    gears: tuple[Gear, ...] = ()
    device: Device | None = None
    length: int = 0
    wheel_mm: float = 0.0
    is_loose: bool = False

    @property
    def holes(self) -> tuple[Site, ...]:
        """The sites that others go into."""
        return tuple(site for site in self.sites if site.fit in (Fit.HOLE, Fit.AXLE_HOLE))

    def contains(self, points: Floats, margin: float) -> Bools:
        """The points [n, 3], in the part's own frame, that lie deeper than ``margin`` in its material."""
        inside = np.zeros(len(points), dtype=bool)
        for solid in (*self.solids, *self.turning):
            inside |= solid.contains(points, margin)
        if inside.any():
            inside[inside] = ~self._in_hole(points[inside], 0.0)
        return inside

    def _in_hole(self, points: Floats, margin: float) -> Bools:
        """The points [n, 3] that lie in a hole, or less than ``margin`` from it."""
        inside = np.zeros(len(points), dtype=bool)
        for site in self.holes:
            away = points - np.array(site.centre)
            along = away @ np.array(site.axis)
            aside = np.linalg.norm(away - along[:, None] * np.array(site.axis), axis=1)
            inside |= (aside < HOLE_RADIUS + margin) & (np.abs(along) < site.length / 2 + 0.5)
        return inside

    @functools.cached_property
    def samples(self) -> Floats:
        """Points [n, 3] in the part's material, 0.9 LDU and more below the surface."""
        solids = (*self.solids, *self.turning)
        points = [solid.samples(3.5 if min(solid.half) < 12 else 7.0, 0.9) for solid in solids]
        together = np.concatenate(points) if points else np.zeros((0, 3))
        return together[~self._in_hole(together, 0.9)]

    @functools.cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates [3] of its solids."""
        corners = np.concatenate([solid.corners() for solid in (*self.solids, *self.turning)])
        return corners.min(axis=0), corners.max(axis=0)
