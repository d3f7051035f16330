"""Pixels of an EV3's screen, and how its firmware draws into them (``pbio/src/image/image.c``, v4).

Values are shades: 0 is white, 3 is black. What lies outside of an image is not drawn.
"""

from collections.abc import Iterator
from dataclasses import dataclass

_MOST = 10_000
"""Largest radius, and width of a line, that is drawn; a brick would draw for minutes."""
_COLUMNS = 5
_ROWS = 7
# Shapes of the characters from 32 to 126, ours: seven rows of five pixels, each row a digit in
# base 32, and a space.
_SHAPES = (
    "0000000 4444004 aaa0000 aavavaa 4fke5u4 op248j3 cik8lid c480000 2488842 8422248 "
    "04lel40 044v440 0000c48 000v000 00000cc 01248g0 ehjlphe 4c4444e eh1248v v2421he "
    "26aiv22 vgu11he 68guhhe v124888 ehhehhe ehhf12c 0cc0cc0 0cc0c48 248g842 00v0v00 "
    "8421248 eh12404 eh1dlle ehhvhhh uhhuhhu ehggghe uhhhhhu vgguggv vgguggg ehgnhhf "
    "hhhvhhh e44444e 72222ic hikokih ggggggv hrllhhh hhpljhh ehhhhhe uhhuggg ehhhlid "
    "uhhukih fgge11u v444444 hhhhhhe hhhhha4 hhhllla hha4ahh hha4444 v1248gv e88888e "
    "0g84210 e22222e 4ah0000 000000v 8420000 00e1fhf ggmphhu 00egghe 11djhhf 00ehvge "
    "698s888 0fhhf1e ggmphhh 40c444e 20622ic ggikoki c44444e 00qllhh 00mphhh 00ehhhe "
    "00uhugg 00djf11 00mpggg 00fge1u 88s8896 00hhhjd 00hhha4 00hhlla 00ha4ah 00hhf1e "
    "00v248v 2448442 4444444 8442448 008l200 "
)
_SHAPE_STEP = _ROWS + 1
_FIRST = ord(" ")


@dataclass(frozen=True)
class Typeface:
    """Measures of a font of the firmware; the shapes of its characters are ours.

    Attributes:
        family, style: its names.
        advances: from a character to the next one, of all from 32 to 126, or of each.
        line_height: between two baselines.
        top: of the highest character above the baseline.
        gap: empty columns at the end of a character.
        shape_rows: rows of a capital.
    """

    family: str
    style: str
    advances: tuple[int, ...]
    line_height: int
    top: int
    gap: int
    shape_rows: int

    def advance(self, char: str) -> int:
        """Pixels from a character to the next one."""
        index = ord(char) - _FIRST
        return self.advances[index if len(self.advances) > 1 else 0]

    def size(self, text: str) -> tuple[int, int]:
        """Width and height of a text."""
        lines = text.split("\n")
        widths = []
        for line in lines:
            advances = [self.advance(char) for char in line if is_drawn(char)]
            widths.append(sum(advances) - self.gap if advances else 0)
        if not any(widths):
            return 0, 0
        return max(widths), self.line_height * len(lines)


TERMINUS = Typeface("Terminus", "Medium", (8,), 16, 12, 0, 10)
MONO = Typeface("Mono 8x5", "Regular", (6,), 8, 8, 1, 7)
# fmt: off
LIBERATION = Typeface("Liberation Sans", "Regular", (
    4, 4, 5, 8, 8, 12, 9, 3, 5, 5, 5, 8, 4, 5, 4, 4, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 4, 4, 8, 8, 8, 8,
    14, 9, 9, 10, 10, 9, 9, 11, 10, 4, 7, 9, 8, 12, 10, 11, 9, 11, 10, 9, 9, 10, 9, 13, 9, 9, 9, 4,
    4, 4, 7, 8, 5, 8, 8, 7, 8, 8, 4, 8, 8, 3, 3, 7, 3, 12, 8, 8, 8, 8, 5, 7, 4, 8, 7, 10, 7, 7, 7,
    5, 4, 5, 8,
), 16, 11, 0, 10)
# fmt: on


def is_drawn(char: str) -> bool:
    """Whether a font has a shape of a character."""
    return " " <= char <= "~"


class Raster:
    """An image, or a part of one with the same pixels.

    Attributes:
        pixels: of the whole image, row by row.
        typeface: of what is printed.
    """

    def __init__(self, width: int, height: int, typeface: Typeface = TERMINUS) -> None:
        self.width = width
        self.height = height
        self.pixels = bytearray(width * height)
        self.typeface = typeface
        self._stride = width
        self._origin = 0
        self._print_x = 0
        self._print_y = 0

    def part(self, x: int, y: int, width: int, height: int) -> "Raster":
        """The part that lies within the image; empty if none does."""
        right = min(x + width, self.width)
        bottom = min(y + height, self.height)
        left = max(x, 0)
        top = max(y, 0)
        part = Raster(0, 0, self.typeface)
        part.pixels = self.pixels
        if left < right and top < bottom:
            part.width = right - left
            part.height = bottom - top
            part._stride = self._stride
            part._origin = self._origin + top * self._stride + left
        return part

    def rows(self) -> Iterator[bytes]:
        """The rows, from the top."""
        for y in range(self.height):
            start = self._origin + y * self._stride
            yield bytes(self.pixels[start : start + self.width])

    def fill(self, value: int) -> None:
        """Fill it, and print from its upper left corner again."""
        self.box(0, 0, self.width, self.height, value)
        self._print_x = 0
        self._print_y = 0

    def pixel(self, x: int, y: int, value: int) -> None:
        if 0 <= x < self.width and 0 <= y < self.height:
            self.pixels[self._origin + y * self._stride + x] = value & 0xFF

    def across(self, x: int, y: int, length: int, value: int) -> None:
        """A line to the right."""
        right = min(x + length, self.width)
        left = max(x, 0)
        if left < right and 0 <= y < self.height:
            start = self._origin + y * self._stride
            self.pixels[start + left : start + right] = bytes((value & 0xFF,)) * (right - left)

    def down(self, x: int, y: int, length: int, value: int) -> None:
        """A line downwards."""
        for row in range(max(y, 0), min(y + length, self.height)):
            self.pixel(x, row, value)

    def box(self, x: int, y: int, width: int, height: int, value: int) -> None:
        """A filled rectangle."""
        for row in range(max(y, 0), min(y + height, self.height)):
            self.across(x, row, width, value)

    def image(self, source: "Raster", x: int, y: int, transparent: int | None = None) -> None:
        """Another image, without its pixels of the transparent value."""
        for row, values in enumerate(source.rows(), y):
            for column, value in enumerate(values, x):
                if value != transparent:
                    self.pixel(column, row, value)

    def line(self, x1: int, y1: int, x2: int, y2: int, width: int, value: int) -> None:
        """A line with both ends; one of an even width is thicker on its left side."""
        is_flat = abs(x2 - x1) >= abs(y2 - y1)
        # A flat line is drawn from left to right and a steep one from top to bottom, so that it is
        # the same from either end.
        is_backwards = x2 <= x1 if is_flat else y2 <= y1
        if is_backwards:
            x1, y1, x2, y2 = x2, y2, x1, y1
        for index in range(min(width, _MOST)):
            shift = index - width // 2
            if is_backwards == is_flat:
                shift = -shift
            if is_flat:
                self._thin_line(x1, y1 + shift, x2, y2 + shift, value, is_flat=True)
            else:
                # The axes change places, so that the line becomes a flat one.
                self._thin_line(y1, x1 + shift, y2, x2 + shift, value, is_flat=False)

    def _thin_line(self, a1: int, b1: int, a2: int, b2: int, value: int, *, is_flat: bool) -> None:
        """A line from ``a1`` to ``a2`` along one axis, which rises along the other one by its
        length at most."""
        length = a2 - a1
        rise = abs(b2 - b1)
        direction = 1 if b2 >= b1 else -1
        limit = self.width if is_flat else self.height
        if a1 >= limit or a2 < 0:
            return
        # Twice the error, from the middle between two pixels.
        error = -length
        b = b1
        if a1 < 0 and rise:
            error += -a1 * rise * 2
            skipped = (error + 2 * length) // (2 * length)
            error -= skipped * 2 * length
            b += skipped * direction
        for a in range(max(a1, 0), min(a2, limit - 1) + 1):
            if is_flat:
                self.pixel(a, b, value)
            else:
                self.pixel(b, a, value)
            error += 2 * rise
            if error >= 0 and rise:
                error -= 2 * length
                b += direction

    def rounded_box(
        self,
        x: int,
        y: int,
        width: int,
        height: int,
        radius: int,
        value: int,
        *,
        is_filled: bool,
    ) -> None:
        """A rectangle with round corners, as far as they fit."""
        if width <= 0 or height <= 0:
            return
        r = min(radius, (width - 1) // 2, (height - 1) // 2, _MOST)
        if r < 1:
            self._square_box(x, y, width, height, value, is_filled=is_filled)
            return
        left = x + r
        top = y + r
        right = x + width - 1 - r
        bottom = y + height - 1 - r
        dx = 0
        dy = r
        while dx <= dy if is_filled else dx < dy:
            if not is_filled:
                dx += 1
                dy -= dx * dx + dy * dy > r * r
            for a, b in ((dx, dy), (dy, dx)):
                if is_filled:
                    self.across(left - a, top - b, right - left + 1 + 2 * a, value)
                    self.across(left - a, bottom + b, right - left + 1 + 2 * a, value)
                    continue
                for column in (left - a, right + a):
                    self.pixel(column, top - b, value)
                    self.pixel(column, bottom + b, value)
            if is_filled:
                dx += 1
                dy -= dx * dx + dy * dy > r * r
        if is_filled:
            self.box(x, top + 1, width, height - 2 - 2 * r, value)
            return
        self.across(left, y, width - 2 * r, value)
        self.across(left, y + height - 1, width - 2 * r, value)
        self.down(x, top, height - 2 * r, value)
        self.down(x + width - 1, top, height - 2 * r, value)

    def _square_box(
        self, x: int, y: int, width: int, height: int, value: int, *, is_filled: bool
    ) -> None:
        if is_filled:
            self.box(x, y, width, height, value)
            return
        self.across(x, y, width, value)
        self.across(x, y + height - 1, width, value)
        self.down(x, y, height, value)
        self.down(x + width - 1, y, height, value)

    def circle(self, x: int, y: int, radius: int, value: int, *, is_filled: bool) -> None:
        """A circle, or a disc, around a pixel."""
        radius = min(radius, _MOST)
        dx = 0
        dy = radius
        error = 5 - 4 * radius
        while radius > 0 and dx <= dy:
            for a, b in ((dx, dy), (dy, dx)):
                for row in (y - b, y + b):
                    if is_filled:
                        self.across(x - a, row, 1 + 2 * a, value)
                    else:
                        self.pixel(x - a, row, value)
                        self.pixel(x + a, row, value)
            if error > 0:
                dy -= 1
                error -= 8 * dy
            dx += 1
            error += 4 + 8 * dx

    def text(self, x: int, y: int, text: str, value: int) -> None:
        """A text whose upper left corner is there."""
        pen = x
        for char in text:
            if char == "\n":
                pen = x
                y += self.typeface.line_height
            elif is_drawn(char):
                self._char(pen, y, char, value)
                pen += self.typeface.advance(char)

    def print(self, text: str, value: int) -> None:
        """Print as on a terminal: it goes on in the next line at the right end, and scrolls up at
        the lower one."""
        face = self.typeface
        for char in text:
            if char == "\n":
                self._print_x = 0
                self._print_y += face.line_height
                continue
            if not is_drawn(char):
                continue
            if self._print_x + face.advance(char) - face.gap > self.width:
                self._print_x = 0
                self._print_y += face.line_height
            is_below = self._print_y + face.line_height > self.height
            if is_below and self._print_y >= face.line_height:
                self._scroll_up(face.line_height)
                self._print_y -= face.line_height
            self._char(self._print_x, self._print_y, char, value)
            self._print_x += face.advance(char)

    def _scroll_up(self, rows: int) -> None:
        kept = list(self.rows())[rows:]
        for y, values in enumerate(kept):
            start = self._origin + y * self._stride
            self.pixels[start : start + self.width] = values
        self.box(0, len(kept), self.width, rows, 0)

    def _char(self, x: int, y: int, char: str, value: int) -> None:
        face = self.typeface
        first = (ord(char) - _FIRST) * _SHAPE_STEP
        shape = _SHAPES[first : first + _ROWS]
        left = x + max(0, (face.advance(char) - _COLUMNS) // 2)
        # A shape stands on the baseline, stretched to the height of the font.
        top = y + face.top - face.shape_rows
        for row in range(face.shape_rows):
            bits = int(shape[row * _ROWS // face.shape_rows], 32)
            for column in range(_COLUMNS):
                if bits & 1 << (_COLUMNS - 1 - column):
                    self.pixel(left + column, top + row, value)
