"""Pictures of parts: triangle meshes from their solids, holes and teeth, and a software rasterizer with a depth buffer.

It needs no OpenGL and no display. LDraw units.
"""

from __future__ import annotations

import enum
import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.geometry import MM_PER_LDU, Bools, Floats, Form, Solid, circle_sides, cylinder, frame_of, triple
from bricktwin.plans.part import DeviceKind, Fit, Gear, GearForm, Part, Site
from bricktwin.plans.plan import Placed

DETAILED, COARSE = 0.1, 0.3
"""Largest distance of a circle from the polygon that is drawn for it: of parts in a booklet, and of moving robots."""
_ON_AXIS = 1e-9
"""Radii of a profile below this lie on its axis, where triangles have no area."""
_SPREAD, _OFFSET = 0.9, 0.05
"""Sample points around a triangle: share of the way from its middle to its corners, and distance from it, LDU."""
_STUD_RADIUS = 6.0
_RUBBER = 0.4
"""Rings of a wheel that are wider than this share of its diameter are its tyre."""
_TOOTH_HEIGHT = 2.2
"""Height of teeth above the pitch circle."""
_DISC_OFFSET = 0.15
"""Offset of a hole's dark disc from the surface, for visibility."""


class Tint(enum.IntEnum):
    """Materials of a surface."""

    MAIN = 0
    DARK = 1
    TURNING = 2
    FACE = 3


TINTS = {Tint.DARK: (0.16, 0.17, 0.19), Tint.TURNING: (0.45, 0.47, 0.50), Tint.FACE: (0.10, 0.11, 0.13)}
"""Red, green and blue, in 0..1, of the materials that do not have the part's colour."""


@dataclass(frozen=True)
class Surface:
    """Triangles [n, 3, 3], counter-clockwise from outside, and their tints [n]."""

    triangles: Floats
    tints: Floats


@functools.lru_cache(maxsize=1024)
def surface_of(part: Part, chord_error: float = DETAILED) -> Surface:
    """The surface of a part in its own frame. ``chord_error``: largest distance of a circle from its polygon."""
    pieces: list[tuple[Floats, Tint]] = []
    if part.family == "axles":
        pieces += [(_cross(site), Tint.MAIN) for site in part.sites]
        pieces += [(_solid(solid, chord_error), Tint.MAIN) for solid in part.solids if solid.half[0] > 7]
    else:
        tooth_solids = 1 if part.gears and part.gears[0].form is not GearForm.RACK else 0
        pieces += [(_teeth(gear), Tint.MAIN) for gear in part.gears[:tooth_solids]]
        rubber = 0.0 if part.family == "tyres" else _RUBBER * part.wheel_mm / MM_PER_LDU if part.wheel_mm > 50 else math.inf
        solids = part.solids[tooth_solids:] if part.family == "gears" else part.solids
        visible = _without_hidden(solids, [_solid(solid, chord_error) for solid in solids])
        tints = [Tint.DARK if solid.form is Form.RING and solid.half[0] > rubber else Tint.MAIN for solid in solids]
        pieces += list(zip(visible, tints, strict=True))
        pieces += [(_cross(site), Tint.MAIN) for site in part.sites if site.fit is Fit.AXLE]
    studs = [cylinder(site.centre, site.axis, site.length, _STUD_RADIUS) for site in part.sites if site.fit is Fit.STUD]
    pieces += [(_solid(stud, chord_error), Tint.MAIN) for stud in studs]
    pieces += [(_solid(solid, chord_error), Tint.TURNING) for solid in part.turning]
    pieces += [(_hole(site, chord_error), Tint.DARK) for site in part.holes]
    pieces += [(_solid(collar, chord_error), Tint.MAIN) for collar in _collars(part)]
    pieces += _electric_marks(part, chord_error)
    triangles = np.concatenate([piece for piece, _ in pieces])
    return Surface(triangles, np.concatenate([np.full(len(piece), int(tint)) for piece, tint in pieces]))


def _solid(solid: Solid, chord_error: float) -> Floats:
    sides = circle_sides(solid.half[0], chord_error)
    if solid.form is Form.BOX:
        local = _box(solid.half)
    elif solid.form is Form.CYLINDER:
        local = _revolved([(0, -1), (1, -1), (1, 1), (0, 1)], solid.half[0], solid.half[2], sides)
    elif solid.form is Form.RING:
        inner = solid.half[1] / solid.half[0]
        local = _revolved([(inner, -1), (1, -1), (1, 1), (inner, 1), (inner, -1)], solid.half[0], solid.half[2], sides)
    else:
        angles = [math.pi * step / 10 - math.pi / 2 for step in range(11)]
        local = _revolved([(math.cos(angle), math.sin(angle)) for angle in angles], solid.half[0], solid.half[0], sides)
    faces = _tube_outward(local, solid.half[0], solid.half[1]) if solid.form is Form.RING else _outward(local)
    return np.asarray(faces @ np.array(solid.axes) + np.array(solid.centre))


def _without_hidden(solids: Sequence[Solid], surfaces: list[Floats]) -> list[Floats]:
    """Triangles of each solid's surface [n, 3, 3] without those that others hide.

    A triangle is hidden if there is material on its outer side, or if it lies on the surface of an earlier solid.
    """
    visible = []
    for number, triangles in enumerate(surfaces):
        outer, inner = (offset_points(triangles, distance).reshape(-1, 3) for distance in (_OFFSET, -_OFFSET))
        covered, duplicate = np.zeros(len(outer), dtype=bool), np.zeros(len(outer), dtype=bool)
        for other, solid in enumerate(solids):
            if other != number:
                covered |= solid.contains(outer, 0.0)
            if other < number:
                duplicate |= solid.contains(inner, 0.0)
        hidden = covered.reshape(-1, 4).all(axis=1) | duplicate.reshape(-1, 4).all(axis=1)
        visible.append(triangles[~hidden])
    return visible


def offset_points(triangles: Floats, distance: float) -> Floats:
    """Points [n, 4, 3] at a distance from triangles [n, 3, 3], on their outer side: over the middle, and near the corners."""
    centres = triangles.mean(axis=1, keepdims=True)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return np.concatenate([centres, centres + _SPREAD * (triangles - centres)], axis=1) + distance * normals[:, None]


def _outward(triangles: Floats) -> Floats:
    """Triangles of a convex solid around the origin, turned counter-clockwise from outside."""
    return _facing(triangles, triangles.mean(axis=1))


def _tube_outward(triangles: Floats, outer: float, inner: float) -> Floats:
    """Triangles of a tube around the third axis, turned outwards: inside the tube, towards the axis."""
    centres = triangles.mean(axis=1)
    directions = centres * np.array([1.0, 1.0, 0.0])
    directions[np.hypot(centres[:, 0], centres[:, 1]) < (outer + inner) / 2] *= -1.0
    is_end = np.ptp(triangles[:, :, 2], axis=1) < 1e-9
    directions[is_end] = centres[is_end] * np.array([0.0, 0.0, 1.0])
    return _facing(triangles, directions)


def _facing(triangles: Floats, directions: Floats) -> Floats:
    """Triangles turned to face ``directions`` [n, 3]."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_turned = np.einsum("ij,ij->i", normals, directions) < 0.0
    return np.where(is_turned[:, None, None], triangles[:, ::-1], triangles)


def _box(half: tuple[float, float, float]) -> Floats:
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return _outward(np.array([corners[[a, b, c]] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]))


def _revolved(profile: list[tuple[float, float]], radius: float, half: float, sides: int) -> Floats:
    """Surface of revolution: a profile of (radius, height), each 0..1, around the third axis."""
    angles = np.arange(sides + 1) * 2 * math.pi / sides
    rings = [
        np.column_stack([r * radius * np.cos(angles), r * radius * np.sin(angles), np.full(sides + 1, z * half)])
        for r, z in profile
    ]
    faces = []
    for (low, (low_radius, _)), (high, (high_radius, _)) in itertools.pairwise(zip(rings, profile, strict=True)):
        if low_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        if high_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return np.concatenate(faces)


def _polygon(radius: float, height: float, sides: int) -> Floats:
    """Disc across the third axis."""
    angles = np.arange(sides) * 2 * math.pi / sides
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(sides, height)])
    return np.stack([np.broadcast_to(rim[0], (sides - 2, 3)), rim[1:-1], rim[2:]], axis=1)


def _placed(local: Floats, site_axis: tuple[float, float, float], centre: tuple[float, float, float]) -> Floats:
    return np.asarray(local @ np.array(frame_of(site_axis)) + np.array(centre))


def _cross(site: Site) -> Floats:
    """The two blades of an axle."""
    half = site.length / 2
    blades = np.concatenate([_box((6.0, 2.2, half)), _box((2.2, 6.0, half))])
    return _placed(blades, site.axis, site.centre)


def _hole(site: Site, chord_error: float) -> Floats:
    """Dark shapes at both ends of a hole: discs for pins, crosses for axles."""
    half = site.length / 2 + _DISC_OFFSET
    if site.fit is Fit.HOLE:
        discs = [_polygon(6.0, z * half, circle_sides(6.0, chord_error)) for z in (-1.0, 1.0)]
        return _placed(_outward(np.concatenate(discs)), site.axis, site.centre)
    blades = np.concatenate([_box((6.0, 2.0, half)), _box((2.0, 6.0, half))])
    return _placed(blades, site.axis, site.centre)


def _collars(part: Part) -> list[Solid]:
    """The rims of a pin, one module from its ends."""
    collars = []
    for site in part.sites:
        if site.fit in (Fit.PIN, Fit.FRICTION_PIN) and part.family == "pins":
            ends = (0.0,) if site.length <= 40 else (-10.0, 10.0)
            axis = np.array(site.axis)
            collars += [
                Solid(Form.CYLINDER, triple(np.array(site.centre) + axis * end), (7.8, 7.8, 1.2), frame_of(site.axis))
                for end in ends
            ]
    return collars


def _teeth(gear: Gear) -> Floats:
    """The outline of a gear with its teeth, extruded along its axis."""
    count, pitch = max(gear.teeth, 8), max(gear.pitch_radius, 10.0)
    high, low = pitch + _TOOTH_HEIGHT, pitch - _TOOTH_HEIGHT - 0.6
    steps = [(low, 0.0), (low, 0.45), (high, 0.62), (high, 0.88)]
    outline = np.array(
        [
            (radius * math.cos(angle), radius * math.sin(angle))
            for tooth in range(count)
            for radius, share in steps
            for angle in (2 * math.pi * (tooth + share) / count,)
        ]
    )
    half = gear.width / 2
    after = np.roll(outline, -1, axis=0)
    faces = []
    for z in (-half, half):
        level = np.full((len(outline), 1), z)
        middle = np.column_stack([np.zeros((len(outline), 2)), level])
        cap = np.stack([middle, np.hstack([outline, level]), np.hstack([after, level])], axis=1)
        faces.append(cap if z > 0 else cap[:, ::-1])
    down, up = np.full((len(outline), 1), -half), np.full((len(outline), 1), half)
    faces.append(np.stack([np.hstack([outline, down]), np.hstack([after, down]), np.hstack([after, up])], axis=1))
    faces.append(np.stack([np.hstack([outline, down]), np.hstack([after, up]), np.hstack([outline, up])], axis=1))
    return _placed(np.concatenate(faces), gear.axis, gear.centre)


def _electric_marks(part: Part, chord_error: float) -> list[tuple[Floats, Tint]]:
    """Marks on electric parts: a hub's display, button and ports, the eyes of a sensor."""
    device = part.device
    if device is None:
        return []
    low, high = part.bounds
    pieces: list[tuple[Floats, Tint]] = []
    sides = [np.array(port) for _, port in device.ports if abs(port[0]) > 45]
    pieces += [(_box((1.0, 8.0, 15.5)) + port + np.array([-0.7 * np.sign(port[0]), 0.0, 0.0]), Tint.FACE) for port in sides]
    if device.ports:
        top, middle, length = low[1], (low + high) / 2, high[2] - low[2]
        button = (float(middle[0]), float(top), float(middle[2] - 0.3 * length))
        pieces.append((_box((40.0, 0.5, 40.0)) + np.array([middle[0], top, middle[2] + 0.18 * length]), Tint.FACE))
        pieces.append((_placed(_disc(16.0, chord_error), (0.0, -1.0, 0.0), button), Tint.TURNING))
    if device.kind is DeviceKind.SENSOR and device.direction is not None and part.sites:
        eyes = (-35.0, 35.0) if high[0] > 60 else (0.0,)
        eye, y = _disc(22.0, chord_error), float(low[1] + high[1]) / 2
        pieces += [(_placed(eye, device.direction, (x, y, float(low[2]))), Tint.FACE) for x in eyes]
    return pieces


def _disc(radius: float, chord_error: float) -> Floats:
    return _outward(_revolved([(0, 1), (1, 1)], radius, 0.6, circle_sides(radius, chord_error)))


Pixels = NDArray[np.uint8]
Ints = NDArray[np.int64]
_SCALE = 2
"""Supersampling per axis."""
_LIGHT = np.array([-0.35, -0.85, -0.40])
_FADED = 0.72
_EDGE, _FADED_EDGE = 0.12, 0.62
_GHOST = (0.93, 0.38, 0.08)
_EMPTY = np.iinfo(np.int64).max


@dataclass(frozen=True)
class View:
    """An orthographic view.

    Attributes:
        turn_deg: azimuth, 0 from the front (+z), positive from the robot's left.
        tilt_deg: elevation; negative from below.
    """

    turn_deg: float
    tilt_deg: float

    @property
    def axes(self) -> Floats:
        """Rows right, down, away from the viewer [3, 3], in the plan's frame."""
        turn, tilt = math.radians(self.turn_deg), math.radians(self.tilt_deg)
        away = -np.array([-math.sin(turn) * math.cos(tilt), -math.sin(tilt), math.cos(turn) * math.cos(tilt)])
        right = np.cross([0.0, 1.0, 0.0], away)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(away, right), away])


VIEWS = tuple(View(turn, tilt) for tilt in (28.0, -28.0) for turn in (40.0, -40.0, 140.0, -140.0))
"""The first is the default."""


class Canvas:
    """A picture with a depth buffer.

    Args:
        size: width and height in pixels.
        fitted: parts that must fit into the picture.
        drawn: parts to draw at once.
        max_zoom: points per LDU.
    """

    def __init__(
        self,
        size: tuple[int, int],
        view: View,
        fitted: Sequence[Placed],
        drawn: Iterable[Placed] = (),
        max_zoom: float = math.inf,
    ) -> None:
        self.size, self._axes = size, view.axes
        self._width, self._height = size[0] * _SCALE, size[1] * _SCALE
        boxes = [placed.to_plan(np.array(list(itertools.product(*np.stack(placed.part.bounds).T)))) for placed in fitted]
        corners = [self._axes @ box.T for box in boxes]
        low = np.min([corner.min(axis=1) for corner in corners], axis=0)
        high = np.max([corner.max(axis=1) for corner in corners], axis=0)
        span = np.maximum(high - low, 1.0)
        self.zoom = min(max_zoom, 0.94 * min(self._width / span[0], self._height / span[1]))
        """Points per LDU."""
        self._middle = (low + high) / 2
        self._near, self._deep = float(low[2]) - 1.0, float(span[2]) + 2.0
        self._keys = np.full(self._width * self._height, _EMPTY, dtype=np.int64)
        self._owners: list[Ints] = []
        self._normals: list[Floats] = []
        self._colours: list[Floats] = []
        self._count = 0
        for placed in drawn:
            self.add(placed)

    def add(self, placed: Placed) -> None:
        """Draw a part."""
        surface = surface_of(placed.part)
        triangles = placed.to_plan(surface.triangles.reshape(-1, 3)) @ self._axes.T
        corners = ((triangles - self._middle) * self.zoom).reshape(-1, 3, 3)
        corners[..., 0] += self._width / 2
        corners[..., 1] += self._height / 2
        flat = triangles.reshape(-1, 3, 3)
        normals = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        normals *= -np.sign(normals[:, 2:] + 1e-12)
        main = np.array(colour_of(placed.colour).rgb)
        palette = np.stack([main if tint is Tint.MAIN else np.array(TINTS[tint]) for tint in Tint])
        depth = (triangles[:, 2].reshape(-1, 3) - self._near) / self._deep
        self._draw(corners[..., :2], depth, self._count)
        self._owners.append(np.full(len(flat), placed.index, dtype=np.int64))
        self._normals.append(normals)
        self._colours.append(palette[surface.tints.astype(int)])
        self._count += len(flat)

    def _draw(self, corners: Floats, depth: Floats, first: int) -> None:
        """Fill triangles [n, 3, 2] with depths [n, 3], 0 near to 1 far, row by row."""
        low = np.clip(np.ceil(corners[..., 1].min(axis=1) - 0.5), 0, self._height).astype(int)
        high = np.clip(np.ceil(corners[..., 1].max(axis=1) - 0.5), 0, self._height).astype(int)
        owner, row = _ranges(low, high)
        left, right = _spans(corners[owner], np.asarray(row + 0.5, dtype=np.float64))
        start = np.clip(np.ceil(left - 0.5), 0, self._width).astype(int)
        end = np.clip(np.ceil(right - 0.5), 0, self._width).astype(int)
        span, x = _ranges(start, end)
        owner, y = owner[span], row[span]
        slope_x, slope_y = _gradients(corners, depth)
        depths = depth[owner, 0] + slope_x[owner] * (x + 0.5 - corners[owner, 0, 0])
        depths += slope_y[owner] * (y + 0.5 - corners[owner, 0, 1])
        keys = (np.clip(depths, 0, 1) * (1 << 30)).astype(np.int64) << 24 | (first + owner)
        np.minimum.at(self._keys, y * self._width + x, keys)

    def visible(self, parts: set[int]) -> int:
        """Number of points that show one of these parts."""
        owners = self._visible_parts()[0]
        return int(np.isin(owners, list(parts)).sum())

    def _visible_parts(self) -> tuple[Ints, Ints]:
        """Index of the visible part (-1 for none) and of its triangle at each point."""
        is_empty = self._keys == _EMPTY
        triangles = np.where(is_empty, 0, self._keys & ((1 << 24) - 1))
        owners = np.concatenate(self._owners)[triangles] if self._owners else np.full_like(triangles, -1)
        return np.where(is_empty, -1, owners), triangles

    def pixel_of(self, points: Floats) -> Floats:
        """Pixels [n, 2] (from the left, from the top) of points [n, 3] of the plan."""
        pixels = (points @ self._axes.T - self._middle)[:, :2] * self.zoom
        return np.asarray((pixels + np.array([self._width, self._height]) / 2) / _SCALE)

    def picture(self, bright: set[int] | None = None, ghosts: Sequence[Canvas] = ()) -> Pixels:
        """The picture [height, width, 3].

        Args:
            bright: parts in full colour, the others faded; ``None`` fades none.
            ghosts: canvases of the same view; their parts are outlined where they are hidden.
        """
        owners, triangles = self._visible_parts()
        if not self._owners:
            return np.full((self.size[1], self.size[0], 3), 255, dtype=np.uint8)
        normals, colours = np.concatenate(self._normals)[triangles], np.concatenate(self._colours)[triangles]
        light = self._axes @ (_LIGHT / np.linalg.norm(_LIGHT))
        shade = 0.62 + 0.38 * np.clip(normals @ light, -1, 1)
        image = np.clip(colours * shade[:, None], 0, 1)
        is_empty = owners < 0
        faded = np.zeros(len(owners), dtype=bool) if bright is None else ~np.isin(owners, list(bright))
        image[faded] = _FADED * 0.96 + (1 - _FADED) * image[faded]
        image[is_empty] = 1.0
        edge = self._edges(owners, normals)
        image[edge] = np.where(faded[edge][:, None], _FADED_EDGE, _EDGE)
        for ghost in ghosts:
            others, triangles = ghost._visible_parts()
            outline = ghost._edges(others, np.concatenate(ghost._normals)[triangles])
            image[outline & (others >= 0) & (owners != others)] = _GHOST
        full = image.reshape(self.size[1], _SCALE, self.size[0], _SCALE, 3).mean(axis=(1, 3))
        return np.asarray(np.round(full * 255), dtype=np.uint8)

    def _edges(self, owners: Ints, normals: Floats) -> Bools:
        """Points at the border of a part, at a fold or at a jump in depth."""
        shape = (self._height, self._width)
        owner, normal = owners.reshape(shape), normals.reshape(*shape, 3)
        depth = np.where(self._keys == _EMPTY, 0, self._keys >> 24).reshape(shape) / (1 << 30) * self._deep
        edge = np.zeros(shape, dtype=bool)
        for axis in (0, 1):
            first = (slice(None), slice(None, -1)) if axis else (slice(None, -1), slice(None))
            second = (slice(None), slice(1, None)) if axis else (slice(1, None), slice(None))
            differs = owner[first] != owner[second]
            folds = np.einsum("ijk,ijk->ij", normal[first], normal[second]) < 0.80
            jumps = np.abs(depth[first] - depth[second]) > 5.0
            edge[first] |= differs | ((folds | jumps) & (owner[first] >= 0))
        return np.asarray(edge.ravel())


def _ranges(low: Ints, high: Ints) -> tuple[Ints, Ints]:
    """All integers of the ranges ``low`` to ``high`` (exclusive) [n], each with the index of its range before it."""
    counts = np.maximum(high - low, 0)
    owner = np.repeat(np.arange(len(counts)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    return owner, np.arange(len(owner)) - first + low[owner]


def _spans(corners: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Ends, left and right, of triangles [n, 3, 2] in the rows at heights ``y`` [n]."""
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for k in range(3):
        (ax, ay), (bx, by) = corners[:, k].T, corners[:, (k + 1) % 3].T
        rise = by - ay
        share = (y - ay) / np.where(np.abs(rise) < 1e-9, 1.0, rise)
        meets = (share >= 0) & (share <= 1) & (np.abs(rise) >= 1e-9)
        x = ax + share * (bx - ax)
        left, right = np.where(meets, np.minimum(left, x), left), np.where(meets, np.maximum(right, x), right)
    is_empty = ~np.isfinite(left)
    return np.where(is_empty, 0.0, left), np.where(is_empty, 0.0, right)


def _gradients(corners: Floats, depth: Floats) -> tuple[Floats, Floats]:
    """Gradients of depths [n, 3] over triangles [n, 3, 2]; 0 for triangles seen edge-on."""
    (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    du, dv = depth[:, 1] - depth[:, 0], depth[:, 2] - depth[:, 0]
    area = ux * vy - uy * vx
    is_flat = np.abs(area) < 1e-6
    area = np.where(is_flat, 1.0, area)
    slope_x, slope_y = (du * vy - dv * uy) / area, (dv * ux - du * vx) / area
    return np.where(is_flat, 0.0, slope_x), np.where(is_flat, 0.0, slope_y)


def draw(parts: Sequence[Placed], size: tuple[int, int]) -> Pixels:
    """A picture [height, width, 3] of parts."""
    return Canvas(size, VIEWS[0], parts, parts).picture()
