"""Pictures of parts by a software rasterizer with a depth buffer: no OpenGL, no display."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.geometry import Bools, Floats
from bricktwin.plans.plan import Placed
from bricktwin.plans.shapes import TINTS, Tint, surface_of

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
    """

    def __init__(self, size: tuple[int, int], view: View, fitted: Sequence[Placed], drawn: Iterable[Placed] = ()) -> None:
        self.size, self._axes = size, view.axes
        self._width, self._height = size[0] * _SCALE, size[1] * _SCALE
        boxes = [placed.to_plan(np.array(list(itertools.product(*np.stack(placed.part.bounds).T)))) for placed in fitted]
        corners = [self._axes @ box.T for box in boxes]
        low = np.min([corner.min(axis=1) for corner in corners], axis=0)
        high = np.max([corner.max(axis=1) for corner in corners], axis=0)
        span = np.maximum(high - low, 1.0)
        self.zoom = 0.94 * min(self._width / span[0], self._height / span[1])
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

    def limit_zoom(self, zoom: float) -> None:
        """Set an upper limit of the zoom (points per LDU)."""
        self.zoom = min(self.zoom, zoom)

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
