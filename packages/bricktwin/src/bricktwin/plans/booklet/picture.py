"""Pictures of parts from one direction, put together from drawings of each part by their depths.
LDraw units.

A part looks the same wherever it stands, so that each kind is drawn once for a direction and a
scale (a `Sprite`). It needs no OpenGL and no display.
"""

import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bricktwin.plans.booklet.rays import Box, Ints, Reals, Window, around
from bricktwin.plans.booklet.sprite import (
    BRIGHTEST,
    JUMP,
    SHADES,
    Sprite,
    neighbours,
    sprite_of,
)
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing.looks import TINTS, Tint
from bricktwin.plans.geometry import Floats
from bricktwin.plans.plan import Placed

Pixels = NDArray[np.uint8]
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
_PAPER = 0
"""Number of the paper's colour in a palette, as the next two are those of lines."""
_DARK_LINE = 1
_LIGHT_LINE = 2
_MAX_POINTS = 25_000_000
"""Largest number of points of all sprites that are kept, at eight bytes each."""


@dataclass(frozen=True)
class View:
    """An orthographic view.

    Attributes:
        turn_deg: azimuth, 0 from the front (+z), positive from the robot's left.
        tilt_deg: elevation; negative from below.
    """

    turn_deg: float
    tilt_deg: float

    # A picture asks for them again for each of its parts.
    @cached_property
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


class Shown(NamedTuple):
    """A part in a picture, moved [3] away from its place."""

    placed: Placed
    shift: Floats


class _Place(NamedTuple):
    """A sprite in a picture: its first column and row, counted as those of the sprite are, and how
    far away its origin is, LDU."""

    placed: Placed
    sprite: Sprite
    left: int
    top: int
    away: float

    @property
    def box(self) -> Box:
        """Its columns and rows."""
        height, width = self.sprite.depth.shape
        return Box(
            self.left,
            self.top,
            self.left + width,
            self.top + height,
        )

    def window(
        self,
        left: int,
        top: int,
    ) -> Window:
        """Its rows and columns in a picture that begins at another column and row."""
        return self.box.window(left, top)


@functools.lru_cache(maxsize=256)
def _look(code: int, *, is_bright: bool) -> Floats:
    """Colours [coats, 3] of each coat of a sprite, in 0..1, for a part of a colour: in full colour
    or faded."""
    main = np.maximum(colour_of(code).rgb, _DARKEST)
    tones = np.array([TINTS.get(tint, main) for tint in Tint])  # [tints, 3]
    shades = np.linspace(0.0, BRIGHTEST, SHADES)
    lit = tones[:, None] * shades[:, None]  # [tints, shades, 3]
    colours = np.minimum(lit, 1.0).reshape(-1, 3)  # [coats, 3]
    is_black = main.max() < _BLACK
    line = _LIGHT_EDGE if is_black else _EDGE
    if not is_bright:
        kept = (1 - _FADED) * colours
        colours = kept + _FADED * _FADE_TO
        line = _FADED_EDGE
    return np.vstack([colours, [line] * 3])


@dataclass(frozen=True)
class Picture:
    """A picture: for each point, the index of the part that it shows (-1 for none).

    Attributes:
        view, zoom: points per LDU.
        left, top: of the first point, from the plan's origin, in points.
        places: its parts, drawn.
    """

    view: View
    zoom: float
    left: int
    top: int
    depth: Reals
    owner: Ints
    places: tuple[_Place, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.owner.shape[1], self.owner.shape[0]

    @cached_property
    def alone(self) -> dict[int, int]:
        """Number of points that each part would have without the others."""
        return {place.placed.index: place.sprite.count for place in self.places}

    def visible(self, group: Iterable[int]) -> float:
        """Share of some parts, taken as one thing, that the other parts do not hide."""
        parts = list(group)
        shown = sum(self._shown_points.get(part, 0) for part in parts)
        alone = sum(self.alone[part] for part in parts)
        return float(shown / max(alone, 1))

    @cached_property
    def _shown_points(self) -> dict[int, int]:
        """Number of points of each part that the others do not hide."""
        # The paper, which is -1, becomes 0.
        counts = np.bincount(self.owner.ravel() + 1)
        return {index - 1: int(count) for index, count in enumerate(counts)}

    def pixel_of(self, point: Floats) -> tuple[float, float]:
        """Column and row, in pixels, of a point [3] of the plan."""
        in_view = self.view.axes[:2] @ point
        x, y = in_view * self.zoom - np.array([self.left, self.top])
        return float(x), float(y)

    def hides(self, point: Floats) -> bool:
        """Whether a part is in front of a point [3] of the plan."""
        x, y = (round(value) for value in self.pixel_of(point))
        height, width = self.depth.shape
        if not (0 <= x < width and 0 <= y < height):
            return False
        # A part does not hide a point on its own surface, so only what is clearly in front counts.
        return bool(self.depth[y, x] < self.view.axes[2] @ point - JUMP)

    def pixels(
        self,
        bright: set[int] | None,
        paper: tuple[float, float, float],
        colours: int = 256,
    ) -> Pixels:
        """The picture [h, w, 4], all opaque, on paper of a colour, in at most so many ``colours``;
        ``bright``: parts in full colour, the others fade; ``None`` fades none."""
        palette = _Palette(paper)
        coats = np.full(self.owner.shape, _PAPER, dtype=np.uint16)
        dark: list[int] = []
        for place in self.places:
            index = place.placed.index
            is_bright = bright is None or index in bright
            if is_bright:
                dark.append(index)
            first = palette.first_of(place.placed.colour, is_bright=is_bright)
            window = place.window(self.left, self.top)
            is_shown = self.owner[window] == index
            if is_shown.any():
                shown = place.sprite.coat[is_shown]
                coats[window][is_shown] = shown + np.uint16(first)
        self._outline(coats, dark)
        return palette.pixels(coats, colours)

    def _outline(self, coats: Ints, dark: Sequence[int]) -> None:
        """Draw the lines between parts: dark beside these parts, and light elsewhere."""
        is_dark = np.zeros(max(self.alone) + 2, dtype=bool)
        is_dark[dark] = True
        # The line between two parts has the darker of their two tones, on both sides, so that a
        # bright part stands out from faded ones. Dark lines are drawn last, over light ones.
        for coat in (_LIGHT_LINE, _DARK_LINE):
            for first, second in neighbours():
                here = self.owner[first]
                beside = self.owner[second]
                rows, columns = np.nonzero(here != beside)
                darker = is_dark[here[rows, columns]] | is_dark[beside[rows, columns]]
                is_wanted = darker == (coat == _DARK_LINE)
                rows = rows[is_wanted]
                columns = columns[is_wanted]
                coats[first][rows, columns] = coat
                coats[second][rows, columns] = coat


class _Palette:
    """Colours of a picture, each with its number: of paper, of lines between parts, and of all
    coats of each look that a part has."""

    def __init__(self, paper: tuple[float, float, float]) -> None:
        lines = [[tone] * 3 for tone in (_EDGE, _FADED_EDGE)]
        self._tables = [np.array([paper, *lines])]
        self._firsts: dict[tuple[int, bool], int] = {}

    def first_of(self, code: int, *, is_bright: bool) -> int:
        """Number of the first coat of a part of a colour, in full colour or faded."""
        key = (code, is_bright)
        if key not in self._firsts:
            self._firsts[key] = sum(map(len, self._tables))
            self._tables.append(_look(code, is_bright=is_bright))
        return self._firsts[key]

    def pixels(self, coats: Ints, most: int) -> Pixels:
        """Opaque pixels [h, w, 4] of these coats [h, w], in at most so many colours."""
        colours = np.concatenate(self._tables)
        exact = np.round(colours * 255).astype(np.uint8)  # [n, 3]
        counts = np.bincount(coats.ravel(), minlength=len(exact))
        # Paper keeps its own colour, as the edge of the picture would else be seen on the page.
        counts[_PAPER] = 0
        used = np.flatnonzero(counts)
        if len(used) >= most:
            row = Image.fromarray(exact[used][None])
            fewer = row.quantize(most - 1, dither=Image.Dither.NONE)
            exact[used] = np.asarray(fewer.convert("RGB"))[0]
        # Taking one number a point costs a third of the time of three.
        packed = np.full((len(exact), 4), 255, dtype=np.uint8)
        packed[:, :3] = exact
        pixels = packed.view(np.uint32)[:, 0].take(coats)
        return pixels.view(np.uint8).reshape(*coats.shape, 4)


class Studio:
    """A studio that draws pictures and keeps the sprites."""

    def __init__(self) -> None:
        self._sprites: dict[tuple[str, bytes, float], Sprite] = {}
        self._kept_points = 0

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
        whole = around([place.box for place in places])
        left = whole.left - margin
        top = whole.top - margin
        height = whole.bottom - top + margin
        width = whole.right - left + margin
        size = (height, width)
        depth = np.full(size, np.inf, dtype=np.float32)
        owner = np.full(size, -1, dtype=np.int32)
        for place in places:
            window = place.window(left, top)
            distance = place.sprite.depth + np.float32(place.away)
            is_nearer = distance < depth[window]
            np.copyto(depth[window], distance, where=is_nearer)
            np.copyto(owner[window], place.placed.index, where=is_nearer)
        return Picture(
            view,
            zoom,
            left,
            top,
            depth,
            owner,
            tuple(places),
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
            self._kept_points += sprite.depth.size
            if self._kept_points > _MAX_POINTS:
                self._sprites.clear()
                self._kept_points = sprite.depth.size
            self._sprites[key] = sprite
        return self._sprites[key]


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
