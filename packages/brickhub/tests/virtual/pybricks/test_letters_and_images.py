"""Letters on an EV3's screen, how they follow each other, and images within images."""

from __future__ import annotations

import pytest
from hub_programs import Console

from brickhub.robot import HubKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules
from brickhub.virtual.raster import LIBERATION, MONO, TERMINUS, Raster, Typeface

HEAD = """
from pybricks.hubs import EV3Brick
from pybricks.parameters import Color, Font, Image
screen = EV3Brick().screen
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except Exception as raised:
        return repr(raised)
"""
ARIAL_UNITS = {
    569: " !,./:;I[\\]ft",
    727: '"',
    1139: "#$0123456789?L_abdeghnopqu",
    1821: "%",
    1366: "&ABEKPSVXY",
    391: "'",
    682: "()-`r",
    797: "*",
    1196: "+<=>~",
    2079: "@",
    1479: "CDHNRUw",
    1251: "FTZ",
    1593: "GOQ",
    1024: "Jcksvxyz",
    1706: "Mm",
    1933: "W",
    961: "^",
    455: "ijl",
    684: "{}",
    532: "|",
}
"""Advances of Arial, whose measures Liberation Sans has, in 2048th of its size."""


def picture(image: Raster) -> list[str]:
    return ["".join(".123"[value] for value in row) for row in image.rows()]


def written(text: str, face: Typeface, width: int, height: int) -> list[str]:
    image = Raster(width, height, face)
    image.text(0, 0, text, 1)
    return picture(image)


def test_advances_of_liberation_sans_are_those_of_arial() -> None:
    advances = {char: units * 14 / 2048 for units, chars in ARIAL_UNITS.items() for char in chars}
    assert len(advances) == 95
    for char, pixels in advances.items():
        assert LIBERATION.advance(char) == round(pixels), char


def test_letters_of_the_small_font() -> None:
    """Five columns, below one empty row; the sixth column is the gap to the next letter."""
    assert written("AL", MONO, 12, 8) == [
        "............",
        ".111..1.....",
        "1...1.1.....",
        "1...1.1.....",
        "11111.1.....",
        "1...1.1.....",
        "1...1.1.....",
        "1...1.11111.",
    ]


def test_letters_of_the_large_fonts_are_stretched_to_ten_rows() -> None:
    tall = [
        ".111.",
        ".111.",
        "1...1",
        "1...1",
        "1...1",
        "11111",
        "1...1",
        "1...1",
        "1...1",
        "1...1",
    ]
    terminus = written("A", TERMINUS, 8, 16)
    assert terminus[2:12] == [f".{row}.." for row in tall]
    liberation = written("A", LIBERATION, 9, 16)
    assert liberation[1:11] == [f"..{row}.." for row in tall]
    for rows, first, last in ((terminus, 2, 12), (liberation, 1, 11)):
        outside = rows[:first] + rows[last:]
        assert set("".join(outside)) == {"."}


@pytest.mark.parametrize(
    ("face", "text", "size"),
    [
        (TERMINUS, "a", (8, 16)),
        (TERMINUS, "abc", (24, 16)),
        (TERMINUS, "abc\nabcde", (40, 32)),
        (TERMINUS, "\n", (0, 0)),
        (TERMINUS, "a\n", (8, 32)),
        (TERMINUS, "a\u00e4b", (16, 16)),
        (MONO, "a", (5, 8)),
        (MONO, "abc", (17, 8)),
        (MONO, "abc\na", (17, 16)),
        (LIBERATION, "Wi", (16, 16)),
        (LIBERATION, "", (0, 0)),
    ],
)
def test_sizes_of_texts(face: Typeface, text: str, size: tuple[int, int]) -> None:
    """The gap behind the last letter is none of it, nor is what the font does not have."""
    assert face.size(text) == size


def test_texts_go_on_below() -> None:
    image = Raster(24, 40, TERMINUS)
    image.text(3, 2, "I\n\u00e4II", 2)
    expected = Raster(24, 40, TERMINUS)
    for x, y in ((3, 2), (3, 18), (11, 18)):
        expected.text(x, y, "I", 2)
    assert picture(image) == picture(expected)


@pytest.mark.parametrize(
    ("face", "width", "places"),
    [
        (TERMINUS, 24, [(0, 0), (8, 0), (16, 0), (0, 16)]),
        (TERMINUS, 23, [(0, 0), (8, 0), (0, 16), (8, 16)]),
        (TERMINUS, 16, [(0, 0), (8, 0), (0, 16), (8, 16)]),
        (MONO, 17, [(0, 0), (6, 0), (12, 0), (0, 8)]),
        (MONO, 16, [(0, 0), (6, 0), (0, 8), (6, 8)]),
        (LIBERATION, 24, [(0, 0), (8, 0), (16, 0), (0, 16)]),
    ],
)
def test_printing_goes_on_in_the_next_line(
    face: Typeface, width: int, places: list[tuple[int, int]]
) -> None:
    image = Raster(width, 48, face)
    image.print("o\u00e4oo", 1)
    image.print("o", 1)
    expected = Raster(width, 48, face)
    for x, y in places:
        expected.text(x, y, "o", 1)
    assert picture(image) == picture(expected)


@pytest.mark.parametrize(
    ("height", "kept"),
    [(48, "abc"), (47, "bc"), (33, "bc"), (32, "bc"), (31, "c"), (17, "c"), (16, "c")],
)
def test_printing_scrolls_by_whole_lines(height: int, kept: str) -> None:
    image = Raster(8, height, TERMINUS)
    image.print("a\nb\nc", 1)
    expected = Raster(8, height, TERMINUS)
    # What was beyond the lower end before is gone.
    expected.text(0, 0, "\n".join(kept), 1)
    assert picture(image)[: 16 * len(kept)] == picture(expected)[: 16 * len(kept)]


def test_printing_in_a_part_scrolls_that_part_alone() -> None:
    image = Raster(20, 40, TERMINUS)
    image.fill(3)
    part = image.part(4, 3, 8, 16)
    part.print("a\nb", 1)
    expected = Raster(20, 40, TERMINUS)
    expected.fill(3)
    within = expected.part(4, 3, 8, 16)
    within.fill(0)
    within.text(0, 0, "b", 1)
    assert picture(image) == picture(expected)


def test_an_image_that_is_too_low_shows_the_upper_end_of_a_line() -> None:
    image = Raster(16, 10, TERMINUS)
    image.print("ab", 1)
    assert picture(image) == written("ab", TERMINUS, 16, 10)


def test_filling_begins_to_print_anew() -> None:
    image = Raster(24, 32, TERMINUS)
    image.print("a\nb", 1)
    image.fill(2)
    assert set("".join(picture(image))) == {"2"}
    image.print("c", 1)
    expected = Raster(24, 32, TERMINUS)
    expected.fill(2)
    expected.text(0, 0, "c", 1)
    assert picture(image) == picture(expected)


# ---- shapes


def drawn(width: int, height: int, **shape: tuple[int, ...]) -> list[str]:
    image = Raster(width, height)
    for name, arguments in shape.items():
        getattr(image, name)(*arguments)
    return picture(image)


def test_lines_across_and_down_end_at_the_edges() -> None:
    assert drawn(5, 1, across=(1, 0, 3, 1)) == [".111."]
    assert drawn(5, 1, across=(-2, 0, 4, 1)) == ["11..."]
    assert drawn(5, 1, across=(3, 0, 9, 1)) == ["...11"]
    assert drawn(5, 1, across=(1, 0, 0, 1)) == drawn(5, 1, across=(5, 0, 3, 1)) == ["....."]
    assert drawn(5, 1, across=(0, 1, 5, 1)) == drawn(5, 1, across=(0, -1, 5, 1)) == ["....."]
    assert "".join(drawn(1, 5, down=(0, 1, 3, 1))) == ".111."
    assert "".join(drawn(1, 5, down=(0, -2, 4, 1))) == "11..."
    assert "".join(drawn(1, 5, down=(0, 3, 9, 1))) == "...11"


@pytest.mark.parametrize(
    ("ends", "rows"),
    [
        ((0, 0, 5, 2), ["11....", "..11..", "....11"]),
        ((5, 2, 0, 0), ["11....", "..11..", "....11"]),
        ((0, 2, 5, 0), ["....11", "..11..", "11...."]),
        ((0, 1, 5, 1), ["......", "111111", "......"]),
        ((2, 0, 2, 2), ["..1...", "..1...", "..1..."]),
        ((3, 1, 3, 1), ["......", "...1..", "......"]),
        ((0, 0, 2, 2), ["1.....", ".1....", "..1..."]),
        ((2, 0, 0, 2), ["..1...", ".1....", "1....."]),
    ],
)
def test_thin_lines_have_both_ends(ends: tuple[int, int, int, int], rows: list[str]) -> None:
    assert drawn(6, 3, line=(*ends, 1, 1)) == rows


@pytest.mark.parametrize(
    ("ends", "width", "rows"),
    [
        ((0, 2, 3, 2), 3, ["....", "1111", "1111", "1111", "...."]),
        ((0, 2, 3, 2), 2, ["....", "1111", "1111", "....", "...."]),
        ((3, 2, 0, 2), 2, ["....", "....", "1111", "1111", "...."]),
        ((2, 0, 2, 4), 2, ["..11"] * 5),
        ((2, 4, 2, 0), 2, [".11."] * 5),
        ((2, 0, 2, 4), 3, [".111"] * 5),
        ((2, 0, 2, 4), 0, ["...."] * 5),
        ((2, 0, 2, 4), -1, ["...."] * 5),
    ],
)
def test_an_even_line_is_thicker_on_its_left(
    ends: tuple[int, int, int, int], width: int, rows: list[str]
) -> None:
    """As seen from its first end; y counts downwards."""
    assert drawn(4, 5, line=(*ends, width, 1)) == rows


def box(width: int, height: int, radius: int, *, is_filled: bool) -> list[str]:
    image = Raster(9, 7)
    image.rounded_box(1, 1, width, height, radius, 1, is_filled=is_filled)
    return [row[1:8] for row in picture(image)[1:6]]


def test_boxes_with_and_without_round_corners() -> None:
    assert box(7, 5, 0, is_filled=False) == ["1111111", "1.....1", "1.....1", "1.....1", "1111111"]
    assert box(7, 5, 0, is_filled=True) == ["1111111"] * 5
    assert box(7, 5, 1, is_filled=False) == [".11111.", "1.....1", "1.....1", "1.....1", ".11111."]
    assert box(7, 5, 1, is_filled=True) == [".11111.", "1111111", "1111111", "1111111", ".11111."]
    round_box = box(7, 5, 2, is_filled=False)
    assert round_box == box(7, 5, 99, is_filled=False), "no more than fits"
    assert box(2, 2, 9, is_filled=True) == ["11.....", "11.....", *["......."] * 3]
    for empty in ((0, 5), (7, 0), (-1, 5)):
        assert box(*empty, 1, is_filled=True) == ["......."] * 5


def test_circles() -> None:
    def circle(radius: int, *, is_filled: bool) -> list[str]:
        image = Raster(7, 7)
        image.circle(3, 3, radius, 1, is_filled=is_filled)
        return picture(image)

    assert circle(0, is_filled=True) == ["......."] * 7
    assert circle(1, is_filled=False)[2:5] == ["...1...", "..1.1..", "...1..."]
    assert circle(1, is_filled=True)[2:5] == ["...1...", "..111..", "...1..."]
    assert circle(3, is_filled=False) == [
        "..111..",
        ".1...1.",
        "1.....1",
        "1.....1",
        "1.....1",
        ".1...1.",
        "..111..",
    ]


# ---- images of a program


def shown(source: str) -> tuple[list[bytes], list[str]]:
    """Rows of the screen after a program, and what it printed."""
    machine = Machine(FittedBench(HubKind.EV3))
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    pixels = machine.panel.screen
    rows = [pixels[start : start + 178] for start in range(0, len(pixels), 178)]
    return rows, console.written.decode().replace("\r\n", "\n").splitlines()


@pytest.mark.parametrize(
    ("color", "shade"),
    [
        ("Color(0, 0, 0)", 3),
        ("Color(0, 0, 21)", 3),
        ("Color(0, 0, 22)", 2),
        ("Color(0, 0, 55)", 2),
        ("Color(0, 0, 56)", 1),
        ("Color(0, 0, 84)", 1),
        ("Color(0, 0, 85)", 0),
        ("Color(0, 100, 42)", 3),
        ("Color(0, 100, 43)", 2),
        ("Color(0, 51, 28)", 3),
        ("Color(0, 50, 29)", 2),
        ("Color.WHITE", 0),
        ("Color.BLACK", 3),
        ("None", 3),
        ("1", 1),
        ("2", 2),
        ("0", 0),
    ],
)
def test_a_color_is_one_of_four_shades(color: str, shade: int) -> None:
    """By its value, of which a full saturation leaves half."""
    rows, _ = shown(f"screen.draw_pixel(0, 0, 3)\nscreen.draw_pixel(0, 0, {color})")
    assert rows[0][0] == shade


def test_places_are_truncated_but_those_of_images_are_whole_numbers() -> None:
    source = """
small = Image.empty(1, 1)
small.draw_pixel(0.9, -0.9)
screen.draw_pixel(5.9, 6.9)
print(error(screen.draw_image, 1.5, 0, small), error(screen.draw_image, 0, 1.5, small))
print(error(screen.draw_image, 7, 8, small), error(screen.draw_image, 0, 0, 5))
print(error(Image.empty, 1.5), error(Image.empty, 1, 1.5), error(Image, 5), error(Image))
print(error(Image.empty, 0, 1), error(Image.empty, 1, 0), error(Image.empty, -1, 1))
print(error(screen.set_font, 5), error(screen.draw_pixel, 0, 0, "red"))
"""
    rows, printed = shown(source)
    dark = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
    assert dark == [(5, 6), (7, 8)]
    no_float = 'TypeError("can\'t convert float to int",)'
    too_small = "ValueError('Image width or height is less than 1',)"
    assert printed == [
        f"{no_float} {no_float}",
        'None TypeError("can\'t convert int to Image",)',
        (
            f'{no_float} {no_float} TypeError("can\'t convert int to Image",) '
            "TypeError(\"'source' argument required\",)"
        ),
        f"{too_small} {too_small} {too_small}",
        ('TypeError("can\'t convert int to Font",) TypeError("can\'t convert str to Color",)'),
    ]


@pytest.mark.parametrize(
    ("size", "first"),
    [((2, 2), (88, 63)), ((3, 3), (87, 62)), ((178, 128), (0, 0)), ((180, 131), (-1, -1))],
)
def test_a_loaded_image_is_in_the_middle(size: tuple[int, int], first: tuple[int, int]) -> None:
    """Half of what is left on each side, rounded towards the upper left; or of what is too much,
    towards the middle."""
    width, height = size
    source = f"""
image = Image.empty({width}, {height})
image.draw_box(0, 0, {width - 1}, {height - 1}, 0, True)
screen.draw_pixel(0, 0)
screen.load_image(image)
"""
    rows, _ = shown(source)
    dark = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
    left, top = first
    assert min(dark) == (max(left, 0), max(top, 0))
    assert max(dark) == (min(left + width, 178) - 1, min(top + height, 128) - 1)
    assert len(dark) == min(width, 178) * min(height, 128)


def test_parts_of_an_image_and_copies_of_it() -> None:
    source = """
whole = Image.empty(10, 8)
sizes = []
for part in (Image(whole, True), Image(whole, sub=True, x1=2), Image(whole, sub=True, y1=3),
             Image(whole, sub=True, x2=4), Image(whole, sub=True, y2=5),
             Image(whole, True, 1.9, 2.9, 3.9, 4.9), Image(whole, True, -3, -3, 20, 20),
             Image(whole, True, 10, 0), Image(whole, True, 5, 5, 4, 9), Image(whole)):
    sizes.append((part.width, part.height))
print(sizes)
part = Image(whole, True, 1, 1, 3, 3)
inner = Image(part, True, 1, 1)
inner.draw_pixel(0, 0, 2)
copy = Image(whole)
whole.clear()
screen.draw_image(0, 0, copy)
print(inner.width, inner.height)
"""
    rows, printed = shown(source)
    sizes = "(10, 8), (8, 8), (10, 5), (5, 8), (10, 6), (3, 3), (10, 8), (0, 0), (0, 0), (10, 8)"
    assert printed == [f"[{sizes}]", "2 2"]
    dark = [(x, y, value) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
    assert dark == [(2, 2, 2)], "the copy is as the image was"


def test_a_transparent_shade_is_left_out() -> None:
    source = """
image = Image.empty(3, 1)
image.draw_pixel(0, 0, 1)
image.draw_pixel(1, 0, 2)
for row, transparent in enumerate((None, Color.WHITE, 2, 1)):
    screen.draw_box(0, row, 2, row, 0, True)
    screen.draw_image(0, row, image, transparent)
"""
    rows, _ = shown(source)
    assert [list(row[:3]) for row in rows[:4]] == [[1, 2, 0], [1, 2, 3], [1, 3, 0], [3, 2, 0]]


def test_fonts_tell_their_measures() -> None:
    source = """
for font in (Font.DEFAULT, Font.TERMINUS_16, Font.LIBERATIONSANS_14, Font.MONO_8X5_8):
    print(font.family, font.style, font.width, font.height, font.text_width("Ai"), font.text_height("A"))
print(error(Font.DEFAULT.text_width, 5), error(Font.DEFAULT.text_height, None))
"""  # noqa: E501
    _, printed = shown(source)
    assert printed == [
        "Terminus Medium 8 16 16 16",
        "Terminus Medium 8 16 16 16",
        "Liberation Sans Regular 14 16 12 16",
        "Mono 8x5 Regular 6 8 11 8",
        (
            "TypeError(\"can't convert 'int' object to str implicitly\",) "
            "TypeError(\"can't convert 'NoneType' object to str implicitly\",)"
        ),
    ]


def test_what_is_printed_on_the_screen() -> None:
    source = """
screen.print("a", 5, [1, "b"])
screen.print("x", "y", sep="-", end="!")
screen.print()
print(error(screen.print, 1, sep=5), error(screen.print, 1, end=None))
"""
    rows, printed = shown(source)
    expected = Raster(178, 128)
    expected.text(0, 0, "a 5 [1, 'b']\nx-y!", 3)
    assert b"".join(rows) == bytes(expected.pixels)
    no_text = [
        f"TypeError(\"can't convert '{kind}' object to str implicitly\",)"
        for kind in ("int", "NoneType")
    ]
    assert printed == [" ".join(no_text)]


def test_text_has_a_background_one_pixel_wider() -> None:
    source = "screen.draw_text(10, 20, 'I', Color.WHITE, 2)\nscreen.draw_text(50, 20, 'I')"
    rows, _ = shown(source)
    filled = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value == 2]
    assert (min(filled), max(filled)) == ((9, 19), (18, 36))
    letter = sum(value == 3 for row in rows for value in row)
    assert len(filled) == 10 * 18 - letter
