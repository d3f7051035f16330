"""A photograph of a mat, straightened by its four corners: what lay askew before the camera becomes
a picture seen straight from above, one pixel a millimetre."""

import html
import math
import warnings
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.report_page import report_page

if TYPE_CHECKING:
    from PIL import Image

Floats = NDArray[np.floating[Any]]
Pixels = NDArray[np.uint8]
Ints = NDArray[np.integer[Any]]
Point = tuple[float, float]
"""Column and row in a photograph, as a viewer shows them, from its upper left corner."""
_MOST_PX = 120_000_000
"""Most pixels of a photograph: the finest phones have 108 million, which take half a gigabyte."""
_MOST_OUT_PX = 50_000_000
"""Most pixels of a picture that can be the floor."""
_LEAST_SINE = 0.05
"""Sine of the smallest angle at a corner, 3 degrees; what is flatter is three points on a line."""
_SAMPLES = 2
"""Samples along each side of a pixel; the photograph is made about as coarse as the picture
before."""
_ROWS = 64
"""Rows of the picture that are made at once, which bounds the memory."""
_WHITE_PX = 4
"""Pixels around a white point, to each side, of which the mean is taken."""
_LEAST_WHITE = 40
"""Darkest white paper, of 255."""


class _Plane(NamedTuple):
    """A homography: from shares of a mat's width and height, from its upper left corner, to pixels
    of a photograph.

    Attributes:
        rows: matrix [3, 3] of homogeneous coordinates.
    """

    rows: Floats

    def at(
        self,
        across: Floats,
        down: Floats,
    ) -> tuple[Floats, Floats]:
        """Columns and rows in the photograph [h, w] of these shares [w] and [h]."""
        values = []
        for along, below, constant in self.rows:
            rows = below * down + constant
            values.append(rows[:, None] + along * across)
        x, y, scale = values
        return x / scale, y / scale


def plane_through(corners: Floats) -> _Plane:
    """The homography that takes the corners of a mat to these ones [4, 2], from the upper left
    clockwise.

    It is the solution for a square in closed form (Heckbert, Fundamentals of Texture Mapping and
    Image Warping, 1989, section 2.2.3).
    """
    first, second, third, fourth = corners
    right = second - third
    below = fourth - third
    askew = first - second + third - fourth
    # Both are 0 for a parallelogram, which is seen without perspective.
    area = _cross(right, below)
    fade_across = _cross(askew, below) / area
    fade_down = _cross(right, askew) / area
    along = second - first + fade_across * second
    down = fourth - first + fade_down * fourth
    columns = [
        np.append(along, fade_across),
        np.append(down, fade_down),
        np.append(first, 1.0),
    ]
    return _Plane(np.column_stack(columns))


def _cross(first: Floats, second: Floats) -> float:
    """Cross product of two vectors [2]: above 0 if the second is clockwise from the first, as rows
    count downwards."""
    return float(first[0] * second[1] - first[1] * second[0])


def ordered(corners: Sequence[Point]) -> list[Point]:
    """Four corners clockwise, as a photograph shows them, beginning with the first one; the others
    may come in any order. Raises TwinError if they are no corners of a mat."""
    middle_x, middle_y = np.mean(corners, axis=0).tolist()

    def angle(corner: Point) -> float:
        # Rows count downwards, so growing angles go round clockwise.
        x, y = corner
        return math.atan2(y - middle_y, x - middle_x)

    around = sorted(corners, key=angle)
    start = around.index(corners[0])
    clockwise = [*around[start:], *around[:start]]
    befores = [clockwise[-1], *clockwise[:-1]]
    afters = [*clockwise[1:], clockwise[0]]
    for before, corner, after in zip(befores, clockwise, afters, strict=True):
        if _sine(before, corner, after) < _LEAST_SINE:
            x, y = corner
            raise TwinError(
                f"the corner {x:g},{y:g} is none: it lies on another one, or in or near the "
                "triangle of the others; give the four corners of the mat"
            )
    return clockwise


def _sine(
    before: Point,
    corner: Point,
    after: Point,
) -> float:
    """Sine of the angle of the mat at a corner: below 0 where it is dented, 0 on a line."""
    way_in = np.subtract(corner, before)
    way_out = np.subtract(after, corner)
    lengths = math.dist(before, corner) * math.dist(corner, after)
    # Two corners in one place have no angle between them.
    if not lengths:
        return 0.0
    return _cross(way_in, way_out) / lengths


def corners_page(
    path: Path,
    before: str,
    after: str,
) -> str:
    """A page on which somebody clicks the corners of the mat in a photograph, and which shows the
    command that has them: between the words ``before`` and ``after`` them. Raises TwinError if the
    photograph cannot be read."""
    _read(path)
    body = Template(resources.files(__package__).joinpath("corners.html").read_text("utf-8"))
    texts = {"photo": path.resolve().as_uri(), "before": before, "after": after}
    escaped = {name: html.escape(text) for name, text in texts.items()}
    return report_page(path.name, body.substitute(escaped))


def looks_turned(corners: Sequence[Point], size_mm: tuple[float, float]) -> bool:
    """Whether a mat of this size would rather fit if it began with the next corner: whether it
    looks high where it is wide, or wide where it is high."""
    first, second, third, fourth = ordered(corners)
    across = math.dist(first, second) + math.dist(third, fourth)
    down = math.dist(second, third) + math.dist(fourth, first)
    return (across - down) * (size_mm[0] - size_mm[1]) < 0.0


def straightened(
    path: Path,
    corners: Sequence[Point],
    size_mm: tuple[float, float],
    white: Point | None = None,
) -> "Image.Image":
    """The mat of a photograph as it is seen from above, one pixel a millimetre.

    A photograph that a phone has turned by its tag (EXIF) is taken as viewers show it. Straight
    edges have to be straight in it: a lens that bends them is not corrected.

    Args:
        corners: of the mat in the photograph: first its upper left one, the others in any order.
        size_mm: width and height of the mat.
        white: a point of white paper in the photograph, which becomes white; ``None`` leaves its
            light as it is.

    Raises:
        TwinError: if the photograph cannot be read or is too large, or these are no corners in it.
    """
    from PIL import Image

    columns, rows = (max(1, round(side)) for side in size_mm)
    if columns * rows > _MOST_OUT_PX:
        raise TwinError(
            f"a mat of {columns} x {rows} mm is too large for a picture; give its width and height "
            "in mm"
        )
    photo = _read(path)
    for corner in corners:
        _check_inside(photo, corner, path)
    around = np.array(ordered(corners))
    gains: Floats = np.ones(3)
    if white is not None:
        _check_inside(photo, white, path)
        gains = _gains(photo, white, path)
    # What is around the mat may be most of a photograph, and is not needed.
    left, top = np.floor(around.min(axis=0)).astype(int).tolist()
    right, bottom = np.ceil(around.max(axis=0)).astype(int).tolist()
    cut_out = photo.crop((left, top, right, bottom))
    # What is finer than the picture is averaged at once. Its coarsest side counts, which is the
    # one that is farthest from the camera.
    shrink = max(1, math.floor(_coarsest(around, (columns, rows))))
    pixels = np.asarray(cut_out.reduce(shrink))
    plane = plane_through((around - (left, top)) / shrink)
    bands = []
    for first in range(0, rows, _ROWS):
        light = gains * _band(pixels, plane, (columns, rows), first)
        bands.append(np.minimum(light + 0.5, 255.0).astype(np.uint8))
    return Image.fromarray(np.concatenate(bands))


def _check_inside(
    photo: "Image.Image",
    point: Point,
    path: Path,
) -> None:
    """Raise TwinError unless a point is in the photograph."""
    x, y = point
    if not (0 <= x <= photo.width and 0 <= y <= photo.height):
        raise TwinError(
            f"{x:g},{y:g} is outside of {path}, which has {photo.width} x {photo.height} pixels; "
            "give column and row as a viewer of pictures shows them"
        )


def _read(path: Path) -> "Image.Image":
    """A photograph as viewers show it."""
    from PIL import Image, ImageOps, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # A size that Pillow warns of is bounded below.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(path)
        # The file is closed once the pixels are loaded.
        if image.width * image.height > _MOST_PX:
            image.close()
            raise TwinError(
                f"{path} has {image.width} x {image.height} pixels; make it smaller: two "
                "pixels a millimetre are enough"
            )
        # In place, as a copy of a large photograph takes half a gigabyte.
        ImageOps.exif_transpose(image, in_place=True)
        image.load()
        return image if image.mode == "RGB" else image.convert("RGB")
    except FileNotFoundError:
        raise TwinError(f"there is no photograph {path}; give the path of an image") from None
    except (UnidentifiedImageError, Image.DecompressionBombError):
        raise TwinError(
            f"{path} is no image that can be read; give a JPEG or PNG file, smaller if it is huge"
        ) from None
    except (OSError, SyntaxError, ValueError) as error:
        # Pillow raises these for files that are cut off or damaged.
        raise TwinError(f"{path} cannot be read ({error}); give another image") from None


def _gains(
    photo: "Image.Image",
    white: Point,
    path: Path,
) -> Floats:
    """Factors of red, green and blue [3] that make a point white."""
    x, y = (int(value) for value in white)
    box = (
        max(0, x - _WHITE_PX),
        max(0, y - _WHITE_PX),
        min(photo.width, x + _WHITE_PX + 1),
        min(photo.height, y + _WHITE_PX + 1),
    )
    paper = np.asarray(photo.crop(box)).reshape(-1, 3).mean(axis=0)
    if paper.min() < _LEAST_WHITE:
        raise TwinError(
            f"{x},{y} in {path} is not white but red {paper[0]:.0f}, green {paper[1]:.0f}, blue "
            f"{paper[2]:.0f} of 255; give a point of white paper, or leave --white out"
        )
    return np.asarray(255.0 / paper)


def _coarsest(corners: Floats, size: tuple[int, int]) -> float:
    """Least number of pixels of a photograph for one of the picture along a side of the mat."""
    sides = np.roll(corners, -1, axis=0) - corners  # [4, 2]
    lengths = np.linalg.norm(sides, axis=1)
    return float((lengths / [*size, *size]).min())


def _band(
    pixels: Pixels,
    plane: _Plane,
    size: tuple[int, int],
    top: int,
) -> Floats:
    """Rows of the picture [rows, columns, 3] from ``top`` on: each pixel is the mean of its
    samples."""
    columns, rows = size
    bottom = min(top + _ROWS, rows)
    total = np.zeros((bottom - top, columns, 3), dtype=np.float32)
    for row, column in _samples():
        across = (np.arange(columns) + column) / columns
        down = (np.arange(top, bottom) + row) / rows
        total += _bilinear(pixels, *plane.at(across, down))
    return total / _SAMPLES**2


def _samples() -> Iterator[Point]:
    """Places of the samples within a pixel, in shares of its sides."""
    for row in range(_SAMPLES):
        for column in range(_SAMPLES):
            yield (row + 0.5) / _SAMPLES, (column + 0.5) / _SAMPLES


def _bilinear(
    pixels: Pixels,
    x: Floats,
    y: Floats,
) -> Floats:
    """Colours [h, w, 3] at columns and rows [h, w] of a photograph, between the middles of its
    pixels."""
    height, width = pixels.shape[:2]
    left, right, to_right = _between(x, width)
    upper, lower, to_lower = _between(y, height)
    above = _blend(pixels[upper, left], pixels[upper, right], to_right)
    below = _blend(pixels[lower, left], pixels[lower, right], to_right)
    return _blend(above, below, to_lower)


def _between(places: Floats, count: int) -> tuple[Ints, Ints, Floats]:
    """The pixels before and after places along a side of so many, and the shares of the way to the
    latter."""
    # The middle of the first pixel is at 0.5. Beyond the middles of the last ones, these go on.
    from_first = np.clip(places - 0.5, 0.0, count - 1.0)
    before = from_first.astype(int)
    after = np.minimum(before + 1, count - 1)
    shares = from_first - before
    return before, after, shares.astype(np.float32)


def _blend(
    first: Floats | Pixels,
    second: Floats | Pixels,
    shares: Floats,
) -> Floats:
    """Colours [h, w, 3] between two, at shares [h, w] of the way."""
    way = shares[..., None]
    return np.asarray(first * (1 - way) + second * way)
