"""``Image``, ``Font`` and ``ImageFile`` of ``pybricks.parameters``, and an EV3's screen
(``pb_type_image.c``, ``pb_type_font.c``, v4)."""

from typing import Any

from brickhub.virtual.micropython.text import representation
from brickhub.virtual.pybricks.arguments import (
    expect_type,
    get_exact_int,
    get_int,
)
from brickhub.virtual.pybricks.context import Context, Native, bind
from brickhub.virtual.pybricks.parameters import Color
from brickhub.virtual.raster import LIBERATION, MONO, TERMINUS, Raster, Typeface

_BLACK = 3
_WHITE = 0
# Shares of white above which a color becomes a lighter shade, in hundredths of a percent.
_SPLITS = (2105, 5526, 8421)
_HEAP_BYTES = 2 * 1024 * 1024
"""Memory for the pixels of images, beside that of programs (``platform.ld``)."""


def shade(color: Any) -> int:
    """Shade of a ``Color``; a number is a shade itself, ``None`` is black."""
    if color is None:
        return _BLACK
    if isinstance(color, int):
        return int(color)
    expect_type(color, Color)
    white: int = color.v * (100 - color.s // 2)
    return _BLACK - sum(white >= split for split in _SPLITS)


class Font(Native):
    """Font of the firmware; a program can make none."""

    _typeface: Typeface
    DEFAULT: "Font"
    TERMINUS_16: "Font"
    LIBERATIONSANS_14: "Font"
    MONO_8X5_8: "Font"

    def __new__(cls, *_: Any, **__: Any) -> "Font":
        raise TypeError("can't create 'Font' instances")

    @property
    def family(self) -> str:
        return self._typeface.family

    @property
    def style(self) -> str:
        return self._typeface.style

    @property
    def width(self) -> int:
        return max(self._typeface.advances)

    @property
    def height(self) -> int:
        return self._typeface.line_height

    def text_width(self, text: Any) -> int:
        width, _ = self._typeface.size(_text(text))
        return width

    def text_height(self, text: Any) -> int:
        _, height = self._typeface.size(_text(text))
        return height


_FONTS = {
    "DEFAULT": TERMINUS,
    "TERMINUS_16": TERMINUS,
    "LIBERATIONSANS_14": LIBERATION,
    "MONO_8X5_8": MONO,
}


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")
    return value


class Image(Native):
    """An image, or with ``sub`` a part of one: what is drawn into the part is in both."""

    _raster: Raster
    _used_bytes = 0

    def __init__(
        self,
        source: Any,
        sub: Any = False,
        x1: Any = 0,
        y1: Any = 0,
        x2: Any = None,
        y2: Any = None,
    ) -> None:
        expect_type(source, Image)
        whole: Raster = source._raster
        if not sub:
            self._raster = self._allocated(whole.width, whole.height)
            self._raster.typeface = whole.typeface
            self._raster.image(whole, 0, 0)
            return
        left = get_int(x1)
        top = get_int(y1)
        right = whole.width - 1 if x2 is None else get_int(x2)
        bottom = whole.height - 1 if y2 is None else get_int(y2)
        self._raster = whole.part(left, top, right - left + 1, bottom - top + 1)

    @classmethod
    def _allocated(cls, width: int, height: int) -> Raster:
        """A new image. Raises MemoryError if all of them have no room."""
        # Nothing tells when a program drops an image, so each one counts until the program ends.
        cls._used_bytes += width * height
        if cls._used_bytes > _HEAP_BYTES:
            raise MemoryError
        return Raster(width, height)

    @property
    def width(self) -> int:
        return self._raster.width

    @property
    def height(self) -> int:
        return self._raster.height

    def clear(self) -> None:
        self._raster.fill(_WHITE)
        self._shown()

    def load_image(self, source: Any) -> None:
        expect_type(source, Image)
        raster = self._raster
        image: Raster = source._raster
        raster.fill(_WHITE)
        # The firmware's division is towards zero, for an image that is larger too.
        x = int((raster.width - image.width) / 2)
        y = int((raster.height - image.height) / 2)
        raster.image(image, x, y)
        self._shown()

    def draw_image(
        self,
        x: Any,
        y: Any,
        source: Any,
        transparent: Any = None,
    ) -> None:
        left = get_exact_int(x)
        top = get_exact_int(y)
        expect_type(source, Image)
        value = None if transparent is None else shade(transparent)
        self._raster.image(source._raster, left, top, value)
        self._shown()

    def draw_pixel(
        self,
        x: Any,
        y: Any,
        color: Any = None,
    ) -> None:
        self._raster.pixel(get_int(x), get_int(y), shade(color))
        self._shown()

    def draw_line(
        self,
        x1: Any,
        y1: Any,
        x2: Any,
        y2: Any,
        width: Any = 1,
        color: Any = None,
    ) -> None:
        ends = get_int(x1), get_int(y1), get_int(x2), get_int(y2)
        self._raster.line(*ends, get_int(width), shade(color))
        self._shown()

    def draw_box(
        self,
        x1: Any,
        y1: Any,
        x2: Any,
        y2: Any,
        r: Any = 0,
        fill: Any = False,
        color: Any = None,
    ) -> None:
        left = get_int(x1)
        top = get_int(y1)
        width = get_int(x2) - left + 1
        height = get_int(y2) - top + 1
        self._raster.rounded_box(
            left,
            top,
            width,
            height,
            get_int(r),
            shade(color),
            is_filled=bool(fill),
        )
        self._shown()

    def draw_circle(
        self,
        x: Any,
        y: Any,
        r: Any,
        fill: Any = False,
        color: Any = None,
    ) -> None:
        middle = get_int(x), get_int(y)
        self._raster.circle(*middle, get_int(r), shade(color), is_filled=bool(fill))
        self._shown()

    def draw_text(
        self,
        x: Any,
        y: Any,
        text: Any,
        text_color: Any = None,
        background_color: Any = None,
    ) -> None:
        left = get_int(x)
        top = get_int(y)
        written = _text(text)
        value = shade(text_color)
        raster = self._raster
        if background_color is not None:
            width, height = raster.typeface.size(written)
            raster.box(left - 1, top - 1, width + 2, height + 2, shade(background_color))
        raster.text(left, top, written, value)
        self._shown()

    def print(
        self,
        *values: Any,
        sep: Any = " ",
        end: Any = "\n",
    ) -> None:
        shown = [value if isinstance(value, str) else representation(value) for value in values]
        written = _text(sep).join(shown) + _text(end)
        self._raster.print(written, _BLACK)
        self._shown()

    def set_font(self, font: Any) -> None:
        expect_type(font, Font)
        self._raster.typeface = font._typeface

    def _shown(self) -> None:
        """Show what was drawn, if this is the screen."""


class Screen(Image):
    """The screen of the brick, which a program takes over by drawing on it."""

    def __init__(self, width: int, height: int) -> None:
        self._raster = Raster(width, height)

    def set_font(self, font: Any) -> None:
        super().set_font(font)
        self._shown()

    def _shown(self) -> None:
        self._machine.panel.change(screen=bytes(self._raster.pixels))
        self._machine.charge_drawing()


Screen.__name__ = Screen.__qualname__ = "Image"


class ImageFile:
    """The pictures of the firmware, none of which has a public name."""

    def __call__(self, *_: Any, **__: Any) -> None:
        return None

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"'ImageFile' object has no attribute '{name}'")


def image_names(context: Context, screen_pixels: tuple[int, int]) -> dict[str, Any]:
    """Names for ``pybricks.parameters`` on a hub with a screen of this size."""
    screen_width, screen_height = screen_pixels
    image: Any = bind(context, Image)
    font: Any = bind(context, Font)
    for name, typeface in _FONTS.items():
        member = object.__new__(font)
        member._typeface = typeface
        setattr(font, name, member)

    def empty(width: Any = None, height: Any = None) -> Any:
        columns = screen_width if width is None else get_exact_int(width)
        rows = screen_height if height is None else get_exact_int(height)
        if columns < 1 or rows < 1:
            raise ValueError("Image width or height is less than 1")
        made = object.__new__(image)
        made._raster = image._allocated(columns, rows)
        return made

    image.empty = staticmethod(empty)
    return {"Image": image, "Font": font, "ImageFile": ImageFile()}
