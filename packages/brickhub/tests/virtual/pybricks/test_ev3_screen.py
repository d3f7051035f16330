"""Screen of an EV3 Brick: what a program draws, and what it may not."""

from __future__ import annotations

import random
import zlib

import pytest
from hub_programs import Console

from brickhub.robot import HubKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules
from brickhub.virtual.raster import MONO, TERMINUS, Raster

HEAD = """
from pybricks.hubs import EV3Brick
from pybricks.parameters import Color, Font, Image, ImageFile
ev3 = EV3Brick()
screen = ev3.screen
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except Exception as raised:
        return "%s: %s" % (type(raised).__name__ if hasattr(type(raised), "__name__") else type(raised), raised)
"""  # noqa: E501
WIDTH, HEIGHT = 178, 128
CHECKSUMS = (
    (0, 1935565091),
    (1, 403665286),
    (2, 474734342),
    (3, 2100602039),
    (4, 2483036991),
)


def shown(source: str) -> tuple[list[bytes], str]:
    """Rows of the screen after a program, and what it printed."""
    machine = Machine(FittedBench(HubKind.EV3))
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    pixels = machine.panel.screen
    rows = [pixels[start : start + WIDTH] for start in range(0, len(pixels), WIDTH)]
    return rows, console.written.decode().replace("\r\n", "\n")


def drawn(seed: int) -> Raster:
    """A random picture of lines, boxes and circles, many of them beyond the edges."""
    rng = random.Random(seed)
    image = Raster(WIDTH, HEIGHT)
    for _ in range(30):
        a, b, c, d = (rng.randint(-40, 180) for _ in range(4))
        size, value = rng.randint(-1, 40), rng.randint(0, 3)
        is_filled = rng.random() < 0.5
        match rng.randrange(4):
            case 0:
                image.line(a, b, c, d, size // 6, value)
            case 1:
                image.rounded_box(a, b, c, d, size, value, is_filled=is_filled)
            case 2:
                image.circle(a, b, size, value, is_filled=is_filled)
            case _:
                image.part(a, b, c, d).circle(20, 5, size, value, is_filled=is_filled)
    return image


@pytest.mark.parametrize(("seed", "checksum"), CHECKSUMS)
def test_pictures_are_those_of_the_firmware(seed: int, checksum: int) -> None:
    """Checksums of the pictures that ``pbio/src/image/image.c`` (v4.1.0b2) draws."""
    assert zlib.crc32(bytes(drawn(seed).pixels)) == checksum


def test_a_program_takes_the_screen_over_when_it_draws() -> None:
    rows, printed = shown("print(screen.width, screen.height)")
    assert (rows, printed) == ([], "178 128\n")
    rows, _ = shown("screen.draw_box(1, 2, 4, 4)")
    assert [row[:6].hex() for row in rows[1:6]] == [
        "000000000000",
        "000303030300",
        "000300000300",
        "000303030300",
        "000000000000",
    ]


def test_colors_are_four_shades() -> None:
    source = """
for x, color in enumerate((Color.BLACK, Color.GRAY, Color.RED, Color.WHITE, Color.YELLOW * 0.8, 2)):
    screen.draw_pixel(x, 0, color)
"""
    rows, _ = shown(source)
    assert list(rows[0][:6]) == [3, 2, 2, 0, 2, 2]


def test_each_shape_has_the_place_the_shade_and_the_filling_that_a_program_gives() -> None:
    """By the raster, whose pictures are the firmware's."""
    source = """
screen.draw_line(3, 4, 60, 30, 5, Color.GRAY)
screen.draw_line(100, 4, 60, 90)
screen.draw_box(70, 10, 90, 40, 6, True, Color.GRAY)
screen.draw_box(100, 50, 120, 80)
screen.draw_circle(140, 30, 12)
screen.draw_circle(140, 90, 10, True, Color.GRAY)
screen.draw_text(5, 60, "Ag", Color.GRAY)
screen.set_font(Font.MONO_8X5_8)
screen.draw_text(5, 100, "Ag")
screen.draw_text(40, 100, "Ag", Color.WHITE, Color.BLACK)
"""
    expected = Raster(WIDTH, HEIGHT)
    expected.line(3, 4, 60, 30, 5, 2)
    expected.line(100, 4, 60, 90, 1, 3)
    expected.rounded_box(70, 10, 21, 31, 6, 2, is_filled=True)
    expected.rounded_box(100, 50, 21, 31, 0, 3, is_filled=False)
    expected.circle(140, 30, 12, 3, is_filled=False)
    expected.circle(140, 90, 10, 2, is_filled=True)
    expected.text(5, 60, "Ag", 2)
    expected.typeface = MONO
    expected.text(5, 100, "Ag", 3)
    width, height = MONO.size("Ag")
    expected.box(39, 99, width + 2, height + 2, 3)
    expected.text(40, 100, "Ag", 0)
    assert b"".join(shown(source)[0]) == bytes(expected.pixels)


def test_text_is_written_from_the_left_line_by_line() -> None:
    image = Raster(WIDTH, HEIGHT)
    image.text(10, 20, "i\ni", 3)
    rows = [
        bytes(image.pixels[start : start + WIDTH]) for start in range(0, len(image.pixels), WIDTH)
    ]
    height = TERMINUS.line_height
    assert rows[20 : 20 + height] == rows[20 + height : 20 + 2 * height] and any(
        rows[20 + height // 2]
    )
    assert not any(map(any, rows[:20])) and not any(map(any, rows[20 + 2 * height :]))
    assert not any(any(row[:10]) for row in rows)


def test_a_picture_in_the_middle_and_parts_up_to_the_edge() -> None:
    source = """
small = Image.empty(10, 6)
small.draw_box(0, 0, 9, 5)
screen.draw_pixel(0, 0)
screen.load_image(small)
part = Image(screen, sub=True, x1=170, y1=120, x2=173, y2=121)
print(part.width, part.height, Image(screen, sub=True, x1=170, y1=120).width)
print(Image.empty().width, Image.empty().height, Image.empty(5).height, Image.empty(1, 1).width)
print(Font.DEFAULT.style, Font.LIBERATIONSANS_14.style)
"""
    rows, printed = shown(source)
    assert printed == "4 2 8\n178 128 128 1\nMedium Regular\n"
    dark = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
    assert (min(dark), max(dark)) == ((84, 61), (93, 66)), "what was there is gone"
    assert len(dark) == 2 * 10 + 2 * 4


def test_images_fill_the_memory_that_they_have() -> None:
    source = """
def many(count):
    for _ in range(count):
        Image.empty(1024, 1024)
print(error(many, 2), "MemoryError" in error(many, 1))
"""
    assert shown(source)[1] == "None True\n"


def test_parts_and_copies() -> None:
    source = """
part = Image(screen, sub=True, x1=10, y1=20)
part.draw_pixel(0, 0)
copy = Image(screen)
screen.clear()
print(part.width, part.height, copy.width)
screen.draw_image(-10, -20, copy)
small = Image.empty(2, 2)
small.draw_pixel(0, 0)
screen.draw_image(0, 0, small, transparent=0)
other = Image.empty(4, 4)
other.load_image(small)
screen.draw_image(100, 100, other)
"""
    rows, printed = shown(source)
    assert printed == "168 108 178\n"
    assert rows[0][0] == 3 and rows[101][101] == 3
    assert sum(map(sum, rows)) == 6


def test_text_wraps_and_scrolls() -> None:
    rows, _ = shown("screen.print('x' * 23)\nscreen.print(1, [2, 'b'], None, sep='-')")
    dark = [any(row) for row in rows]
    assert dark[:16].count(True) and dark[16:32].count(True) and dark[32:48].count(True)
    rows, _ = shown("for line in range(9):\n    screen.print(line)")
    # The ninth line of 16 pixels needs the room of the first one.
    eight, _ = shown("for line in range(1, 9):\n    screen.print(line)")
    assert rows == eight


def test_measures_of_fonts() -> None:
    source = """
print(Font.DEFAULT.text_width("abc"), Font.TERMINUS_16.height, Font.DEFAULT.family)
print(Font.MONO_8X5_8.text_width("abc"), Font.MONO_8X5_8.text_height("a\\nb"), Font.MONO_8X5_8.width)
font = Font.LIBERATIONSANS_14
print(font.width > font.text_width("l"), font.width >= font.text_width("W"))
"""  # noqa: E501
    # The width of a font is that of its widest letter.
    assert shown(source)[1] == "24 16 Terminus\n17 16 6\nTrue True\n"
    assert TERMINUS.size("") == (0, 0)


def test_what_pybricks_2_had_raises() -> None:
    source = """
print(error(screen.load_image, "x.png"))
print(error(lambda: ImageFile.AWAKE), ImageFile("x"))
print(error(Font, size=24))
print(error(screen.draw_text, 0, 0, 5))
print(error(lambda: screen.save))
print(error(lambda: ev3.speaker.say))
print(error(Image.empty, 0))
print(error(Image.empty, 2000, 2000))
"""
    assert [line.partition(": ")[2] for line in shown(source)[1].splitlines()] == [
        "can't convert str to Image",
        "'ImageFile' object has no attribute 'AWAKE' None",
        "can't create 'Font' instances",
        "can't convert 'int' object to str implicitly",
        "'Image' object has no attribute 'save'",
        "'Speaker' object has no attribute 'say'",
        "Image width or height is less than 1",
        "",
    ]
