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
"""Brightness in the shade."""
_DIFFUSE = 0.40
"""Brightness that the light adds where it falls straight on a surface."""
_DARKEST_SIDE = -0.4
"""Cosine below which a surface that is turned away from the light gets no darker."""
_HOLLOW = 0.80
"""Share of the brightness that is left in holes."""
_EPSILON = 0.02
"""Least thickness of material along a ray, LDU. Without it rounding leaves films of material, at
almost a third of the points of a gear with 24 teeth (3648)."""
_FOLD = 0.80
"""Cosine of the smallest angle of a fold that is drawn as a line."""
_JUMP = 5.0
"""Smallest jump in depth that is drawn as a line, LDU."""
_FADED = 0.52
"""Share of a faded part's colour that is replaced."""
_FADE_TO = 0.95
"""Grey that replaces that share of a faded part's colour."""
_FADED_EDGE = 0.50
"""Brightness of a faded part's lines."""
_DARKEST = 0.12
"""Smallest component of a colour: shade must be seen on black too."""
_BLACK = 0.25
"""A part whose components are all below this has light lines."""
_EDGE = 0.10
"""Brightness of the lines of a part in full colour."""
_LIGHT_EDGE = 0.50
"""Brightness of the lines of a black part in full colour."""
_MAX_PASSES = 12
"""Largest number of times that a ray may leave one cut and find itself in another."""
_MAX_POINTS = 25_000_000
"""Largest number of points of all sprites that are kept, at ten bytes each."""
_Window = tuple[slice, slice]
"""Slices of the rows and of the columns of an array."""


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
        # The y axis of a plan points down, so a view from above looks along +y.
        x = -math.sin(turn) * math.cos(tilt)
        y = -math.sin(tilt)
        z = math.cos(turn) * math.cos(tilt)
        away = -np.array([x, y, z])
        right = np.cross([0.0, 1.0, 0.0], away)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(away, right), away])


VIEWS = tuple(View(turn, tilt) for tilt in (30.0, -30.0) for turn in (40.0, -40.0, 140.0, -140.0))
"""Views that a step may be drawn in; the first one is the default."""


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
    """Depths at which rays enter and leave a convex solid. A ray that misses it enters behind where
    it leaves."""

    enter: Reals
    leave: Reals


class _Rays(NamedTuple):
    """Rays through a grid of points: columns [w] and rows [h] in LDU; ``axes``: right, down, away
    in the part's frame."""

    x: Reals
    y: Reals
    axes: Reals

    def spans(self, solid: Solid) -> list[_Spans]:
        """Spans of the rays in a solid: one, or for a ring two, before and behind its bore."""
        # Single precision is enough, and a sprite then keeps ten bytes a point.
        frame = np.array(solid.axes, dtype=np.float32)
        centre = frame @ np.array(solid.centre, dtype=np.float32)
        # In the frame of the solid, the point of a ray at a depth is `across + depth * along`:
        # `across` is [h, w] for each of the three axes, `along` is [3].
        turned = frame @ self.axes.T.astype(np.float32)  # [3, 3]
        across: list[Reals] = []
        for (right, down, _), middle in zip(turned, centre, strict=True):
            across.append(right * self.x + down * self.y[:, None] - middle)
        along = turned[:, 2]
        if solid.form is Form.BOX:
            slabs = [_slab(*ray) for ray in zip(across, along, solid.half, strict=True)]
            return [_common(*slabs)]
        if solid.form is Form.BALL:
            return [_round(across, along, solid.half[0])]
        radius, bore_radius, half_length = solid.half
        ends = _slab(across[2], along[2], half_length)
        outer = _common(_round(across[:2], along[:2], radius), ends)
        if solid.form is Form.CYLINDER:
            return [outer]
        # A ring is not convex: a ray through its bore crosses the wall twice.
        bore = _common(_round(across[:2], along[:2], bore_radius), ends)
        is_bored = bore.enter < bore.leave
        before_bore = _Spans(outer.enter, np.where(is_bored, bore.enter, outer.leave))
        behind_bore = _Spans(np.where(is_bored, bore.leave, np.inf), outer.leave)
        return [before_bore, behind_bore]


def _common(first: _Spans, *others: _Spans) -> _Spans:
    """The common part of all spans."""
    enter, leave = first
    for other in others:
        enter = np.maximum(enter, other.enter)
        leave = np.minimum(leave, other.leave)
    return _Spans(enter, leave)


def _everywhere(is_inside: Bools) -> _Spans:
    """Rays that never leave where they are: inside a solid, or outside of it."""
    enter = np.where(is_inside, -np.inf, np.inf)
    leave = np.where(is_inside, np.inf, -np.inf)
    return _Spans(enter, leave)


def _slab(
    across: Reals,
    along: float,
    half: float,
) -> _Spans:
    """Spans of rays between two parallel planes."""
    if abs(along) < 1e-7:
        return _everywhere(np.abs(across) < half)
    middle = across / -along
    reach = half / abs(along)
    return _Spans(middle - reach, middle + reach)


def _round(
    across: Sequence[Reals],
    along: Reals,
    radius: float,
) -> _Spans:
    """Spans of rays in a ball (three coordinates) or in an endless cylinder (two)."""
    # The depth solves |across + depth * along|^2 = radius^2, a quadratic equation.
    square = float(along @ along)
    constant = sum(value * value for value in across) - radius**2
    if square < 1e-12:
        return _everywhere(np.asarray(constant < 0))
    product = sum(value * part for value, part in zip(across, along, strict=True))
    middle = -product / square
    discriminant = middle**2 - constant / square
    root = np.sqrt(np.maximum(discriminant, 0.0))
    is_hit = discriminant > 0
    enter = np.where(is_hit, middle - root, np.inf)
    leave = np.where(is_hit, middle + root, -np.inf)
    return _Spans(enter, leave)


class _Box(NamedTuple):
    """A range of columns and rows: the first ones, and the ones after the last."""

    left: int
    top: int
    right: int
    bottom: int

    def window(
        self,
        left: int,
        top: int,
    ) -> _Window:
        """The rows and columns of this box in an array that begins at another column and row."""
        rows = slice(self.top - top, self.bottom - top)
        columns = slice(self.left - left, self.right - left)
        return rows, columns


class _Source(NamedTuple):
    """A surface that a ray may meet: a solid with its material. ``is_cut`` says that the solid is
    cut out, so that the ray comes out of it."""

    solid: Solid
    tint: Tint
    is_cut: bool


class _Cut(NamedTuple):
    """Spans of rays in a cut, in a window of the rays of the piece."""

    solid: Solid
    window: _Window
    spans: _Spans


def sprite_of(
    part: Part,
    axes: Reals,
    zoom: float,
) -> Sprite:
    """Draw a part. ``axes``: right, down, away in the part's frame [3, 3]; ``zoom``: rays per
    LDU."""
    look = look_of(part)
    boxes = [_pixel_box(piece.solid, axes, zoom) for piece in look]
    left = min(box.left for box in boxes)
    top = min(box.top for box in boxes)
    height = max(box.bottom for box in boxes) - top
    width = max(box.right for box in boxes) - left
    # For each ray, `depth` is where it first meets material and `source` the index in `sources` of
    # what it meets there.
    depth = np.full((height, width), np.inf, dtype=np.float32)
    source = np.full((height, width), -1, dtype=np.int32)
    sources: list[_Source] = []
    for piece, box in zip(look, boxes, strict=True):
        window = box.window(left, top)
        cuts = _cuts_in(piece.cuts, box, axes, zoom)
        for span in _rays(box, axes, zoom).spans(piece.solid):
            at, cut_by = _first_material(span, cuts)
            # Two surfaces may be in the same place. The margin keeps the one that was drawn first,
            # whatever the rounding.
            is_nearer = at < depth[window] - 1e-3
            depth[window] = np.where(is_nearer, at, depth[window])
            # A piece adds its solid to `sources` and then its cuts, so that `cut_by` = -1 is the
            # solid.
            source[window] = np.where(is_nearer, len(sources) + cut_by + 1, source[window])
        sources.append(_Source(piece.solid, piece.tint, is_cut=False))
        sources += [_Source(cut.solid, piece.tint, is_cut=True) for cut in cuts]
    return _shaded(
        left,
        top,
        depth,
        source,
        sources,
        axes,
        zoom,
    )


def _cuts_in(
    cuts: Iterable[Solid],
    box: _Box,
    axes: Reals,
    zoom: float,
) -> list[_Cut]:
    """The cuts that rays of a box may meet; one with a bore is two."""
    found: list[_Cut] = []
    for cut in cuts:
        # Following only the rays that the piece and the cut share saves most of the work.
        whole = _pixel_box(cut, axes, zoom)
        shared = _Box(
            max(whole.left, box.left),
            max(whole.top, box.top),
            min(whole.right, box.right),
            min(whole.bottom, box.bottom),
        )
        if shared.left >= shared.right or shared.top >= shared.bottom:
            continue
        window = shared.window(box.left, box.top)
        found += [_Cut(cut, window, spans) for spans in _rays(shared, axes, zoom).spans(cut)]
    return found


def _pixel_box(
    solid: Solid,
    axes: Reals,
    zoom: float,
) -> _Box:
    """The columns and rows of a solid, at least one of each."""
    points = solid.corners() @ axes[:2].T * zoom  # [8, 2]
    first = np.floor(points.min(axis=0))
    after_last = np.ceil(points.max(axis=0))
    left, top = first.astype(int).tolist()
    right, bottom = after_last.astype(int).tolist()
    return _Box(
        left,
        top,
        max(right, left + 1),
        max(bottom, top + 1),
    )


def _rays(
    box: _Box,
    axes: Reals,
    zoom: float,
) -> _Rays:
    """The rays through the middles of these columns and rows."""
    x = (np.arange(box.left, box.right, dtype=np.float32) + 0.5) / zoom
    y = (np.arange(box.top, box.bottom) + np.float32(0.5)) / zoom
    return _Rays(x, y, axes)


def _first_material(span: _Spans, cuts: Sequence[_Cut]) -> tuple[Reals, Ints]:
    """Depths at which rays meet the material of a solid (infinite if nowhere), and the indices of
    the cuts that they come out of, -1 for none."""
    at = span.enter.copy()
    cut_by = np.full(span.enter.shape, -1)
    # Cuts overlap, as a bore and its recesses do, so a ray that leaves one may be in another that
    # was tested before it.
    for _ in range(_MAX_PASSES if cuts else 0):
        has_moved = False
        for number, (_, window, cut) in enumerate(cuts):
            is_after_start = cut.enter <= at[window] + _EPSILON
            is_before_end = at[window] < cut.leave - _EPSILON
            is_empty = is_after_start & is_before_end
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
    sources: Sequence[_Source],
    axes: Reals,
    zoom: float,
) -> Sprite:
    """The sprite of rays that meet these sources."""
    normals = np.zeros((*depth.shape, 3), dtype=np.float32)
    tint = np.zeros(depth.shape, dtype=np.uint8)
    shade = np.ones(depth.shape, dtype=np.float32)
    # One sort by source finds the points of all sources; searching the picture for each would take
    # a pass for each.
    order = np.argsort(source, axis=None, kind="stable")
    sorted_sources = source.ravel()[order]
    bounds = np.searchsorted(sorted_sources, np.arange(len(sources) + 1))
    for number, (solid, material, is_cut) in enumerate(sources):
        points = order[bounds[number] : bounds[number + 1]]
        rows, columns = np.unravel_index(points, depth.shape)
        if not len(rows):
            continue
        x = (columns + left + 0.5) / zoom
        y = (rows + top + 0.5) / zoom
        in_view = np.column_stack([x, y, depth[rows, columns]])  # [n, 3]
        in_part = np.asarray(in_view @ axes, dtype=float)  # [n, 3]
        # The surface of a cut is seen from its inside, so its normals are reversed.
        side = -1.0 if is_cut else 1.0
        outward = solid.normals(in_part) @ axes.T * side  # [n, 3]
        normals[rows, columns] = outward
        tint[rows, columns] = material
        facing = np.maximum(outward @ _LIGHT, _DARKEST_SIDE)  # [n]
        brightness = _AMBIENT + _DIFFUSE * facing
        shade[rows, columns] = brightness * (_HOLLOW if is_cut else 1.0)
    is_edge = _edges(depth, normals)
    return Sprite(
        left,
        top,
        depth,
        shade,
        tint,
        is_edge,
    )


def _edges(depth: Reals, normals: Reals) -> Bools:
    """Whether a line is drawn at each point [h, w]: where the surface folds or jumps."""
    is_edge = np.zeros(depth.shape, dtype=bool)
    for first, second in _neighbours():
        is_both = np.isfinite(depth[first]) & np.isfinite(depth[second])
        # Where the part is at neither point, infinity minus infinity is NaN, and NumPy would warn.
        with np.errstate(invalid="ignore"):
            jumps = np.abs(depth[first] - depth[second]) > _JUMP
        folds = np.einsum("ijk,ijk->ij", normals[first], normals[second]) < _FOLD
        is_edge[first] |= is_both & (jumps | folds)
    return is_edge


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
    """A picture: for each point, the index of the part that it shows (-1 for none), with its
    material, brightness and lines.

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
        """Share of some parts, taken as one thing, that the other parts do not hide."""
        parts = list(group)
        shown = np.isin(self.owner, parts).sum()
        alone = sum(self.alone[part] for part in parts)
        return float(shown / max(alone, 1))

    def pixel_of(self, point: Floats) -> tuple[float, float]:
        """Column and row, in pixels, of a point [3] of the plan."""
        in_view = self.view.axes[:2] @ point
        x, y = in_view * self.zoom - np.array([self.left, self.top])
        return float(x / OVERSAMPLING), float(y / OVERSAMPLING)

    def hides(self, point: Floats) -> bool:
        """Whether a part is in front of a point [3] of the plan."""
        x, y = (round(value * OVERSAMPLING) for value in self.pixel_of(point))
        height, width = self.depth.shape
        if not (0 <= x < width and 0 <= y < height):
            return False
        # A part does not hide a point on its own surface, so only what is clearly in front counts.
        return bool(self.depth[y, x] < self.view.axes[2] @ point - _JUMP)

    def pixels(
        self,
        bright: set[int] | None,
        paper: tuple[float, float, float],
    ) -> Pixels:
        """The picture [h, w, 3] on paper of a colour; ``bright``: parts in full colour, the others
        fade; ``None`` fades none."""
        image = self._painted(bright, paper)
        # A pixel is the mean of its rays; 0.5 is added because the conversion to integers cuts off.
        parts = [
            image[row::OVERSAMPLING, column::OVERSAMPLING]
            for row, column in np.ndindex(OVERSAMPLING, OVERSAMPLING)
        ]
        mean = sum(parts) * np.float32(255 / len(parts))
        return np.asarray(mean + np.float32(0.5), dtype=np.uint8)

    def _painted(
        self,
        bright: set[int] | None,
        paper: tuple[float, float, float],
    ) -> Reals:
        """The colour of each ray [h, w, 3] in 0..1."""
        # These tables have a row for each part, and a last one (-1) for the paper. A colour is
        # `white` plus `tones` times the brightness.
        count = max(self.colours, default=0) + 2
        tones, white = np.zeros((2, count, len(Tint), 3), dtype=np.float32)
        outline, inner_line = np.full((2, count), _FADED_EDGE, dtype=np.float32)
        for part, code in self.colours.items():
            main = np.maximum(colour_of(code).rgb, _DARKEST)
            tones[part] = [TINTS.get(tint, main) for tint in Tint]
            if bright is None or part in bright:
                is_black = tones[part, 0].max() < _BLACK
                outline[part] = _EDGE
                inner_line[part] = _LIGHT_EDGE if is_black else _EDGE
            else:
                tones[part] = (1 - _FADED) * tones[part]
                white[part] = _FADED * _FADE_TO
        white[-1] = paper
        outline[-1] = 1.0
        lit = tones[self.owner, self.tint] * self.shade[..., None]  # [h, w, 3]
        unlit = white[self.owner, self.tint]  # [h, w, 3]
        image = np.minimum(unlit + lit, 1.0)
        owner_of_edge = self.owner[self.edge]
        image[self.edge] = inner_line[owner_of_edge, None]
        # The line between two parts has the darker of their two tones, on both sides, so that a
        # bright part stands out from faded ones.
        for first, second in _neighbours():
            first_owner = self.owner[first]
            second_owner = self.owner[second]
            rows, columns = np.nonzero(first_owner != second_owner)
            first_line = outline[first_owner[rows, columns]]
            second_line = outline[second_owner[rows, columns]]
            dark = np.minimum(first_line, second_line)[:, None]
            # Both sides are views of the same image, so writing to them changes it.
            for side in (image[first], image[second]):
                side[rows, columns] = np.minimum(side[rows, columns], dark)
        return np.asarray(image)


class _Place(NamedTuple):
    """A sprite in a picture: its first column and row, and how far away its origin is, LDU."""

    placed: Placed
    sprite: Sprite
    left: int
    top: int
    away: float


class Studio:
    """A studio that draws pictures and keeps the sprites."""

    def __init__(self) -> None:
        self._sprites: dict[tuple[str, bytes, float], Sprite] = {}

    def picture(
        self,
        shown: Sequence[Shown],
        view: View,
        zoom: float,
        *,
        margin: int = 4,
    ) -> Picture:
        """A picture of parts, as large as they are with a margin (points)."""
        places = [self._place(part, view.axes, zoom) for part in shown]
        left = min(place.left for place in places) - margin
        top = min(place.top for place in places) - margin
        right = max(place.left + place.sprite.depth.shape[1] for place in places) + margin
        bottom = max(place.top + place.sprite.depth.shape[0] for place in places) + margin
        # The size is a whole number of pixels, so that each pixel has all of its rays.
        width = _rounded_up(right - left, OVERSAMPLING)
        height = _rounded_up(bottom - top, OVERSAMPLING)
        depth = np.full((height, width), np.inf, dtype=np.float32)
        owner = np.full((height, width), -1, dtype=np.int32)
        tint = np.zeros((height, width), dtype=np.uint8)
        shade = np.ones((height, width), dtype=np.float32)
        edge = np.zeros((height, width), dtype=bool)
        for placed, sprite, first_column, first_row, away in places:
            row_count, column_count = sprite.depth.shape
            y = first_row - top
            x = first_column - left
            window = (slice(y, y + row_count), slice(x, x + column_count))
            distance = sprite.depth + np.float32(away)
            is_nearer = distance < depth[window]
            depth[window][is_nearer] = distance[is_nearer]
            owner[window][is_nearer] = placed.index
            tint[window][is_nearer] = sprite.tint[is_nearer]
            shade[window][is_nearer] = sprite.shade[is_nearer]
            edge[window][is_nearer] = sprite.edge[is_nearer]
        alone = {place.placed.index: place.sprite.count for place in places}
        colours = {place.placed.index: place.placed.colour for place in places}
        return Picture(
            view,
            zoom,
            left,
            top,
            depth,
            owner,
            tint,
            shade,
            edge,
            alone,
            colours,
        )

    def _place(
        self,
        shown: Shown,
        axes: Floats,
        zoom: float,
    ) -> _Place:
        placed, shift = shown
        x, y, away = axes @ (placed.position + shift)
        sprite = self._sprite(placed, axes @ placed.rotation, zoom)
        left = round(x * zoom) + sprite.left
        top = round(y * zoom) + sprite.top
        return _Place(placed, sprite, left, top, away)

    def _sprite(
        self,
        placed: Placed,
        axes: Floats,
        zoom: float,
    ) -> Sprite:
        # Turned assemblies have axes that differ in their last digits only; rounding lets them
        # share a sprite.
        key = (placed.part.number, axes.round(4).tobytes(), zoom)
        if key not in self._sprites:
            sprite = sprite_of(placed.part, axes, zoom)
            kept_points = sum(kept.depth.size for kept in self._sprites.values())
            if kept_points + sprite.depth.size > _MAX_POINTS:
                self._sprites.clear()
            self._sprites[key] = sprite
        return self._sprites[key]


def _rounded_up(size: int, step: int) -> int:
    return size + -size % step


def extent(shown: Sequence[Shown], view: View) -> tuple[float, float]:
    """Width and height of parts in a view, LDU."""
    corners = []
    for placed, shift in shown:
        ends = np.stack(placed.part.bounds).T  # [3, 2]
        box = np.array(list(itertools.product(*ends)))  # [8, 3]
        corners.append(placed.to_plan(box) + shift)
    points = np.concatenate(corners) @ view.axes[:2].T  # [n, 2]
    width, height = np.ptp(points, axis=0)
    return float(width), float(height)
