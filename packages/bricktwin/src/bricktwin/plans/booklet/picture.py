"""Pictures of parts by rays: an orthographic view, a ray for each point, through the solids and
cuts of `looks`. LDraw units.

A part looks the same wherever it stands, so that each kind is drawn once for a direction and a
scale (a `Sprite`), and a picture is put together from sprites by their depths. It needs no OpenGL
and no display.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing.looks import TINTS, Tint, look_of
from bricktwin.plans.geometry import Bools, Floats, Form, Solid
from bricktwin.plans.part import Part
from bricktwin.plans.plan import Placed

Reals = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Pixels = NDArray[np.uint8]
OVERSAMPLING = 2
"""Rays per pixel and axis."""
_LIGHT = np.array([-0.42, -0.72, -0.55]) / np.linalg.norm([-0.42, -0.72, -0.55])
"""Direction of the light: right, down, away from the viewer."""
_AMBIENT = 0.66
_DIFFUSE = 0.40
_HOLLOW = 0.80
"""Brightness in the shade, what the light adds, and the share that is left in holes."""
_EPSILON = 0.02
_FOLD = 0.80
_JUMP = 5.0
"""Cosine of the smallest angle of a fold, and smallest jump in depth, that are drawn as a line."""
_FADED = 0.52
_FADE_TO = 0.95
_FADED_EDGE = 0.50
_DARKEST = 0.12
_BLACK = 0.25
_EDGE = 0.10
_LIGHT_EDGE = 0.50
"""Smallest component of a colour; below ``_BLACK``, lines are light."""
_MAX_PASSES = 12
_MAX_POINTS = 25_000_000
"""Points of the sprites that are kept, ten bytes each."""
_Window = tuple[slice, slice]
"""Rows and columns."""


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
        turn = math.radians(self.turn_deg)
        tilt = math.radians(self.tilt_deg)
        away = -np.array(
            [-math.sin(turn) * math.cos(tilt), -math.sin(tilt), math.cos(turn) * math.cos(tilt)]
        )
        right = np.cross([0.0, 1.0, 0.0], away)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(away, right), away])


VIEWS = tuple(View(turn, tilt) for tilt in (30.0, -30.0) for turn in (40.0, -40.0, 140.0, -140.0))
"""The first is the default."""


@dataclass(frozen=True)
class Sprite:
    """A part from one direction: its points [h, w] from column and row ``left`` and ``top``,
    relative to the part's origin.

    Attributes:
        depth: distance away from the origin, LDU; infinite where the part is not.
        shade: brightness in 0..1.
        edge: whether a line is drawn.
    """

    left: int
    top: int
    depth: Reals
    shade: Reals
    tint: Pixels
    edge: Bools

    @property
    def count(self) -> int:
        """Number of points that show the part."""
        return int(np.isfinite(self.depth).sum())


class _Spans(NamedTuple):
    """Where rays enter and leave a convex solid; a ray that misses it enters behind where it
    leaves."""

    enter: Reals
    leave: Reals


class _Rays(NamedTuple):
    """Rays through a grid of points: columns [w] and rows [h] in LDU; ``axes``: right, down, away
    in the part's frame."""

    x: Reals
    y: Reals
    axes: Reals

    def spans(self, solid: Solid) -> list[_Spans]:
        """Where they are in a solid: for a ring, before and behind its bore."""
        frame = np.array(solid.axes, dtype=np.float32)
        turned = frame @ self.axes.T.astype(np.float32)
        centre = frame @ np.array(solid.centre, dtype=np.float32)
        across = [
            row[0] * self.x + row[1] * self.y[:, None] - middle
            for row, middle in zip(turned, centre, strict=True)
        ]
        along = turned[:, 2]
        if solid.form is Form.BOX:
            return [_common(*(_slab(across[k], along[k], solid.half[k]) for k in range(3)))]
        if solid.form is Form.BALL:
            return [_round(across, along, solid.half[0])]
        ends = _slab(across[2], along[2], solid.half[2])
        outer = _common(_round(across[:2], along[:2], solid.half[0]), ends)
        if solid.form is Form.CYLINDER:
            return [outer]
        inner = _common(_round(across[:2], along[:2], solid.half[1]), ends)
        is_bored = inner.enter < inner.leave
        near = _Spans(outer.enter, np.where(is_bored, inner.enter, outer.leave))
        return [near, _Spans(np.where(is_bored, inner.leave, np.inf), outer.leave)]


def _common(first: _Spans, *others: _Spans) -> _Spans:
    """Where all spans are."""
    enter, leave = first
    for other in others:
        enter = np.maximum(enter, other.enter)
        leave = np.minimum(leave, other.leave)
    return _Spans(enter, leave)


def _slab(across: Reals, along: float, half: float) -> _Spans:
    if abs(along) < 1e-7:
        inside = np.abs(across) < half
        return _Spans(np.where(inside, -np.inf, np.inf), np.where(inside, np.inf, -np.inf))
    middle = across / -along
    reach = half / abs(along)
    return _Spans(middle - reach, middle + reach)


def _round(across: Sequence[Reals], along: Reals, radius: float) -> _Spans:
    """Where rays are in a ball (three coordinates) or an endless cylinder (two)."""
    square = float(along @ along)
    distance = sum(value * value for value in across) - radius**2
    if square < 1e-12:
        return _Spans(
            np.where(distance < 0, -np.inf, np.inf), np.where(distance < 0, np.inf, -np.inf)
        )
    middle = -sum(value * part for value, part in zip(across, along, strict=True)) / square
    reach = middle**2 - distance / square
    root = np.sqrt(np.maximum(reach, 0.0))
    return _Spans(
        np.where(reach > 0, middle - root, np.inf), np.where(reach > 0, middle + root, -np.inf)
    )


def sprite_of(part: Part, axes: Reals, zoom: float) -> Sprite:
    """Draw a part. ``axes``: right, down, away in the part's frame [3, 3]; ``zoom``: rays per
    LDU."""
    look = look_of(part)
    boxes = [_pixel_box(piece.solid, axes, zoom) for piece in look]
    left = min(box[0] for box in boxes)
    top = min(box[1] for box in boxes)
    shape = (max(box[3] for box in boxes) - top, max(box[2] for box in boxes) - left)
    depth = np.full(shape, np.inf, dtype=np.float32)
    source = np.full(shape, -1, dtype=np.int32)
    sources: list[tuple[Solid, Tint, bool]] = []
    for piece, (x0, y0, x1, y1) in zip(look, boxes, strict=True):
        window = (slice(y0 - top, y1 - top), slice(x0 - left, x1 - left))
        cuts: list[tuple[Solid, _Window, _Spans]] = []
        for cut in piece.cuts:
            a0, b0, a1, b1 = _pixel_box(cut, axes, zoom)
            a0 = max(a0, x0)
            b0 = max(b0, y0)
            a1 = min(a1, x1)
            b1 = min(b1, y1)
            if a0 < a1 and b0 < b1:
                inner = (slice(b0 - y0, b1 - y0), slice(a0 - x0, a1 - x0))
                cuts += [
                    (cut, inner, spans) for spans in _rays(a0, b0, a1, b1, axes, zoom).spans(cut)
                ]
        for span in _rays(x0, y0, x1, y1, axes, zoom).spans(piece.solid):
            at, cut_by = _first_material(span, [(inner, spans) for _, inner, spans in cuts])
            is_nearer = at < depth[window] - 1e-3
            depth[window] = np.where(is_nearer, at, depth[window])
            source[window] = np.where(is_nearer, len(sources) + cut_by + 1, source[window])
        sources += [
            (piece.solid, piece.tint, False),
            *((cut, piece.tint, True) for cut, _, _ in cuts),
        ]
    return _shaded(left, top, depth, source, sources, axes, zoom)


def _pixel_box(solid: Solid, axes: Reals, zoom: float) -> tuple[int, int, int, int]:
    """First and last + 1 column and row of a solid: left, top, right, bottom."""
    points = solid.corners() @ axes[:2].T * zoom
    left, top = np.floor(points.min(axis=0)).astype(int).tolist()
    right, bottom = np.ceil(points.max(axis=0)).astype(int).tolist()
    return left, top, max(right, left + 1), max(bottom, top + 1)


def _rays(left: int, top: int, right: int, bottom: int, axes: Reals, zoom: float) -> _Rays:
    """The rays through these columns and rows."""
    return _Rays(
        (np.arange(left, right, dtype=np.float32) + 0.5) / zoom,
        (np.arange(top, bottom) + np.float32(0.5)) / zoom,
        axes,
    )


def _first_material(span: _Spans, cuts: Sequence[tuple[_Window, _Spans]]) -> tuple[Reals, Ints]:
    """Where rays meet the material of a solid (infinite if nowhere), and the index of the cut that
    they come out of, -1 for none. Each cut has the window of the rays that may meet it."""
    at = span.enter.copy()
    cut_by = np.full(span.enter.shape, -1)
    for _ in range(_MAX_PASSES if cuts else 0):
        has_moved = False
        for number, (window, cut) in enumerate(cuts):
            is_empty = (cut.enter <= at[window] + _EPSILON) & (at[window] < cut.leave - _EPSILON)
            if is_empty.any():
                at[window][is_empty] = cut.leave[is_empty]
                cut_by[window][is_empty] = number
                has_moved = True
        if not has_moved:
            break
    return np.where(at < span.leave - _EPSILON, at, np.inf), cut_by


def _shaded(
    left: int,
    top: int,
    depth: Reals,
    source: Ints,
    sources: Sequence[tuple[Solid, Tint, bool]],
    axes: Reals,
    zoom: float,
) -> Sprite:
    """The sprite of rays that meet these sources: solids, their material, and whether the rays come
    out of them."""
    normals = np.zeros((*depth.shape, 3), dtype=np.float32)
    tint = np.zeros(depth.shape, dtype=np.uint8)
    shade = np.ones(depth.shape, dtype=np.float32)
    order = np.argsort(source, axis=None, kind="stable")
    bounds = np.searchsorted(source.ravel()[order], np.arange(len(sources) + 1))
    for number, (solid, material, is_cut) in enumerate(sources):
        rows, columns = np.unravel_index(order[bounds[number] : bounds[number + 1]], depth.shape)
        if len(rows):
            seen = np.column_stack(
                [(columns + left + 0.5) / zoom, (rows + top + 0.5) / zoom, depth[rows, columns]]
            )
            outward = (
                solid.normals(np.asarray(seen @ axes, dtype=float))
                @ axes.T
                * (-1.0 if is_cut else 1.0)
            )
            normals[rows, columns] = outward
            tint[rows, columns] = material
            shade[rows, columns] = (_AMBIENT + _DIFFUSE * np.maximum(outward @ _LIGHT, -0.4)) * (
                _HOLLOW if is_cut else 1.0
            )
    is_edge = np.zeros(depth.shape, dtype=bool)
    for first, second in _neighbours():
        is_both = np.isfinite(depth[first]) & np.isfinite(depth[second])
        with np.errstate(invalid="ignore"):
            jumps = np.abs(depth[first] - depth[second]) > _JUMP
        folds = np.einsum("ijk,ijk->ij", normals[first], normals[second]) < _FOLD
        is_edge[first] |= is_both & (jumps | folds)
    return Sprite(left, top, depth, shade, tint, is_edge)


def _neighbours() -> Iterator[tuple[_Window, _Window]]:
    """Windows of all points with one to their right, and with one below."""
    every = slice(None)
    but_last = slice(None, -1)
    but_first = slice(1, None)
    yield (every, but_last), (every, but_first)
    yield (but_last, every), (but_first, every)


class Shown(NamedTuple):
    """A part in a picture, moved [3] away from its place."""

    placed: Placed
    shift: Floats


@dataclass(frozen=True)
class Picture:
    """What each point shows: the index of a part, -1 for none, with its material, brightness and
    lines.

    Attributes:
        view, zoom: rays per LDU.
        left, top: of the first point, from the plan's origin, in points.
        alone: number of points that each part would have without the others.
    """

    view: View
    zoom: float
    left: int
    top: int
    depth: Reals
    owner: Ints
    tint: Pixels
    shade: Reals
    edge: Bools
    alone: Mapping[int, int]
    colours: Mapping[int, int]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in pixels."""
        return self.owner.shape[1] / OVERSAMPLING, self.owner.shape[0] / OVERSAMPLING

    def visible(self, group: Iterable[int]) -> float:
        """Share of some parts, as one thing, that the others do not hide: the largest number is
        that of the parts alone."""
        parts = list(group)
        return float(
            np.isin(self.owner, parts).sum() / max(sum(self.alone[part] for part in parts), 1)
        )

    def pixel_of(self, point: Floats) -> tuple[float, float]:
        """Column and row, in pixels, of a point [3] of the plan."""
        x, y = (self.view.axes[:2] @ point) * self.zoom - np.array([self.left, self.top])
        return float(x / OVERSAMPLING), float(y / OVERSAMPLING)

    def hides(self, point: Floats) -> bool:
        """Whether a part is in front of a point [3] of the plan."""
        x, y = (round(value * OVERSAMPLING) for value in self.pixel_of(point))
        inside = 0 <= x < self.depth.shape[1] and 0 <= y < self.depth.shape[0]
        return inside and bool(self.depth[y, x] < self.view.axes[2] @ point - _JUMP)

    def pixels(self, bright: set[int] | None, paper: tuple[float, float, float]) -> Pixels:
        """The picture [h, w, 3] on paper of a colour; ``bright``: parts in full colour, the others
        fade; ``None`` fades none."""
        count = max(self.colours, default=0) + 2  # the last is no part
        tones, white = np.zeros((2, count, len(Tint), 3), dtype=np.float32)
        line, light = np.full((2, count), _FADED_EDGE, dtype=np.float32)
        for part, code in self.colours.items():
            tones[part] = [
                TINTS.get(tint, np.maximum(colour_of(code).rgb, _DARKEST)) for tint in Tint
            ]
            if bright is None or part in bright:
                line[part], light[part] = (
                    _EDGE,
                    _LIGHT_EDGE if tones[part, 0].max() < _BLACK else _EDGE,
                )
            else:
                tones[part] = (1 - _FADED) * tones[part]
                white[part] = _FADED * _FADE_TO
        white[-1] = paper
        line[-1] = 1.0
        image = np.minimum(
            white[self.owner, self.tint] + tones[self.owner, self.tint] * self.shade[..., None], 1.0
        )
        image[self.edge] = light[self.owner[self.edge], None]
        for first, second in _neighbours():  # a line around a bright part is dark
            rows, columns = np.nonzero(self.owner[first] != self.owner[second])
            dark = np.minimum(
                line[self.owner[first][rows, columns]], line[self.owner[second][rows, columns]]
            )[:, None]
            image[first][rows, columns] = np.minimum(image[first][rows, columns], dark)
            image[second][rows, columns] = np.minimum(image[second][rows, columns], dark)
        parts = [
            image[row::OVERSAMPLING, column::OVERSAMPLING]
            for row, column in np.ndindex(OVERSAMPLING, OVERSAMPLING)
        ]
        return np.asarray(
            sum(parts) * np.float32(255 / len(parts)) + np.float32(0.5), dtype=np.uint8
        )


class Studio:
    """Draws pictures, and keeps the sprites."""

    def __init__(self) -> None:
        self._sprites: dict[tuple[str, bytes, float], Sprite] = {}

    def picture(
        self, shown: Sequence[Shown], view: View, zoom: float, *, margin: int = 4
    ) -> Picture:
        """A picture of parts, as large as they are with a margin (points)."""
        axes = view.axes
        places = []
        for placed, shift in shown:
            x, y, away = axes @ (placed.position + shift)
            sprite = self._sprite(placed, axes @ placed.rotation, zoom)
            places.append(
                (placed, sprite, round(x * zoom) + sprite.left, round(y * zoom) + sprite.top, away)
            )
        left = min(place[2] for place in places) - margin
        top = min(place[3] for place in places) - margin
        width = max(x + sprite.depth.shape[1] for _, sprite, x, _, _ in places) + margin - left
        height = max(y + sprite.depth.shape[0] for _, sprite, _, y, _ in places) + margin - top
        width, height = (side + -side % OVERSAMPLING for side in (width, height))
        depth = np.full((height, width), np.inf, dtype=np.float32)
        owner = np.full((height, width), -1, dtype=np.int32)
        tint = np.zeros((height, width), dtype=np.uint8)
        shade = np.ones((height, width), dtype=np.float32)
        edge = np.zeros((height, width), dtype=bool)
        for placed, sprite, x, y, away in places:
            rows, columns = sprite.depth.shape
            window = (slice(y - top, y - top + rows), slice(x - left, x - left + columns))
            distance = sprite.depth + np.float32(away)
            is_nearer = distance < depth[window]
            depth[window][is_nearer] = distance[is_nearer]
            owner[window][is_nearer] = placed.index
            tint[window][is_nearer] = sprite.tint[is_nearer]
            shade[window][is_nearer] = sprite.shade[is_nearer]
            edge[window][is_nearer] = sprite.edge[is_nearer]
        alone = {placed.index: sprite.count for placed, sprite, *_ in places}
        colours = {placed.index: placed.colour for placed, *_ in places}
        return Picture(view, zoom, left, top, depth, owner, tint, shade, edge, alone, colours)

    def _sprite(self, placed: Placed, axes: Floats, zoom: float) -> Sprite:
        key = (placed.part.number, axes.round(4).tobytes(), zoom)
        if key not in self._sprites:
            sprite = sprite_of(placed.part, axes, zoom)
            if (
                sum(kept.depth.size for kept in self._sprites.values()) + sprite.depth.size
                > _MAX_POINTS
            ):
                self._sprites.clear()
            self._sprites[key] = sprite
        return self._sprites[key]


def extent(shown: Sequence[Shown], view: View) -> tuple[float, float]:
    """Width and height of parts in a view, LDU."""
    boxes = [np.array(list(itertools.product(*np.stack(part.part.bounds).T))) for part, _ in shown]
    points = np.concatenate(
        [part.to_plan(box) + shift for (part, shift), box in zip(shown, boxes, strict=True)]
    )
    width, height = np.ptp(points @ view.axes[:2].T, axis=0)
    return float(width), float(height)
