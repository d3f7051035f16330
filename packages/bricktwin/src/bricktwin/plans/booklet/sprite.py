"""A part from one direction, drawn once for all of its places: depth, light and lines. LDraw
units."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bricktwin.plans.booklet.rays import (
    Box,
    Ints,
    Reals,
    Window,
    cuts_in,
    first_material,
    grid,
    pixel_box,
    seen,
)
from bricktwin.plans.drawing.looks import Tint, look_of
from bricktwin.plans.geometry import Bools, Form, Solid
from bricktwin.plans.part import Part

JUMP = 5.0
"""Smallest jump in depth that is drawn as a line, LDU."""
_LIGHT = np.array([-0.42, -0.72, -0.55]) / np.linalg.norm([-0.42, -0.72, -0.55])
"""Direction of the light: right, down, away from the viewer."""
_AMBIENT = 0.66
"""Brightness in the shade."""
_DIFFUSE = 0.40
"""Brightness that the light adds where it falls straight on a surface."""
_DARKEST_SIDE = -0.4
"""Cosine below which a surface that is turned away from the light gets no darker."""
_HOLLOW = 0.80
"""Share of the brightness that is left in holes."""
_FOLD = 0.80
"""Cosine of the smallest angle of a fold that is drawn as a line."""
_SAME_PLACE = 1e-3
"""Difference in depth below which two surfaces are in the same place, LDU."""
_FACES = 6
"""Most faces of a solid: those of a box."""
SHADES = 64
"""Steps of brightness, from 0 to the brightest."""
BRIGHTEST = _AMBIENT + _DIFFUSE
LINE = len(Tint) * SHADES
"""Coat of a point on a line of a part."""


class _Source(NamedTuple):
    """A surface that a ray may meet: a solid with its material. ``is_cut`` says that the solid is
    cut out, so that the ray comes out of it."""

    solid: Solid
    tint: Tint
    is_cut: bool


@dataclass(frozen=True)
class Sprite:
    """A part from one direction: its points [h, w] from column and row ``left`` and ``top``,
    relative to the part's origin.

    Attributes:
        depth: distance away from the origin, LDU; infinite where the part is not.
        source: index in ``sources`` of what is seen, -1 where the part is not.
        axes: right, down, away in the part's frame [3, 3].
        zoom: points per LDU.
    """

    left: int
    top: int
    depth: Reals
    source: Ints
    sources: tuple[_Source, ...]
    axes: Reals
    zoom: float

    @cached_property
    def count(self) -> int:
        """Number of points that show the part."""
        return int(np.count_nonzero(self.source >= 0))

    @cached_property
    def coat(self) -> Ints:
        """What its points [h, w] look like: the number of their tint times `SHADES` plus their
        shade, or `LINE`. A picture that only tries a view does without."""
        normals = np.zeros((self.depth.size, 3), dtype=np.float32)
        faces = np.full(self.depth.size, -1, dtype=np.int32)
        coat = np.zeros(self.depth.size, dtype=np.uint16)
        light = _LIGHT.astype(np.float32)
        for number, points in self._points_of_sources():
            solid, tint, is_cut = self.sources[number]
            face, outward = self._normals(solid, points)
            # The surface of a cut is seen from its inside, so its normals are reversed.
            if is_cut:
                outward = -outward
            normals[points] = outward
            faces[points] = face + _FACES * number
            facing = np.maximum(outward @ light, _DARKEST_SIDE)  # [n]
            brightness = (_AMBIENT + _DIFFUSE * facing) * (_HOLLOW if is_cut else 1.0)
            coat[points] = brightness * ((SHADES - 1) / BRIGHTEST) + (tint * SHADES + 0.5)
        shape = self.depth.shape
        is_line = _lines(self.depth, faces.reshape(shape), normals.reshape(*shape, 3))
        coat.reshape(shape)[is_line] = LINE
        return coat.reshape(shape)

    def _points_of_sources(self) -> Iterator[tuple[int, Ints]]:
        """Each source that is seen, with the indices of its points in the flattened arrays."""
        # One sort by source finds the points of all sources; searching the picture for each would
        # take a pass for each.
        covered = np.flatnonzero(self.source >= 0)
        sources = self.source.ravel()[covered]
        order = covered[np.argsort(sources, kind="stable")]
        counts = np.bincount(sources, minlength=len(self.sources))
        ends = np.cumsum(counts)
        for number in np.flatnonzero(counts).tolist():
            yield number, order[ends[number] - counts[number] : ends[number]]

    def _normals(self, solid: Solid, points: Ints) -> tuple[Ints, Reals]:
        """Faces [n] of a solid at these points, and their normals [n, 3] in the view, out of the
        solid."""
        turned, centre = seen(solid, self.axes)
        rows, columns = np.divmod(points, self.depth.shape[1])
        x = (columns + (self.left + 0.5)) / self.zoom
        y = (rows + (self.top + 0.5)) / self.zoom
        in_view = np.stack([x, y, self.depth.ravel()[points]]).astype(np.float32)
        local = turned.astype(np.float32) @ in_view - centre.astype(np.float32)[:, None]  # [3, n]
        axes = turned.astype(np.float32)
        if solid.form is Form.BALL:
            outward = local.T @ axes / np.float32(solid.half[0])
            return np.zeros(len(points), dtype=np.int32), outward
        if solid.form is Form.BOX:
            gaps = np.abs(np.abs(local) - np.array(solid.half, dtype=np.float32)[:, None])
            axis = np.argmin(gaps, axis=0)
            is_upper = np.take_along_axis(local, axis[None], axis=0)[0] > 0
            face = 2 * axis + is_upper
            return face, np.stack([-axes, axes], axis=1).reshape(6, 3)[face]
        return _round_faces(solid, local, axes)


def _round_faces(
    solid: Solid,
    local: Reals,
    axes: Reals,
) -> tuple[Ints, Reals]:
    """Faces [n] and normals [n, 3] at points of a cylinder or a ring [3, n] along its axes."""
    outer, bore, half_length = solid.half
    radius = np.maximum(np.hypot(local[0], local[1]), np.float32(1e-9))
    gaps = [np.abs(half_length - np.abs(local[2])), np.abs(outer - radius)]
    if solid.form is Form.RING:
        gaps.append(np.abs(radius - bore))
    # The ends are the faces 0 and 1, the side is 2 and the bore 3.
    face = np.argmin(gaps, axis=0) + 1
    is_end = face == 1
    # In a bore the normal points towards the axis, because that is out of the material.
    outwards = np.where(face == 3, -1.0, 1.0) / radius
    outwards[is_end] = 0.0
    along = np.where(is_end, np.sign(local[2]), 0.0)
    sides = local[:2] * outwards
    face[is_end & (local[2] < 0)] = 0
    return face, np.stack([*sides, along], axis=1).astype(np.float32) @ axes


def sprite_of(
    part: Part,
    axes: Reals,
    zoom: float,
) -> Sprite:
    """Draw a part. ``axes``: right, down, away in the part's frame [3, 3]; ``zoom``: rays per
    LDU."""
    look = look_of(part)
    boxes = [pixel_box(piece.solid, axes, zoom) for piece in look]
    whole = Box(
        min(box.left for box in boxes),
        min(box.top for box in boxes),
        max(box.right for box in boxes),
        max(box.bottom for box in boxes),
    )
    size = (whole.bottom - whole.top, whole.right - whole.left)
    # For each ray, `depth` is where it first meets material and `source` the index in `sources` of
    # what it meets there.
    depth = np.full(size, np.inf, dtype=np.float32)
    source = np.full(size, -1, dtype=np.int16)
    sources: list[_Source] = []
    for piece, box in zip(look, boxes, strict=True):
        window = box.window(whole.left, whole.top)
        # A ray beside a round solid has no depths in it: the square root of what is below 0.
        with np.errstate(invalid="ignore"):
            cuts = cuts_in(piece.cuts, box, axes, zoom)
            spans = grid(box, axes, zoom).spans(piece.solid)
        for span in spans:
            at, cut_by = first_material(span, cuts)
            # Two surfaces may be in the same place. The margin keeps the one that was drawn first,
            # whatever the rounding.
            is_nearer = at < depth[window] - _SAME_PLACE
            np.copyto(depth[window], at, where=is_nearer)
            # A piece adds its solid to `sources` and then its cuts, so that `cut_by` = -1 is the
            # solid.
            cut_by += len(sources) + 1
            np.copyto(source[window], cut_by, where=is_nearer)
        sources.append(_Source(piece.solid, piece.tint, is_cut=False))
        sources += [_Source(cut.solid, piece.tint, is_cut=True) for cut in cuts]
    return Sprite(
        whole.left,
        whole.top,
        depth,
        source,
        tuple(sources),
        axes,
        zoom,
    )


def _lines(
    depth: Reals,
    faces: Ints,
    normals: Reals,
) -> Bools:
    """Whether a line is drawn at each point [h, w]: where the surface folds or jumps."""
    is_line = np.zeros(depth.shape, dtype=bool)
    for first, second in neighbours():
        # Where the part is at neither point, infinity minus infinity is NaN, which is no jump.
        with np.errstate(invalid="ignore"):
            steps = np.abs(depth[first] - depth[second])
        is_line[first] |= (steps > JUMP) & (steps < np.inf)
        # Within a face there is no fold, so few points remain whose normals are compared.
        is_other = (faces[first] != faces[second]) & (faces[first] >= 0) & (faces[second] >= 0)
        rows, columns = np.nonzero(is_other)
        there = normals[first][rows, columns]
        beside = normals[second][rows, columns]
        is_fold = np.einsum("ij,ij->i", there, beside) < _FOLD
        is_line[first][rows[is_fold], columns[is_fold]] = True
    return is_line


def neighbours() -> Iterator[tuple[Window, Window]]:
    """Windows of all points with one to their right, and with one below."""
    every = slice(None)
    but_last = slice(None, -1)
    but_first = slice(1, None)
    yield (every, but_last), (every, but_first)
    yield (but_last, every), (but_first, every)
