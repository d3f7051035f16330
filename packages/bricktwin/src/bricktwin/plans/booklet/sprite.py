"""A part from one direction, drawn once for all of its places: depth, light and lines. LDraw
units."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bricktwin.plans.booklet.rays import (
    Ints,
    Reals,
    Window,
    around,
    cuts_in,
    first_material,
    grid,
    pixel_boxes,
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
        shape = self.depth.shape
        points_count = self.depth.size
        normals = np.zeros((points_count, 3), dtype=np.float32)
        faces: Ints = np.full(points_count, -1, dtype=np.int32)
        places = self._places()
        coat: Ints = np.zeros(points_count, dtype=np.uint16)
        for number, points in self._points_of_sources():
            solid, tint, is_cut = self.sources[number]
            face, outward = self._normals(solid, places[:, points])
            # The surface of a cut is seen from its inside, so its normals are reversed.
            if is_cut:
                outward = -outward
            normals[points] = outward
            faces[points] = face + _FACES * number
            coat[points] = _shades(outward, is_cut=is_cut) + tint * SHADES
        coat = coat.reshape(shape)
        faces = faces.reshape(shape)
        normals = normals.reshape(*shape, 3)
        coat[_lines(self.depth, faces, normals)] = LINE
        return coat

    def _points_of_sources(self) -> Iterator[tuple[int, Ints]]:
        """Each source that is seen, with the indices of its points in the flattened arrays."""
        # One sort by source finds the points of all sources; searching the picture for each would
        # take a pass for each.
        covered = np.flatnonzero(self.source >= 0)
        sources = self.source.ravel()[covered]
        order = covered[np.argsort(sources, kind="stable")]
        end = 0
        for number, count in enumerate(np.bincount(sources).tolist()):
            begin = end
            end += count
            if count:
                yield number, order[begin:end]

    def _normals(self, solid: Solid, places: Reals) -> tuple[Ints, Reals]:
        """Faces [n] of a solid at these places [3, n] of the view, and their normals [n, 3] there,
        out of the solid."""
        turned, centre = seen(solid, self.axes)
        axes = turned.astype(np.float32)
        middle = centre.astype(np.float32)
        local = axes @ places - middle[:, None]  # [3, n]
        if solid.form is Form.BALL:
            # It has a single face.
            face = np.zeros(places.shape[1], dtype=np.int32)
            from_middle = local / np.float32(solid.half[0])
            return face, from_middle.T @ axes
        if solid.form is Form.BOX:
            return _box_faces(solid, local, axes)
        return _round_faces(solid, local, axes)

    def _places(self) -> Reals:
        """Where all points are: right, down and away [3, h w], LDU."""
        height, width = self.depth.shape
        places = np.empty((3, height, width), dtype=np.float32)
        places[0] = (np.arange(width) + (self.left + 0.5)) / self.zoom
        down = (np.arange(height) + (self.top + 0.5)) / self.zoom
        places[1] = down[:, None]
        places[2] = self.depth
        return places.reshape(3, -1)


def _shades(normals: Reals, *, is_cut: bool) -> Reals:
    """Number of the shade of surfaces with these normals [n, 3] in a view."""
    facing = normals @ _LIGHT.astype(np.float32)
    lit = _DIFFUSE * np.maximum(facing, _DARKEST_SIDE)
    brightness = _AMBIENT + lit
    if is_cut:
        brightness *= _HOLLOW
    shade = brightness / BRIGHTEST * (SHADES - 1)
    return np.asarray(shade.round())


def _box_faces(
    solid: Solid,
    local: Reals,
    axes: Reals,
) -> tuple[Ints, Reals]:
    """Faces [n] and normals [n, 3] at points of a box [3, n] along its axes."""
    half = np.array(solid.half, dtype=np.float32)
    gaps = np.abs(local) - half[:, None]
    axis = np.abs(gaps).argmin(axis=0)
    place = np.take_along_axis(local, axis[None], axis=0)[0]
    is_upper = place > 0
    # Of each axis, the lower face comes before the upper one.
    face = 2 * axis + is_upper
    outward = np.stack([-axes, axes], axis=1)  # [3, 2, 3]
    return face, outward.reshape(6, 3)[face]


def _round_faces(
    solid: Solid,
    local: Reals,
    axes: Reals,
) -> tuple[Ints, Reals]:
    """Faces [n] and normals [n, 3] at points of a cylinder or a ring [3, n] along its axes."""
    outer, bore, half_length = solid.half
    x, y, along = local
    radius = np.hypot(x, y)
    radius = np.maximum(radius, np.float32(1e-9))
    from_end = np.abs(np.abs(along) - half_length)
    from_side = np.abs(radius - outer)
    gaps = [from_end, from_side]
    if solid.form is Form.RING:
        gaps.append(np.abs(radius - bore))
    nearest = np.argmin(gaps, axis=0)
    # The ends are the faces 0 and 1, the side is 2 and the bore 3.
    face = nearest + 1
    is_end = nearest == 0
    face[is_end & (along < 0)] = 0
    # In a bore the normal points towards the axis, because that is out of the material.
    outwards = np.where(nearest == 2, -1.0, 1.0)
    outwards[is_end] = 0.0
    upwards = np.where(is_end, np.sign(along), 0.0)
    normals = np.stack([x / radius * outwards, y / radius * outwards, upwards], axis=1)
    return face, normals.astype(np.float32) @ axes


def sprite_of(
    part: Part,
    axes: Reals,
    zoom: float,
) -> Sprite:
    """Draw a part. ``axes``: right, down, away in the part's frame [3, 3]; ``zoom``: rays per
    LDU."""
    look = look_of(part)
    boxes = pixel_boxes([piece.solid for piece in look], axes, zoom)
    whole = around(boxes)
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
        # A piece adds its solid to `sources` and then its cuts, which count from 0: the solid,
        # whose number is -1, comes first.
        first = len(sources) + 1
        for span in spans:
            at, cut_by = first_material(span, cuts)
            # Two surfaces may be in the same place. The margin keeps the one that was drawn first,
            # whatever the rounding.
            is_nearer = at < depth[window] - _SAME_PLACE
            np.copyto(depth[window], at, where=is_nearer)
            np.copyto(source[window], cut_by + np.int16(first), where=is_nearer)
        sources.append(_Source(piece.solid, piece.tint, is_cut=False))
        for cut in cuts:
            sources.append(_Source(cut.solid, piece.tint, is_cut=True))
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
        here = faces[first]
        beside = faces[second]
        is_border = (here != beside) & (here >= 0) & (beside >= 0)
        rows, columns = np.nonzero(is_border)
        normals_here = normals[first][rows, columns]
        normals_beside = normals[second][rows, columns]
        cosines = np.einsum("ij,ij->i", normals_here, normals_beside)
        is_fold = cosines < _FOLD
        is_line[first][rows[is_fold], columns[is_fold]] = True
    return is_line


def neighbours() -> Iterator[tuple[Window, Window]]:
    """Windows of all points with one to their right, and with one below."""
    every = slice(None)
    but_last = slice(None, -1)
    but_first = slice(1, None)
    yield (every, but_last), (every, but_first)
    yield (but_last, every), (but_first, every)
