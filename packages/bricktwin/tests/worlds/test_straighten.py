"""Photographs of mats, straightened: a mat that is known, seen askew, comes back."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from brickhub.errors import TwinError
from bricktwin.twin.floor_picture import read_picture
from bricktwin.worlds.straighten import (
    _bilinear,
    corners_page,
    looks_turned,
    ordered,
    plane_through,
    straightened,
)

SIZE_MM = (300.0, 200.0)
CORNERS = [(210.0, 130.0), (840.0, 90.0), (960.0, 620.0), (60.0, 690.0)]
"""Upper left, upper right, lower right and lower left of the mat in the photograph: nearer to the
camera below, and a little from the side."""
PHOTO = (1000, 750)
PATCHES = {
    (60, 50): (200, 20, 20),
    (240, 50): (20, 150, 60),
    (60, 150): (20, 60, 190),
    (240, 150): (250, 200, 20),
}
"""Colors of squares of 60 mm, by their middles in mm."""
LINE_MM = 150
"""Middle of a black line of 20 mm that runs down the mat."""


def mat(scale: int = 1) -> Image.Image:
    """The mat as it was printed."""
    image = Image.new("RGB", (300 * scale, 200 * scale), "white")
    for (x, y), colour in PATCHES.items():
        box = ((x - 30) * scale, (y - 30) * scale, (x + 30) * scale, (y + 30) * scale)
        image.paste(colour, box)
    image.paste((0, 0, 0), ((LINE_MM - 10) * scale, 0, (LINE_MM + 10) * scale, 200 * scale))
    return image


def photo(corners: list[tuple[float, float]] = CORNERS, light: float = 1.0) -> Image.Image:
    """A photograph of the mat, on a grey floor, made by Pillow; its homography is the solution of
    eight equations, and not that of the code under test."""
    scale = 4
    there = [(0, 0), (300 * scale, 0), (300 * scale, 200 * scale), (0, 200 * scale)]
    rows, values = [], []
    for (x, y), (u, v) in zip(corners, there, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    coefficients = np.linalg.solve(np.array(rows, dtype=float), np.array(values, dtype=float))
    seen = mat(scale).transform(
        PHOTO,
        Image.Transform.PERSPECTIVE,
        coefficients.tolist(),
        Image.Resampling.BICUBIC,
        fillcolor=(120, 120, 120),
    )
    return seen.point(lambda value: value * light)


def saved(image: Image.Image, folder: Path, name: str = "photo.png") -> Path:
    image.save(folder / name)
    return folder / name


def test_mat_comes_back(tmp_path: Path) -> None:
    """Two resamplings blur an edge by a pixel or two, which here are 1 mm; a millimetre beside it
    the colours are those of the mat but for rounding."""
    picture = straightened(saved(photo(), tmp_path), CORNERS, SIZE_MM)
    assert picture.size == (300, 200)
    pixels = np.asarray(picture).astype(int)
    for (x, y), colour in PATCHES.items():
        patch = pixels[y - 27 : y + 27, x - 27 : x + 27]
        assert np.abs(patch - colour).max() <= 3
    difference = np.abs(pixels - np.asarray(mat()).astype(int))
    # The edges, blurred by 1 mm to each side: a tenth of the mat.
    assert (difference.max(axis=-1) > 8).mean() < 0.1
    # The middle of the line is that of its darkness, in each row.
    darkness = 255.0 - pixels[:, LINE_MM - 20 : LINE_MM + 20].mean(axis=-1)
    places = np.arange(LINE_MM - 20, LINE_MM + 20) + 0.5
    middles = darkness @ places / darkness.sum(axis=1)
    assert np.abs(middles - LINE_MM).max() < 0.5


def test_sensor_reads_of_a_photograph_what_it_reads_of_the_mat(tmp_path: Path) -> None:
    """3 of 255 are 1 % of the light."""
    straightened(saved(photo(), tmp_path), CORNERS, SIZE_MM).save(tmp_path / "mat.png")
    mat().save(tmp_path / "printed.png")
    floor, printed = (read_picture(tmp_path / name, SIZE_MM) for name in ("mat.png", "printed.png"))
    for x, y in [*PATCHES, (LINE_MM, 30), (LINE_MM, 170), (15, 15), (285, 100)]:
        place = (x - 150.0, 100.0 - y)
        assert floor.color_at(*place) == pytest.approx(printed.color_at(*place), abs=0.012)


def test_corners_come_in_any_order_after_the_first() -> None:
    first, *others = CORNERS
    for order in itertools.permutations(others):
        assert ordered([first, *order]) == CORNERS
    assert ordered(CORNERS[1:] + CORNERS[:1]) == CORNERS[1:] + CORNERS[:1]


def test_first_corner_turns_the_mat(tmp_path: Path) -> None:
    """Somebody stood on the other side of the mat: its upper left corner is below."""
    path = saved(photo(), tmp_path)
    turned = straightened(path, CORNERS[2:] + CORNERS[:2], SIZE_MM)
    upright = straightened(path, CORNERS, SIZE_MM)
    rotated = np.asarray(upright.rotate(180)).astype(int)
    assert np.abs(np.asarray(turned).astype(int) - rotated).max() <= 2
    assert not looks_turned(CORNERS, SIZE_MM)
    assert looks_turned(CORNERS[1:] + CORNERS[:1], SIZE_MM)


@pytest.mark.parametrize(
    "corners",
    [
        [(10, 10), (10, 10), (300, 300), (10, 300)],
        [(10, 10), (150, 10), (300, 10), (10, 300)],
        [(10, 10), (300, 10), (100, 60), (10, 300)],
        [(10, 10), (20, 20), (30, 30), (40, 40)],
        [(50, 50)] * 4,
    ],
    ids=["twice", "on a side", "within", "on a line", "one place"],
)
def test_what_are_no_corners_is_refused(corners: list[tuple[float, float]]) -> None:
    with pytest.raises(TwinError, match="give the four corners of the mat") as raised:
        ordered(corners)
    assert "\n" not in str(raised.value)


def test_turned_photograph_is_taken_as_viewers_show_it(tmp_path: Path) -> None:
    """A phone held upright writes the pixels lying, and a tag that says so."""
    lying = photo().rotate(90, expand=True)
    tags = Image.Exif()
    tags[0x0112] = 6
    lying.save(tmp_path / "photo.jpg", exif=tags, quality=95)
    picture = straightened(tmp_path / "photo.jpg", CORNERS, SIZE_MM)
    for (x, y), colour in PATCHES.items():
        # JPEG changes colours a little.
        assert np.abs(np.asarray(picture).astype(int)[y, x] - colour).max() < 12


def test_white_point_corrects_the_light(tmp_path: Path) -> None:
    path = saved(photo(light=0.6), tmp_path)
    dark = straightened(path, CORNERS, SIZE_MM).getpixel((5, 100))
    light = straightened(path, CORNERS, SIZE_MM, white=(500.0, 110.0 + 30)).getpixel((5, 100))
    assert max(dark) < 160
    assert light == (255, 255, 255) or min(light) > 250
    with pytest.raises(TwinError, match="is not white but red"):
        straightened(path, CORNERS, SIZE_MM, white=(520.0, 400.0))


def test_faults_of_photographs_are_said_in_a_line(tmp_path: Path) -> None:
    small = saved(Image.new("RGB", (200, 100)), tmp_path)
    (tmp_path / "text.jpg").write_text("no image")
    Image.new("1", (12_000, 12_000)).save(tmp_path / "huge.png")
    for path, says in {
        small: "210,130 is outside of .*photo.png, which has 200 x 100 pixels",
        tmp_path / "none.jpg": "there is no photograph",
        tmp_path / "text.jpg": "no image that can be read",
        tmp_path / "huge.png": "12000 x 12000 pixels; make it smaller",
    }.items():
        with pytest.raises(TwinError, match=says) as raised:
            straightened(path, CORNERS, SIZE_MM)
        assert "\n" not in str(raised.value)
    with pytest.raises(TwinError, match="too large for a picture"):
        straightened(small, CORNERS, (10_000.0, 10_000.0))


@pytest.mark.parametrize("scale", [1.0, 100.0])
@pytest.mark.parametrize(("bend_deg", "is_corner"), [(2.5, False), (3.5, True), (-3.5, False)])
def test_a_flat_corner_is_none_however_large_the_photograph(
    scale: float, bend_deg: float, is_corner: bool
) -> None:
    bend = math.radians(bend_deg)
    corners = [
        (-10.0, 0.0),
        (0.0, 0.0),
        (10.0 * math.cos(bend), 10.0 * math.sin(bend)),
        (0.0, 20.0),
    ]
    scaled = [(900.0 + scale * x, 70.0 + scale * y) for x, y in corners]
    if is_corner:
        assert ordered(scaled) == scaled
    else:
        with pytest.raises(TwinError, match="give the four corners of the mat"):
            ordered(scaled)


def test_corners_of_a_mat_on_its_edge_go_round_clockwise() -> None:
    diamond = [(500.0, 100.0), (800.0, 400.0), (500.0, 700.0), (200.0, 400.0)]
    for order in itertools.permutations(diamond[1:]):
        assert ordered([diamond[0], *order]) == diamond


def test_a_plane_takes_straight_lines_to_straight_lines() -> None:
    """By the solution of eight equations; a parallelogram has no perspective."""
    plane = plane_through(np.array(CORNERS))
    rows, values = [], []
    for (x, y), (u, v) in zip([(0, 0), (1, 0), (1, 1), (0, 1)], CORNERS, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    a, b, c, d, e, f, g, h = np.linalg.solve(np.array(rows, float), np.array(values))
    across, down = np.array([0.0, 0.3, 1.0]), np.array([0.0, 0.25, 0.9, 1.0])
    x, y = plane.at(across, down)
    assert x.shape == y.shape == (4, 3)
    share, below = np.meshgrid(across, down)
    scale = g * share + h * below + 1
    assert x == pytest.approx((a * share + b * below + c) / scale)
    assert y == pytest.approx((d * share + e * below + f) / scale)
    aslant = plane_through(np.array([(10.0, 20.0), (110.0, 30.0), (90.0, 80.0), (-10.0, 70.0)]))
    x, y = aslant.at(np.array([0.5]), np.array([0.5]))
    assert (x[0, 0], y[0, 0]) == pytest.approx((50.0, 50.0))


def test_between_the_middles_of_pixels_colours_are_mixed() -> None:
    pixels = np.zeros((2, 3, 3), dtype=np.uint8)
    pixels[0] = [[0, 0, 10], [100, 0, 20], [200, 0, 30]]
    pixels[1] = [[40, 0, 0], [40, 80, 0], [40, 160, 0]]

    def at(x: float, y: float) -> list[float]:
        return _bilinear(pixels, np.array([[x]]), np.array([[y]]))[0, 0].tolist()

    assert at(0.5, 0.5) == [0.0, 0.0, 10.0] and at(2.5, 1.5) == [40.0, 160.0, 0.0]
    assert at(1.0, 0.5) == [50.0, 0.0, 15.0] and at(1.75, 0.5) == [125.0, 0.0, 22.5]
    assert at(0.5, 1.0) == [20.0, 0.0, 5.0] and at(2.0, 1.25) == [67.5, 90.0, 6.25]
    # Beyond the middles of the last pixels, these go on.
    assert at(0.0, 0.0) == at(-3.0, 0.2) == [0.0, 0.0, 10.0]
    assert at(3.0, 2.0) == at(9.0, 9.0) == [40.0, 160.0, 0.0]


def test_a_photograph_of_one_colour_keeps_it_up_to_its_edges(tmp_path: Path) -> None:
    path = saved(Image.new("RGB", (90, 60), (7, 100, 201)), tmp_path)
    edges = [(0.0, 0.0), (90.0, 0.0), (90.0, 60.0), (0.0, 60.0)]
    picture = straightened(path, edges, (45.0, 30.0))
    assert picture.size == (45, 30) and (np.asarray(picture) == (7, 100, 201)).all()
    for beyond in ((-0.5, 0.0), (90.5, 0.0), (0.0, 60.5), (0.0, -0.5)):
        with pytest.raises(TwinError, match="is outside of"):
            straightened(path, [beyond, *edges[1:]], (45.0, 30.0))


def test_the_light_of_nine_by_nine_pixels_becomes_white(tmp_path: Path) -> None:
    image = Image.new("RGB", (60, 40), (100, 100, 100))
    image.paste((200, 150, 100), (16, 16, 25, 25))
    path = saved(image, tmp_path)
    edges = [(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
    picture = straightened(path, edges, (60.0, 40.0), white=(20.0, 20.9))
    assert picture.getpixel((20, 20)) == (255, 255, 255)
    assert picture.getpixel((50, 5)) == pytest.approx((127.5, 170, 255), abs=0.6)
    # At the edge of the photograph, of what there is.
    corner = straightened(path, edges, (60.0, 40.0), white=(60.0, 40.0))
    assert corner.getpixel((0, 0)) == (255, 255, 255)


def test_a_page_to_click_corners_has_the_photograph_and_the_command(tmp_path: Path) -> None:
    path = saved(photo(), tmp_path, "my <mat>.png")
    page = corners_page(path, "straighten 'a \"b\"'", "--out <mat>.png")
    assert f'src="{path.resolve().as_uri()}"' in page
    assert 'data-before="straighten &#x27;a &quot;b&quot;&#x27;"' in page
    assert 'data-after="--out &lt;mat&gt;.png"' in page and "my &lt;mat&gt;.png" in page
    # What a script writes as `${...}` is left to it.
    assert "${command.dataset.before}" in page and "$photo" not in page
    with pytest.raises(TwinError, match="there is no photograph"):
        corners_page(tmp_path / "none.png", "", "")
