"""Parts of an installed LDraw library in place of our meshes. Looks only: they do not affect the physics.

A part of the library is rotated into our part's frame and centred on it. If its size differs too much, our mesh is kept.
"""

from __future__ import annotations

import functools
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.twin import ldraw
from bricktwin.twin.models.meshes import Piece, Shape, colour_name

_log = logging.getLogger(__name__)
_SHARP = np.cos(np.radians(38.0))
"""Cosine of the smallest angle between two faces whose edge is drawn sharp."""
_SIZE_MM, _SIZE_RATIO = 6.0, 0.15


@dataclass(frozen=True)
class _LibraryPart:
    """LDraw files of a part, the best first, and the signed axes of the file that are our x, y and z (1 is the file's x)."""

    files: tuple[str, ...]
    axes: tuple[int, int, int]


_BEAM = (3, -1, -2)
_LIBRARY_PARTS = {
    "hub": _LibraryPart(("67718p01.dat", "67718.dat"), (3, -1, -2)),
    "motor": _LibraryPart(("u9364c02.dat", "54696p02.dat"), (-3, -2, -1)),
    "ultrasonic": _LibraryPart(("37316.dat",), (-3, 1, -2)),
    "wheel": _LibraryPart(("39367p02.dat", "39367p01.dat"), (-1, -3, -2)),
    "beam 9": _LibraryPart(("40490.dat",), _BEAM),
    "beam 13": _LibraryPart(("41239.dat",), _BEAM),
}


def from_library(kind: str, colour: str, fallback: Piece) -> Piece:
    """The part from the installed LDraw library, with ``colour`` as its main colour; ``fallback`` if it has none."""
    root, library_part = ldraw.folder(), _LIBRARY_PARTS.get(kind)
    if root is None or library_part is None:
        return fallback
    points = np.concatenate([shape.points for _, shape in fallback.shapes])
    low, high = points.min(axis=0), points.max(axis=0)
    for name in library_part.files:
        try:
            shapes = _shapes(root, name, library_part.axes)
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
