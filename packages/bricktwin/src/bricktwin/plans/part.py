"""Kinds of parts: connection sites, solids, masses and numbers in shops. LDraw units."""

import enum
import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bricktwin.plans.geometry import Bools, Floats, Solid, Triple

HOLE_RADIUS = 6.2
"""Radius of pin and axle holes; that of a pin is 6."""
# The ends of a pin hole are wider, to take the collar of a pin or the stop of an axle.
_RECESS = 2.0
"""Length that the recess adds to the hole's radius, LDU."""
_RECESS_DEPTH = 2.0
"""Depth of the recess in the hole, LDU."""
_SAMPLE_DEPTH = 0.9
"""Distance of sample points from the surface, LDU."""
_THIN = 12.0
"""Half sizes of a solid below this are filled more closely."""


class Fit(enum.Enum):
    """Kinds of connection sites."""

    HOLE = "pin hole"
    AXLE_HOLE = "axle hole"
    PIN = "pin"
    FRICTION_PIN = "friction pin"
    AXLE = "axle"
    TURNTABLE = "turntable"
    STUD = "stud"
    STUD_HOLE = "stud hole"
    PEG = "peg"
    """A round peg of a differential, which fits into the axle hole of a gear that turns on it."""
    BALL = "ball"
    """A towball; the axis is that of its pin."""
    SOCKET = "ball socket"
    RIM = "rim"
    """The seat of a tyre on a rim. The length of the site is its diameter, and so it is for a
    tyre."""
    TYRE = "tyre"

    @property
    def is_male(self) -> bool:
        """Whether the site goes into another part."""
        return self in (Fit.PIN, Fit.FRICTION_PIN, Fit.AXLE, Fit.STUD, Fit.PEG, Fit.BALL, Fit.RIM)


@dataclass(frozen=True)
class Site:
    """A connection site.

    Attributes:
        centre: midpoint.
        axis: direction of length 1.
        length: along the axis.
        turns: whether it belongs to a motor's rotor, not its case.
        arm: direction of an axle hole's cross; a coordinate axis by default.
    """

    fit: Fit
    centre: Triple
    axis: Triple
    length: float
    turns: bool = False
    arm: Triple | None = None


class GearForm(enum.Enum):
    """Kinds of gears."""

    SPUR = "spur"
    BEVEL = "bevel"
    DOUBLE_BEVEL = "double bevel"
    CROWN = "crown"
    WORM = "worm"
    RACK = "rack"


@dataclass(frozen=True)
class Gear:
    """Teeth around an axis.

    Attributes:
        teeth: number of teeth; of threads for a worm.
        axis: of rotation; direction of travel for a rack.
        width: along the axis.
        up: of a rack, from the pitch line to the teeth.
        set_back: at right angles, how far the gear's middle is from the other axis beyond the
            other's pitch radius.
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
        """Radius of the pitch circle, LDU: 1.25 (0.5 mm) for each tooth."""
        return 1.25 * self.teeth


class DeviceKind(enum.Enum):
    """Kinds of electric parts."""

    HUB = "hub"
    MOTOR = "motor"
    SENSOR = "sensor"


@dataclass(frozen=True)
class Device:
    """An electric part.

    Attributes:
        name: as in ``bricktwin.robots``.
        plug: position of the cable's exit; a hub's middle.
        cable_mm: length of the cable, 0 for a hub.
        ports: positions of a hub's ports.
        direction: outward direction of a motor's shaft, viewing direction of a sensor; ``None`` for
            a hub.
        sold_as: LEGO's number of the device sold singly, "" if there is none.
    """

    kind: DeviceKind
    name: str
    plug: Triple
    cable_mm: float = 0.0
    ports: tuple[tuple[str, Triple], ...] = ()
    direction: Triple | None = None
    sold_as: str = ""


class MassSource(enum.Enum):
    """Sources of masses."""

    VOLUME = "volume of the shape at LDraw.org, 1.05 g/cm3"
    RULE = "rule fitted to the volumes of the family's shapes at LDraw.org, 1.05 g/cm3"
    ESTIMATE = "estimate"


@dataclass(frozen=True)
class Part:
    """A kind of part.

    Attributes:
        number: of the LDraw file, without ``.dat``, and in shops.
        aliases: other LDraw numbers of the same shape.
        family: beams, pins and so on.
        sites: connection sites.
        solids: occupied space, holes not subtracted.
        turning: solids of a motor's rotor.
        notches: empty space, each with the number of solids that it is cut out of: the first ones.
        mass_g: grams.
        length: of an axle, in modules; else 0.
        wheel_mm: rolling diameter of a wheel, else 0.
        is_loose: whether its connection is not modelled (a ball in its cup).
    """

    number: str
    name: str
    family: str
    sites: tuple[Site, ...]
    solids: tuple[Solid, ...]
    mass_g: float
    mass_source: MassSource
    aliases: tuple[str, ...] = ()
    turning: tuple[Solid, ...] = ()
    notches: tuple[tuple[int, Solid], ...] = ()
    gears: tuple[Gear, ...] = ()
    device: Device | None = None
    length: int = 0
    wheel_mm: float = 0.0
    is_loose: bool = False

    @property
    def holes(self) -> tuple[Site, ...]:
        """The pin holes and axle holes."""
        return tuple(site for site in self.sites if site.fit in (Fit.HOLE, Fit.AXLE_HOLE))

    def contains(
        self,
        points: Floats,
        margin: float,
    ) -> Bools:
        """Whether points [n, 3], in the part's frame, are deeper than ``margin`` in the solids, and
        in no hole [n]."""
        inside = np.zeros(len(points), dtype=bool)
        for solid in (*self.solids, *self.turning):
            inside |= solid.contains(points, margin)
        # A hole matters only to points that are in a solid, so the others are not tested.
        inside[inside] = ~_in_holes(points[inside], self.holes, 0.0)
        return inside

    def blocks(
        self,
        points: Floats,
        margin: float,
        open_holes: Iterable[Site],
    ) -> Bools:
        """Whether points [n, 3] are deeper than ``margin`` in the material [n]. Only the holes that
        are open for them are empty: nothing else fits into a hole."""
        inside = np.zeros(len(points), dtype=bool)
        for number, solid in enumerate((*self.solids, *self.turning)):
            within = np.flatnonzero(solid.contains(points, margin))
            is_in_notch = self._in_notch(points[within], number, margin)
            # Notches are tested for each solid, because where one has its notch another may have
            # material.
            inside[within[~is_in_notch]] = True
        inside[inside] = ~_in_holes(
            points[inside],
            open_holes,
            margin,
            _RECESS,
        )
        return inside

    def _in_notch(
        self,
        points: Floats,
        number: int,
        margin: float,
    ) -> Bools:
        """Whether points [n, 3] are in a notch of a solid, or less than ``margin`` from one [n]."""
        inside = np.zeros(len(points), dtype=bool)
        for count, notch in self.notches:
            # A notch is cut out of the first `count` solids only.
            if number < count:
                inside |= notch.contains(points, -margin)
        return inside

    @functools.cached_property
    def mirror(self) -> Floats | None:
        """Signs [3] of a reflection along an axis that maps the part onto itself; ``None`` for a
        part with a left and a right."""
        # The rows (-1, 1, 1), (1, -1, 1), (1, 1, -1) are the reflections along the three axes, of
        # which one is enough.
        for signs in 1.0 - 2.0 * np.eye(3):
            has_same_features = self._features(signs) == self._features(np.ones(3))
            # This test costs most and so comes last: the mirrored material must lie in the part,
            # give or take 0.2 LDU.
            if has_same_features and self.contains(self.samples * signs, -0.2).all():
                return np.asarray(signs)
        return None

    def _features(self, signs: Floats) -> list[tuple[object, ...]]:
        """Sites, gears and device after a reflection; axes without their directions."""

        def point(values: Triple | None) -> tuple[float, ...]:
            # Adding 0.0 turns -0.0 into 0.0, so that both compare as equal.
            return () if values is None else tuple((np.array(values) * signs).round(2) + 0.0)

        def line(values: Triple | None) -> tuple[float, ...]:
            # A direction and its reverse are one line, so the larger of the two stands for both.
            if values is None:
                return ()
            reverse = (-values[0], -values[1], -values[2])
            return max(point(values), point(reverse))

        sites = []
        for site in self.sites:
            axis = line(site.axis)
            arm = line(site.arm)
            sites.append((site.fit.value, point(site.centre), axis, site.length, site.turns, arm))
        gears = []
        for gear in self.gears:
            axis = line(gear.axis)
            up = point(gear.up)
            gears.append((gear.form.value, point(gear.centre), axis, gear.width, gear.teeth, up))
        # A reflection may exchange equal sites or gears, so their order must not count.
        features: list[tuple[object, ...]] = [*sorted(sites), *sorted(gears)]
        if self.device is not None:
            # Ports have names, and a reflection must not exchange them.
            ports = sorted((name, point(place)) for name, place in self.device.ports)
            features.append((ports, point(self.device.plug), point(self.device.direction)))
        return features

    @functools.cached_property
    def corners(self) -> Floats:
        """Corners [n, 3] of the bounding boxes of all solids."""
        return np.concatenate([solid.corners() for solid in (*self.solids, *self.turning)])

    @functools.cached_property
    def samples(self) -> Floats:
        """Points [n, 3] in the material, at least 0.9 LDU below the surface."""
        points = [np.zeros((0, 3))]
        for number, solid in enumerate((*self.solids, *self.turning)):
            # Points in a thin solid must be closer together, or it would hardly have any.
            spacing = 3.5 if min(solid.half) < _THIN else 7.0
            samples = solid.samples(spacing, _SAMPLE_DEPTH)
            is_in_notch = self._in_notch(samples, number, _SAMPLE_DEPTH)
            points.append(samples[~is_in_notch])
        samples = np.concatenate(points)
        is_in_hole = _in_holes(
            samples,
            self.holes,
            _SAMPLE_DEPTH,
            _RECESS,
        )
        return samples[~is_in_hole]

    @functools.cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates [3]."""
        return self.corners.min(axis=0), self.corners.max(axis=0)


def _in_holes(
    points: Floats,
    holes: Iterable[Site],
    margin: float,
    recess: float = 0.0,
) -> Bools:
    """Whether points [n, 3] are in a hole, or less than ``margin`` from one [n]. ``recess``: of a
    pin hole's ends."""
    inside = np.zeros(len(points), dtype=bool)
    for site in holes:
        offset = points - np.array(site.centre)  # [n, 3]
        along = offset @ np.array(site.axis)  # [n]
        # By Pythagoras, this is the squared distance from the axis.
        squared = np.einsum("ij,ij->i", offset, offset) - along * along
        is_end = (np.abs(along) > site.length / 2 - _RECESS_DEPTH) & (site.fit is Fit.HOLE)
        radius = HOLE_RADIUS + margin + recess * is_end
        is_beside = np.abs(along) < site.length / 2 + 0.5
        inside |= (squared < radius**2) & is_beside
    return inside
