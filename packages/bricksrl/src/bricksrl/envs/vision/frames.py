"""Operations on frames: detection of red objects, and area-averaged images.

A frame is uint8 ``[height, width, 3]`` in RGB and is never drawn into. Positions are ``(x, y)`` in
px of the frame, from its upper left corner.
"""

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import DescriptionError

Frame = NDArray[np.uint8]
Place = tuple[int, int]
Disc = tuple[Place, int]
"""Centre and radius in px."""

_GREEN = (0, 255, 0)
_HUE_AROUND_RED_DEG = 60.0
"""Hues within this distance of 0 have red as the strongest channel."""


@dataclass(frozen=True)
class RedWindow:
    """HSV window of colours that count as red, and the minimum area of an object. Raises
    DescriptionError if a limit is out of range.

    Attributes:
        hue_deg: lowest and highest hue; red is 0, hues below it are negative.
        saturation: lowest saturation, 0..1.
        value: lowest brightness, 0..1.
        area_px: an object is a connected region of more pixels than this.
    """

    hue_deg: tuple[float, float] = (-60.0, 24.0)
    saturation: float = 0.6
    value: float = 0.34
    area_px: int = 10

    def __post_init__(self) -> None:
        low, high = self.hue_deg
        if not -_HUE_AROUND_RED_DEG <= low <= high <= _HUE_AROUND_RED_DEG:
            raise DescriptionError(
                f"hues of {self.hue_deg} degrees are not those around red; give (low, high) "
                "within -60 to 60"
            )
        is_saturation = 0.0 < self.saturation <= 1.0
        is_value = 0.0 < self.value <= 1.0
        if not (is_saturation and is_value and self.area_px >= 0):
            raise DescriptionError(
                "a window of red needs saturation and value in 0..1, above 0, and an area_px of "
                "0 or more"
            )


def find_red(frame: Frame, window: RedWindow) -> NDArray[np.float64]:
    """Centres of the bounding boxes of the red objects in a frame ``[height, width, 3]``:
    ``[objects, 2]``."""
    pixels = _red_pixels(frame, window)
    rows, columns = np.divmod(pixels, frame.shape[1])
    if not len(rows):
        return np.empty((0, 2))
    return _middles_of_objects(rows, columns, window.area_px)


def _red_pixels(frame: Frame, window: RedWindow) -> NDArray[Any]:
    """Numbers of the pixels, counted row by row, whose colour is in the window."""
    # Hue is computed only for the few pixels that are mostly red. For this, each value of the flat
    # array is compared with the two that follow it: memory is passed through in order, and every
    # third result belongs to a red channel.
    flat = np.ascontiguousarray(frame).reshape(-1)  # [height * width * 3]
    value = flat[:-2]
    next_value = flat[1:-1]
    second_next_value = flat[2:]
    least_value = math.ceil(255 * window.value)
    is_strong = value > next_value
    is_strong &= value > second_next_value
    is_strong &= value >= least_value
    is_strong_red = is_strong[::3]
    pixels = np.flatnonzero(is_strong_red)
    colours = flat.reshape(-1, 3)[pixels]  # [pixels, 3]
    red, green, blue = colours.astype(np.float32).T  # [pixels] each
    # Hue and saturation of HSV where red is the strongest channel, so that the value is red.
    chroma = red - np.minimum(green, blue)
    hue_deg = 60.0 * (green - blue) / chroma
    low_deg, high_deg = window.hue_deg
    is_red = chroma >= window.saturation * red
    is_red &= hue_deg >= low_deg
    is_red &= hue_deg <= high_deg
    found: NDArray[np.intp] = pixels[is_red]
    return found


def _middles_of_objects(
    rows: NDArray[Any],
    columns: NDArray[Any],
    area_px: int,
) -> NDArray[np.float64]:
    """Centres ``[objects, 2]`` of the connected regions of more than ``area_px`` of these
    pixels."""
    from scipy import ndimage

    # Only the rectangle around all red pixels is labelled, which is a small part of most frames.
    top = int(rows.min())
    left = int(columns.min())
    height = int(rows.max()) - top + 1
    width = int(columns.max()) - left + 1
    mask = np.zeros((height, width), bool)
    mask[rows - top, columns - left] = True
    neighbours = np.ones((3, 3))  # pixels that touch at a corner belong together
    labels, _ = ndimage.label(mask, neighbours)  # [height, width], from 1 on; 0 is no object
    areas_px = np.bincount(labels[mask])  # by label
    boxes = ndimage.find_objects(labels)
    middles = []
    for label, (box_rows, box_columns) in enumerate(boxes, 1):
        if areas_px[label] > area_px:
            x = left + _middle(box_columns)
            y = top + _middle(box_rows)
            middles.append([x, y])
    # also without any, two columns
    return np.array(middles).reshape(-1, 2)


def _middle(places: slice) -> float:
    """The middle of the first and the last place."""
    return float((places.start + places.stop - 1) / 2)


def distances_px(centres: NDArray[np.float64], goal: Place) -> NDArray[np.float64]:
    """Distances from each of the centres ``[objects, 2]`` to the goal; ``[objects]``."""
    goal_x, goal_y = goal
    return np.hypot(centres[:, 0] - goal_x, centres[:, 1] - goal_y)


def shrink(
    frame: Frame,
    side_px: int,
    disc: Disc | None = None,
) -> Frame:
    """Area-averaged image ``[side, side, 3]`` of the frame, in which small objects stay visible;
    ties are rounded to even. ``disc``: a green disc to draw into the image; the frame is not
    changed."""
    canvas = frame.astype(np.float32)
    if disc is not None:
        draw_disc(canvas, *disc)
    # Rows first, then columns, each as a matrix product. The sums of integers are exact in single
    # precision; those of sums need double.
    row_sums = _downsample(canvas, side_px)  # [side, width, 3]
    columns = row_sums.swapaxes(0, 1).astype(float, order="C")  # [width, side, 3]
    column_sums = _downsample(columns, side_px)  # [side, side, 3], columns first
    sums = column_sums.swapaxes(0, 1)
    height, width = frame.shape[:2]
    row_weights = height // math.gcd(side_px, height)
    column_weights = width // math.gcd(side_px, width)
    means = sums / (row_weights * column_weights)
    image: Frame = np.rint(means).astype(np.uint8)
    return image


def _downsample(canvas: NDArray[Any], new_size: int) -> NDArray[Any]:
    """Rows ``[old_size, ...]`` to ``[new_size, ...]``: sums, each of ``old_size / gcd`` weights of
    a row."""
    old_size, *rest = canvas.shape
    # No new row spans two blocks: the same small matrix serves for each of them.
    blocks = math.gcd(new_size, old_size)
    new_rows = new_size // blocks
    old_rows = old_size // blocks
    weights = _overlap(new_rows, old_rows)  # [new_rows, old_rows]
    by_block = canvas.reshape(blocks, old_rows, -1)
    sums: NDArray[Any] = weights @ by_block  # [blocks, new_rows, ...]
    return sums.reshape(new_size, *rest)


@functools.lru_cache(maxsize=16)
def _overlap(new_size: int, old_size: int) -> NDArray[np.float32]:
    """Overlap of each of ``new_size`` equal parts with ``old_size`` rows, in ``1 / new_size`` rows;
    ``[new_size, old_size]``."""
    # In units that divide both: a part is ``old_size`` of them, a row ``new_size``.
    edges = np.arange(new_size + 1)[:, None] * old_size  # of the parts
    starts = np.arange(old_size) * new_size  # of the rows
    # What of each row lies before each edge: [new_size + 1, old_size]
    covered = np.clip(edges - starts, 0, new_size)
    share: NDArray[np.float32] = np.diff(covered, axis=0).astype(np.float32)
    return share


def draw_disc(
    canvas: NDArray[Any],
    centre: Place,
    radius_px: int,
) -> None:
    """Draw a green disc into ``[height, width, 3]``; it is clipped at the edges."""
    x, y = centre
    left = max(x - radius_px, 0)
    top = max(y - radius_px, 0)
    # Not below 0, which would count from the other edge.
    right = max(x + radius_px + 1, 0)
    bottom = max(y + radius_px + 1, 0)
    part = canvas[top:bottom, left:right]
    if not part.size:
        return
    down_px = np.arange(part.shape[0]) + (top - y)
    right_px = np.arange(part.shape[1]) + (left - x)
    is_inside = down_px[:, None] ** 2 + right_px**2 <= radius_px**2
    part[is_inside] = _GREEN
