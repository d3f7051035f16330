"""Picture on the floor: an image with a size in millimetres, such as a printed mat.

It keeps pixels, so that a color sensor reads them without a library for images.
"""

import math
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from brickhub.errors import TwinError

_INK = 0.07
_PAPER = 0.93
"""Reflectances of a pixel of 0 and of one of 255: those of the colors black and white of
``objects.COLORS``."""
_PX_PER_MM = 1.0
"""Most pixels a millimetre that are kept: the spot of a color sensor has a radius of 1 mm and
more."""
_LEAST_PX_PER_MM = 0.5
"""Fewest pixels a millimetre in which a line of 20 mm has edges that a sensor can follow."""
_MOST_PX = 50_000_000
_MOST_MM = 10_000.0
_LARGEST_STRETCH = 0.03
"""Largest difference of the sides' ratios of an image and of its place: sizes are rounded, and
mats are trimmed."""


@dataclass(frozen=True)
class Picture:
    """Picture on the floor. Raises TwinError if a value is invalid.

    With a heading of 0 its right side is towards x, its upper side towards y: to the left of a
    robot that looks along x.

    Attributes:
        pixels: red, green and blue of each pixel, a byte each, row by row from the upper left.
        columns: number of pixels in a row.
        size_mm: its width and height.
        at_mm: its centre.
    """

    pixels: bytes = field(repr=False)
    columns: int
    size_mm: tuple[float, float]
    at_mm: tuple[float, float] = (0.0, 0.0)
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        is_whole = self.columns > 0 and len(self.pixels) % (3 * self.columns) == 0
        if not self.pixels or not is_whole:
            raise TwinError(
                f"scene: a picture of {len(self.pixels)} bytes in rows of {self.columns} pixels; "
                "give three bytes a pixel, and whole rows"
            )
        _check_size(self.size_mm)
        if not all(math.isfinite(value) for value in (*self.at_mm, self.heading_deg)):
            raise TwinError(
                f"scene: a picture at {self.at_mm} with heading {self.heading_deg}; give a place "
                "(x, y) in mm and a heading in degrees, all finite"
            )

    @property
    def rows(self) -> int:
        """Number of rows of pixels."""
        return len(self.pixels) // (3 * self.columns)

    @cached_property
    def _turn(self) -> tuple[float, float]:
        """Cosine and sine of its rotation, counter-clockwise."""
        yaw = -math.radians(self.heading_deg)
        return math.cos(yaw), math.sin(yaw)

    def color_at(
        self,
        x_mm: float,
        y_mm: float,
    ) -> tuple[float, float, float] | None:
        """Reflectance of red, green and blue light at a point of the floor; ``None`` beside it."""
        cosine, sine = self._turn
        width_mm, height_mm = self.size_mm
        offset_x = x_mm - self.at_mm[0]
        offset_y = y_mm - self.at_mm[1]
        # In its own frame, from its upper left corner, in shares of its sides.
        across = (cosine * offset_x + sine * offset_y) / width_mm + 0.5
        down = 0.5 - (cosine * offset_y - sine * offset_x) / height_mm
        if not (0.0 <= across <= 1.0 and 0.0 <= down <= 1.0):
            return None
        # Its last edges belong to the last pixels.
        column = min(int(across * self.columns), self.columns - 1)
        row = min(int(down * self.rows), self.rows - 1)
        first = 3 * (row * self.columns + column)
        red, green, blue = self.pixels[first : first + 3]
        return _reflectance(red), _reflectance(green), _reflectance(blue)


def _reflectance(value: int) -> float:
    return _INK + (_PAPER - _INK) * value / 255


def read_picture(
    path: str | Path,
    size_mm: tuple[float, float],
    at_mm: tuple[float, float] = (0.0, 0.0),
    heading_deg: float = 0.0,
) -> Picture:
    """Picture in an image file: PNG, JPEG, or what else Pillow reads. Raises TwinError if it cannot
    be read, or has other proportions than its place.

    What is transparent is white, as paper is. More than one pixel a millimetre is averaged.

    Args:
        size_mm: width and height on the floor.
        at_mm, heading_deg: as of `Picture`.
    """
    _check_size(size_mm)
    pixels, columns = _load(Path(path), size_mm)
    return Picture(
        pixels,
        columns,
        size_mm,
        at_mm,
        heading_deg,
    )


def faults_of_picture(path: Path, size_mm: tuple[float, float]) -> list[str]:
    """What is wrong with an image file as a floor of this size, a sentence each with what to do; a
    robot can drive on one that is only coarse or transparent."""
    from PIL import Image

    try:
        read_picture(path, size_mm)
    except TwinError as error:
        return [str(error)]
    faults = []
    with Image.open(path) as image:
        px_per_mm = image.width / size_mm[0]
        if px_per_mm < _LEAST_PX_PER_MM:
            least = math.ceil(_LEAST_PX_PER_MM * size_mm[0])
            faults.append(
                f"{path} has {px_per_mm:.2g} pixels a millimetre, and a sensor sees edges of "
                f"{1 / px_per_mm:.0f} mm; give an image of {least} pixels across or more"
            )
        if image.has_transparency_data:
            faults.append(
                f"{path} is transparent in places, which are white here; give it a background"
            )
    return faults


def _load(path: Path, size_mm: tuple[float, float]) -> tuple[bytes, int]:
    """Pixels of an image file, and their number in a row."""
    # Late, as a scene without a picture, and one that is built elsewhere, needs no Pillow.
    from PIL import Image, UnidentifiedImageError

    width_mm, height_mm = size_mm
    try:
        with warnings.catch_warnings():
            # A size that Pillow warns of is refused below, in our words.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(path)
        with image:
            if image.width * image.height > _MOST_PX:
                raise TwinError(
                    f"{path} has {image.width} x {image.height} pixels; make it smaller: one "
                    "pixel a millimetre is enough"
                )
            stretch = image.width * height_mm / (image.height * width_mm)
            if abs(math.log(stretch)) > _LARGEST_STRETCH:
                fitting_mm = round(width_mm * image.height / image.width)
                raise TwinError(
                    f"{path} has {image.width} x {image.height} pixels, which would be stretched "
                    f"on {width_mm:g} x {height_mm:g} mm; give its own size, such as "
                    f"{width_mm:g}x{fitting_mm}"
                )
            columns = min(image.width, max(1, round(width_mm * _PX_PER_MM)))
            rows = min(image.height, max(1, round(height_mm * _PX_PER_MM)))
            colored = image.convert("RGBA")
            paper = Image.new("RGBA", colored.size, "white")
            printed = Image.alpha_composite(paper, colored).convert("RGB")
            scaled = printed.resize((columns, rows), Image.Resampling.BOX)
            return scaled.tobytes(), columns
    except FileNotFoundError:
        raise TwinError(f"there is no picture {path}; give the path of an image") from None
    except (UnidentifiedImageError, Image.DecompressionBombError):
        raise TwinError(f"{path} is no image that can be read; give a PNG or JPEG file") from None
    except (OSError, SyntaxError, ValueError) as error:
        # Pillow raises these for files that are cut off or damaged.
        raise TwinError(f"{path} cannot be read ({error}); give another image") from None


def _check_size(size_mm: tuple[float, float]) -> None:
    try:
        width_mm, height_mm = map(float, size_mm)
    except (TypeError, ValueError):
        # No pair of numbers.
        width_mm = height_mm = math.nan
    if not (0.0 < width_mm <= _MOST_MM and 0.0 < height_mm <= _MOST_MM):
        raise TwinError(
            f"scene: a picture of {size_mm} mm; give its width and height, up to {_MOST_MM:g} mm"
        )
