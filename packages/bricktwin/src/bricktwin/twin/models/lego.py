"""Meshes of LEGO parts, from our own dimensions in millimetres or from an installed LDraw library. Looks only, without mass.

A :class:`Shape` is a triangle mesh, a :class:`Piece` a set of coloured shapes; :func:`draw` merges the parts of a body into one
mesh per colour, which keeps rendering fast. A part of a library is rotated into our part's frame and centred on it; if its size
differs too much, ours is drawn.
"""

from __future__ import annotations

import functools
import itertools
import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.plans.geometry import MM_PER_LDU, Floats, Triple, circle_sides, rotation
from bricktwin.twin import ldraw
from bricktwin.twin.models.mjcf import LOOKS_GROUP

_CHORD_ERROR_MM = 0.12
"""Less than a pixel of the cameras, which are half a metre away."""

X_AXIS, Y_AXIS, Z_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Shape:
    """Triangle mesh with smooth normals.

    Attributes:
        points: [n, 3] in mm.
        normals: [n, 3], of length 1.
        faces: [m, 3] indices of points, counter-clockwise seen from outside.
    """

    points: Floats
    normals: Floats
    faces: NDArray[np.int32]

    def at(self, x: float, y: float, z: float) -> Shape:
        """The shape, translated."""
        return Shape(self.points + np.array([x, y, z]), self.normals, self.faces)

    def turned(self, axis: Triple, angle_deg: float) -> Shape:
        """The shape, rotated about an axis through the origin."""
        turn = rotation(axis, math.radians(angle_deg))
        return Shape(self.points @ turn.T, self.normals @ turn.T, self.faces)

    def along(self, axis: Triple) -> Shape:
        """The shape, rotated so that its z axis points along another axis."""
        if axis == X_AXIS:
            return self.turned(Y_AXIS, 90.0)
        if axis == Y_AXIS:
            return self.turned(X_AXIS, -90.0)
        return self


def box(length: float, width: float, height: float, radius: float = 0.6, arc: int = 2) -> Shape:
    """Box along x, y, z with rounded edges, centred: a sphere whose octants are moved to the corners."""
    half = np.array([length, width, height]) / 2 - radius
    quarter = np.linspace(0.0, math.pi / 2, arc + 1)
    polar = np.concatenate([quarter, quarter + math.pi / 2])
    azimuth = np.concatenate([quarter + quadrant * math.pi / 2 for quadrant in range(4)])
    signs_z = np.repeat([1.0, -1.0], arc + 1)
    signs_x, signs_y = np.repeat([1.0, -1.0, -1.0, 1.0], arc + 1), np.repeat([1.0, 1.0, -1.0, -1.0], arc + 1)
    rows, columns = len(polar), len(azimuth)
    normals = np.empty((rows, columns, 3))
    normals[..., 0] = np.sin(polar)[:, None] * np.cos(azimuth)
    normals[..., 1] = np.sin(polar)[:, None] * np.sin(azimuth)
    normals[..., 2] = np.cos(polar)[:, None]
    corners = np.stack(np.broadcast_arrays(signs_x, signs_y, signs_z[:, None]), axis=-1)
    points = corners * half + radius * normals
    corner_columns = np.arange(4) * (arc + 1)
    caps = [_fan(corner_columns), _fan((rows - 1) * columns + corner_columns[::-1])]
    return Shape(points.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate([_grid(rows, columns), *caps]))


def block(length: float, width: float, height: float) -> Shape:
    """Box along x, y, z with sharp edges, centred: for small parts, at a tenth of the faces of a rounded one."""
    corners = np.array([[x, y, z] for z in (-1.0, 1.0) for x, y in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))])
    sides = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    normals = corners[sides].mean(axis=1)
    faces = np.concatenate([_fan(np.arange(4) + 4 * side) for side in range(6)])
    return Shape(corners[sides].reshape(-1, 3) * np.array([length, width, height]) / 2, np.repeat(normals, 4, axis=0), faces)


def turned(profile: Sequence[tuple[float, float]]) -> Shape:
    """Solid of revolution about z. ``profile``: (radius, z) from the top of the axis outwards and down to its bottom; all edges
    are sharp."""
    segments = circle_sides(max(radius for radius, _ in profile), _CHORD_ERROR_MM)
    parts, angles = [], np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    for (radius_0, z_0), (radius_1, z_1) in itertools.pairwise(profile):
        slope = np.array([z_0 - z_1, radius_1 - radius_0])
        across, up = slope / max(float(np.hypot(*slope)), 1e-9)
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        points, normals = np.empty((2, segments, 3)), np.empty((2, segments, 3))
        for row, (radius, z) in enumerate(((radius_0, z_0), (radius_1, z_1))):
            points[row, :, :2], points[row, :, 2] = radius * rim, z
        normals[..., :2], normals[..., 2] = across * rim, up
        left, right = np.split(_grid(2, segments), 2)
        faces = [left] * (radius_1 > 0) + [right] * (radius_0 > 0)  # on the axis, triangles have no area
        parts.append(Shape(points.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(faces)))
    return merge(parts)


def cylinder(radius: float, length: float, bevel: float = 0.0) -> Shape:
    """Disc or rod along z, centred."""
    half = length / 2
    edge = [(radius - bevel, half), (radius, half - bevel), (radius, bevel - half), (radius - bevel, -half)]
    return turned([(0.0, half), *(edge if bevel else [edge[0], edge[2]]), (0.0, -half)])


def discs(radius: float, distance: float, segments: int = 10) -> Shape:
    """The two ends of a cylinder along z, centred: the visible part of a hole."""
    angles = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    ends = []
    for up in (1.0, -1.0):
        points = np.stack([radius * np.cos(angles), up * radius * np.sin(angles), np.full(segments, up * distance / 2)], axis=-1)
        ends.append(Shape(points, np.tile((0.0, 0.0, up), (segments, 1)), _fan(np.arange(segments))))
    return merge(ends)


def ring(outer: float, inner: float, length: float) -> Shape:
    """Flat ring along z, centred."""
    half, bevel = length / 2, min(0.6, length / 4)
    edge = [(outer - bevel, half), (outer, half - bevel), (outer, bevel - half), (outer - bevel, -half)]
    return turned([(inner, -half), (inner, half), *edge, (inner, -half)])


def extruded(outline: Floats, height: float, bevel: float = 0.4) -> Shape:
    """Convex outline [n, 2] in x, y, counter-clockwise, extruded along z, centred, with bevelled edges."""
    edges = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    outwards = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    inner, half, count = outline - bevel * outwards, height / 2, len(outline)
    rings = [(inner, half), (outline, half - bevel), (outline, bevel - half), (inner, -half)]
    levels = np.stack([np.column_stack([points, np.full(count, z)]) for points, z in rings])
    side = np.column_stack([outwards, np.zeros(count)])
    shapes = []
    for row, tilt in ((0, 1.0), (1, 0.0), (2, -1.0)):
        normal = (side + np.array([0.0, 0.0, tilt])) / math.hypot(1.0, tilt)
        shapes.append(Shape(levels[row : row + 2].reshape(-1, 3), np.concatenate([normal, normal]), _grid(2, count)))
    for row, up in ((0, 1.0), (3, -1.0)):
        order = np.arange(count) if up > 0 else np.arange(count)[::-1]
        shapes.append(Shape(levels[row], np.tile((0.0, 0.0, up), (count, 1)), _fan(order)))
    return merge(shapes)


def rounded_rectangle(length: float, width: float, radius: float) -> Floats:
    """Outline [n, 2] of a rectangle along x, y with round corners, counter-clockwise."""
    arc = -(-circle_sides(radius, _CHORD_ERROR_MM) // 4)
    angles = np.concatenate([np.linspace(0.0, math.pi / 2, arc + 1) + quadrant * math.pi / 2 for quadrant in range(4)])
    signs = np.repeat([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)], arc + 1, axis=0)
    corners = signs * np.array([length / 2 - radius, width / 2 - radius])
    outline: Floats = corners + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return outline


def tube(points: Sequence[Triple], radius: float, steps: int = 14, segments: int = 8) -> Shape:
    """Tube along a Bezier curve with these control points."""
    order, t = len(points) - 1, np.linspace(0.0, 1.0, steps)[:, None]
    path = sum(math.comb(order, i) * t**i * (1 - t) ** (order - i) * np.array(point) for i, point in enumerate(points))
    direction = np.gradient(np.asarray(path), axis=0)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    first = np.empty_like(direction)
    across = np.cross(direction[0], Z_AXIS if abs(direction[0, 2]) < 0.9 else X_AXIS)
    for step, ahead in enumerate(direction):  # the section must not turn about the path
        across = across - (across @ ahead) * ahead
        first[step] = across = across / np.linalg.norm(across)
    second = np.cross(direction, first)
    angles = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    normals = np.cos(angles)[None, :, None] * first[:, None] + np.sin(angles)[None, :, None] * second[:, None]
    surface = np.asarray(path)[:, None] + radius * normals
    return Shape(surface.reshape(-1, 3), normals.reshape(-1, 3), _grid(steps, segments)[:, ::-1])


def merge(shapes: Sequence[Shape]) -> Shape:
    """Merge several shapes into one."""
    offsets = np.cumsum([0, *(len(shape.points) for shape in shapes[:-1])])
    return Shape(
        np.concatenate([shape.points for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
        np.concatenate([shape.faces + offset for shape, offset in zip(shapes, offsets, strict=True)]).astype(np.int32),
    )


@dataclass(frozen=True)
class Piece:
    """LEGO part: shapes, each with the name of its colour."""

    shapes: tuple[tuple[str, Shape], ...]

    def at(self, x: float, y: float, z: float) -> Piece:
        """The part, translated."""
        return Piece(tuple((colour, shape.at(x, y, z)) for colour, shape in self.shapes))

    def turned(self, axis: Triple, angle_deg: float) -> Piece:
        """The part, rotated about an axis through the origin."""
        return Piece(tuple((colour, shape.turned(axis, angle_deg)) for colour, shape in self.shapes))


def colour_name(rgba: Iterable[float]) -> str:
    """Name ``"#rrggbbaa"`` of a colour, from red, green, blue and opacity in 0..1; opaque by default."""
    return f"#{''.join(f'{round(255 * value):02x}' for value in rgba):f<8}"


def draw(spec: mujoco.MjSpec, body: mujoco.MjsBody, parts: Sequence[Piece]) -> None:
    """Draw parts, given in millimetres in the body's frame: one mesh per colour, without mass or contact.

    The model's materials have the names of the colours; the material of a colour ``"#rrggbbaa"`` is created here.
    """
    by_colour: dict[str, list[Shape]] = {}
    for part in parts:
        for colour, shape in part.shapes:
            by_colour.setdefault(colour, []).append(shape)
    for colour, shapes in by_colour.items():
        if colour.startswith("#") and spec.material(colour) is None:
            rgba = [value / 255 for value in bytes.fromhex(colour[1:])]
            spec.add_material(name=colour, rgba=rgba, specular=0.35, shininess=0.5)
        shape, name = merge(shapes), f"{body.name}_{colour}"
        spec.add_mesh(
            name=name,
            uservert=(shape.points / 1000).ravel().tolist(),
            usernormal=shape.normals.ravel().tolist(),
            userface=shape.faces.ravel().tolist(),
            userfacenormal=shape.faces.ravel().tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=colour, group=LOOKS_GROUP, mass=0, contype=0, conaffinity=0
        )


def _grid(rows: int, columns: int) -> NDArray[np.int32]:
    """Faces of a grid of points whose columns form a closed ring; seen from outside, rows go down and columns to the left."""
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a = (row * columns + column).ravel()
    b = (row * columns + (column + 1) % columns).ravel()
    c, d = a + columns, b + columns
    return np.concatenate([np.stack([a, c, d], -1), np.stack([a, d, b], -1)]).astype(np.int32)


def _fan(indices: NDArray[np.intp]) -> NDArray[np.int32]:
    """Faces of a convex polygon."""
    first = np.full(len(indices) - 2, indices[0])
    return np.stack([first, indices[1:-1], indices[2:]], -1).astype(np.int32)


_log = logging.getLogger(__name__)
_SHARP = np.cos(np.radians(38.0))
"""Cosine of the smallest angle between two faces whose edge is drawn sharp."""
_SIZE_MM, _SIZE_RATIO = 6.0, 0.15


HUB_AXES, MOTOR_AXES, SONAR_AXES, WHEEL_AXES = (3, -1, -2), (-3, -2, -1), (-3, 1, -2), (-1, -3, -2)
"""Signed axes of an LDraw file that are our x, y and z (1 is the file's x)."""
_LIBRARY_PARTS = {
    "hub": (("67718p01.dat", "67718.dat"), HUB_AXES),
    "motor": (("u9364c02.dat", "54696p02.dat"), MOTOR_AXES),
    "ultrasonic": (("37316.dat",), SONAR_AXES),
    "wheel": (("39367p02.dat", "39367p01.dat"), WHEEL_AXES),
    "beam 9": (("40490.dat",), (3, -1, -2)),
    "beam 13": (("41239.dat",), (3, -1, -2)),
}
"""LDraw files of our parts, the best first, and their axes."""


def from_library(kind: str, colour: str, fallback: Piece) -> Piece:
    """The part from the installed LDraw library, with ``colour`` as its main colour; ``fallback`` if it has none."""
    root, (files, axes) = ldraw.folder(), _LIBRARY_PARTS.get(kind, ((), HUB_AXES))
    if root is None:
        return fallback
    points = np.concatenate([shape.points for _, shape in fallback.shapes])
    low, high = points.min(axis=0), points.max(axis=0)
    for name in files:
        try:
            shapes = _shapes(root, name, axes)
        except TwinError as error:
            _log.debug("%s", error)
            continue
        library_points = np.concatenate([shape.points for _, shape in shapes])
        library_low, library_high = library_points.min(axis=0), library_points.max(axis=0)
        size = high - low
        if np.any(np.abs((library_high - library_low) - size) > _SIZE_MM + _SIZE_RATIO * size):
            _log.warning("'%s' of the LDraw library in %s has an unknown size; drawing our own", name, root)
            continue
        x, y, z = ((low + high) - (library_low + library_high)) / 2
        return Piece(tuple((name or colour, shape) for name, shape in shapes)).at(float(x), float(y), float(z))
    return fallback


@functools.lru_cache(maxsize=64)
def _shapes(root: Path, name: str, axes: tuple[int, int, int]) -> tuple[tuple[str, Shape], ...]:
    """Shapes of a library part in mm and our axes, by colour name ("" for the main colour)."""
    shapes = library_shapes(root, name, signed_axes(axes) * MM_PER_LDU)
    if not shapes:
        raise TwinError(f"'{name}' of the LDraw library in {root} has no surface; reinstall the library")
    return shapes


def signed_axes(axes: tuple[int, int, int]) -> Floats:
    """Matrix [3, 3] that turns another frame's points into ours, from the signed axes there that are our x, y and z."""
    turn = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        turn[row, abs(axis) - 1] = np.sign(axis)
    return turn


def library_shapes(root: Path, name: str, turn: Floats) -> tuple[tuple[str, Shape], ...]:
    """Shapes of a part in an LDraw library, turned by a matrix [3, 3], by colour name ("" for the main colour). Raises TwinError
    if the library does not have the part."""
    library = ldraw.library(root)
    shapes = {code: shape_of(triangles @ turn.T) for code, triangles in library.part(name).items()}
    names = {code: "" if code == ldraw.MAIN_COLOUR else colour_name(library.rgba(code)) for code in shapes}
    return tuple((names[code], shape) for code, shape in shapes.items() if shape is not None)


def shape_of(triangles: Floats) -> Shape | None:
    """Mesh of triangles [n, 3, 3], smooth where they meet at small angles; ``None`` if none has an area."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1)
    triangles, cross, area = triangles[area > 1e-6], cross[area > 1e-6], area[area > 1e-6]
    if not len(triangles):
        return None
    points = triangles.reshape(-1, 3)
    flat = np.repeat(cross / area[:, None], 3, axis=0)
    _, corner = np.unique(np.round(points, 3), axis=0, return_inverse=True)
    mean = np.zeros((corner.max() + 1, 3))
    np.add.at(mean, corner.ravel(), np.repeat(cross, 3, axis=0))
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    smooth = (mean / np.maximum(length, 1e-12))[corner.ravel()]
    is_smooth = np.einsum("ij,ij->i", smooth, flat) > _SHARP
    faces: NDArray[np.int32] = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Shape(points, np.where(is_smooth[:, None], smooth, flat), faces)


MODULE = 8.0
COLOURS: dict[str, tuple[float, float, float]] = {
    "white": (0.93, 0.93, 0.92),
    "light_grey": (0.66, 0.68, 0.70),
    "dark_grey": (0.33, 0.35, 0.37),
    "black": (0.09, 0.09, 0.10),
    "turquoise": (0.02, 0.60, 0.62),
    "yellow": (1.00, 0.78, 0.10),
    "blue": (0.10, 0.36, 0.75),
    "dim": (0.24, 0.25, 0.27),
    "glow": (1.00, 0.95, 0.70),
    "azure": (0.35, 0.80, 0.95),
    "red": (0.85, 0.03, 0.03),
}
_GLOWING = {"glow", "azure"}
_HEART = (".#.#.", "#####", "#####", ".###.", "..#..")


def add_colours(spec: mujoco.MjSpec) -> None:
    """Add materials for all colours."""
    for name, rgb in COLOURS.items():
        emission = 0.6 if name in _GLOWING else 0.0
        spec.add_material(name=name, rgba=[*rgb, 1.0], specular=0.35, shininess=0.5, emission=emission)


def beam(holes: int, colour: str) -> Piece:
    """Technic beam along x with its holes along z, centred."""
    length = holes * MODULE
    bar = extruded(rounded_rectangle(length - 0.2, 7.6, 3.2), 7.4, bevel=0.5)
    centres = [(index - (holes - 1) / 2) * MODULE for index in range(holes)]
    part = Piece(((colour, bar), ("dim", merge([discs(2.5, 7.5).at(x, 0, 0) for x in centres]))))
    return from_library(f"beam {holes}", colour, part)


def hub() -> Piece:
    """Prime hub lying flat, 88 x 56 x 32, USB port towards +x, centred."""
    upper = box(88, 56, 22, radius=2.5).at(0, 0, 5)
    lower = box(86, 54.5, 11, radius=1.5).at(0, 0, -10.5)
    window = extruded(rounded_rectangle(33, 33, 3), 0.8).at(17, 0, 16)
    lit: list[Shape] = []
    unlit: list[Shape] = []
    for row, line in enumerate(_HEART):
        for column, mark in enumerate(line):
            pixel = block(4.8, 4.8, 1.0).at(17 + (2 - row) * 6, (2 - column) * 6, 16.2)
            (lit if mark == "#" else unlit).append(pixel)
    button = cylinder(6.6, 2.0, bevel=0.6).at(-20, 0, 16.4)
    light = ring(9.4, 6.6, 1.2).at(-20, 0, 16.1)
    steering = [box(9, 7, 1.4, radius=0.5).at(-20, side * 17, 16.1) for side in (1, -1)]
    bluetooth = cylinder(3.4, 1.2, bevel=0.4).at(36, -20, 16.2)
    ports = [box(15, 1.2, 8.5, radius=0.5, arc=1).at(x, side * 27.8, 5) for x in (26, 0, -26) for side in (1, -1)]
    usb = box(1.2, 9, 3.6, radius=0.5, arc=1).at(43.8, 0, 5)
    holes = [discs(2.5, 55.2).along(Y_AXIS).at(x, 0, -10.5) for x in (-32, -24, -16, 16, 24, 32)]
    speaker = [discs(1.0, 88.4, 6).along(X_AXIS).at(-0.1, y, z) for y in (-8, -4, 0, 4, 8) for z in (3, 7)]
    part = Piece(
        (
            ("white", merge([upper, button, *steering])),
            ("turquoise", lower),
            ("black", merge([window, *ports, usb])),
            ("dim", merge([*unlit, *holes, *speaker])),
            ("glow", merge(lit)),
            ("azure", merge([light, bluetooth])),
        )
    )
    return from_library("hub", "white", part)


def medium_motor() -> Piece:
    """Medium motor along x, 72 long, its outputs towards +y and -y, 24 from the front; origin on the outputs' axis."""
    return Piece((*medium_motor_case(31.0).shapes, ("dark_grey", cylinder(10.8, 33.0, bevel=0.6).along(Y_AXIS))))


def medium_motor_case(width: float = 23.8) -> Piece:
    """Medium motor without its outputs."""
    front = extruded(rounded_rectangle(24, 24, 11.0), width, bevel=1.0).along(Y_AXIS)
    housing = box(52, width, 23.6, radius=2.2).at(-26, 0, 0)
    cap = box(16, width + 1, 24.4, radius=2.2).at(-53, 0, 0)
    stripe = box(26, width + 1, 6, radius=0.8).at(-28, 0, 3)
    holes = [discs(2.5, width + 1.2).along(Y_AXIS).at(x, 0, -7) for x in (-16, -40)]
    part = Piece((("white", merge([front, housing])), ("dark_grey", cap), ("light_grey", stripe), ("dim", merge(holes))))
    return from_library("motor", "white", part)


def axle(length: float) -> Piece:
    """A cross axle along y, centred."""
    blades = [box(4.6, length, 1.8, radius=0.4, arc=1), box(1.8, length, 4.6, radius=0.4, arc=1)]
    return Piece((("dark_grey", merge(blades)),))


def wheel(diameter: float) -> Piece:
    """A wheel with a black tyre on a light six-spoked rim, axis along y, centred."""
    outer, inner = diameter / 2, diameter / 2 - 7.5
    half = [(inner, 6.2), (outer - 3.4, 7.0), (outer - 1.0, 5.6), (outer - 0.3, 3.0)]
    tyre = turned([*half, *((radius, -y) for radius, y in reversed(half)), half[0]])
    treads = [block(1.9, 2.2, 11.6).at(outer - 0.95, 0, 0).turned(Z_AXIS, 15 * step) for step in range(24)]
    rim = [ring(inner, inner - 3.2, 12.6), cylinder(6.4, 13, bevel=0.8)]
    spokes = [box(inner - 5, 4.2, 9.4, radius=0.8).at((inner + 3) / 2, 0, 0).turned(Z_AXIS, 60 * step) for step in range(6)]
    shade = cylinder(inner - 1, 3)
    part = Piece(
        (
            ("black", merge([tyre, *treads]).along(Y_AXIS)),
            ("light_grey", merge([*rim, *spokes]).along(Y_AXIS)),
            ("dim", shade.along(Y_AXIS)),
        )
    )
    return from_library("wheel", "light_grey", part)


def ultrasonic_sensor() -> Piece:
    """Ultrasonic sensor facing +x, 24 x 56 x 24, centred."""
    case = box(20, 56, 23.6, radius=2.0).at(-2, 0, 0)
    face = extruded(rounded_rectangle(22.5, 55, 10.5), 4, bevel=0.8).along(X_AXIS).at(9.6, 0, 0)
    rims = [ring(10.2, 7.8, 3.4).along(X_AXIS).at(11.2, side * 15.5, 0) for side in (1, -1)]
    membrane = turned([(0, 1.6), (3.5, 1.2), (7.8, 0), (7.8, -1), (0, -1)]).along(X_AXIS)
    membranes = [membrane.at(11.2, side * 15.5, 0) for side in (1, -1)]
    pupils = [cylinder(2.6, 1.0, bevel=0.3).along(X_AXIS).at(12.6, side * 15.5, 0) for side in (1, -1)]
    part = Piece((("white", merge([case, *rims])), ("black", merge([face, *pupils])), ("dim", merge(membranes))))
    return from_library("ultrasonic", "white", part)


def ball_caster(radius: float) -> Piece:
    """Steel ball in its socket; origin at the centre of the ball."""
    angles = [math.radians(step) for step in range(0, 181, 20)]
    ball = turned([(radius * math.sin(angle), radius * math.cos(angle)) for angle in angles])
    socket = turned([(0, 16), (10, 16), (radius + 3.4, 11), (radius + 3.4, 1), (radius + 2, -1.5), (radius, -1.5), (0, 4)])
    return Piece((("light_grey", ball), ("dark_grey", socket)))


def cable(points: Sequence[Triple]) -> Piece:
    """Black cable of round section along a Bezier curve."""
    return Piece((("black", tube(points, 1.7)),))
