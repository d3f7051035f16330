"""Pictures on the floor: what a sensor reads, and what is wrong with a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from brickhub.errors import TwinError
from brickhub.robot import Sense
from bricktwin.kept import described
from bricktwin.robots import SCOUT
from bricktwin.twin.floor_picture import Picture, faults_of_picture, read_picture
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Field
from bricktwin.twin.scene import Scene
from bricktwin.view.body_drawing import drawing_of

RED, GREEN, BLUE, BLACK = (255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 0, 0)
QUARTERS = Picture(bytes((*RED, *GREEN, *BLUE, *BLACK)), columns=2, size_mm=(200.0, 100.0))
"""Red and green above, blue and black below."""


def test_pixels_are_found_by_their_place() -> None:
    """Above is to the left of a robot that looks along x."""
    ink, paper = 0.07, pytest.approx(0.93)
    assert QUARTERS.color_at(-50.0, 25.0) == (paper, ink, ink)
    assert QUARTERS.color_at(50.0, 25.0) == (ink, paper, ink)
    assert QUARTERS.color_at(-50.0, -25.0) == (ink, ink, paper)
    assert QUARTERS.color_at(100.0, -50.0) == (ink, ink, ink), "its corner belongs to it"
    assert QUARTERS.color_at(101.0, 0.0) is None and QUARTERS.color_at(0.0, 51.0) is None
    # A quarter turn clockwise about a place: what was above is now to the right.
    turned = replace(QUARTERS, at_mm=(1000.0, 0.0), heading_deg=90.0)
    assert turned.color_at(1025.0, 50.0) == (paper, ink, ink)
    assert turned.color_at(1000.0, 99.0) is not None and turned.color_at(1060.0, 0.0) is None


def test_sensor_reads_pixels_and_what_lies_on_them() -> None:
    """The scout's sensor is over green, 56 mm ahead of its start, and over blue if the mat is
    turned."""
    mat = replace(QUARTERS, size_mm=(800.0, 400.0))
    start_mm = ((100.0, 100.0), (60.0, 60.0))
    spot = Field((156.0, 60.0), (30.0, 30.0), "yellow")
    hues = []
    for objects in ((mat,), (replace(mat, heading_deg=180.0),), (mat, spot), (spot, mat)):
        body = make_body(SCOUT, scene=Scene(objects=objects, start_mm=start_mm))
        hues.append(round(body.sensed("B", Sense.SURFACE)[0]))
    assert hues == [120, 240, 49, 120]


def test_picture_is_drawn_and_kept() -> None:
    scene = Scene(objects=(QUARTERS,))
    body = make_body(SCOUT, scene=scene)
    assert isinstance(body, MujocoBody)
    (picture,) = {
        shape.picture for one in drawing_of(body).bodies for shape in one.shapes if shape.picture
    }
    assert picture.startswith(b"\x89PNG")
    assert described(scene) == described(Scene(objects=(replace(QUARTERS),)))
    other = replace(QUARTERS, pixels=QUARTERS.pixels[::-1])
    assert described(scene) != described(Scene(objects=(other,)))


def test_file_is_read_scaled_and_on_paper(tmp_path: Path) -> None:
    image = Image.new("RGBA", (400, 200), (0, 0, 0, 0))
    image.paste(BLACK, (0, 0, 200, 200))
    image.save(tmp_path / "mat.png")
    picture = read_picture(tmp_path / "mat.png", (200.0, 100.0), at_mm=(100.0, 50.0))
    assert (picture.columns, picture.rows) == (200, 100)
    assert picture.color_at(50.0, 50.0) == (0.07, 0.07, 0.07)
    assert picture.color_at(150.0, 50.0) == pytest.approx((0.93, 0.93, 0.93))
    (fault,) = faults_of_picture(tmp_path / "mat.png", (200.0, 100.0))
    assert "transparent" in fault
    image.convert("RGB").save(tmp_path / "mat.jpg")
    assert faults_of_picture(tmp_path / "mat.jpg", (200.0, 100.0)) == []
    (fault,) = faults_of_picture(tmp_path / "mat.jpg", (2000.0, 1000.0))
    assert "0.2 pixels a millimetre" in fault and "1000 pixels across" in fault


def test_what_is_no_picture_is_said_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    Image.new("RGB", (300, 200)).save(tmp_path / "good.png")
    Image.effect_noise((300, 300), 50.0).save(tmp_path / "cut.png")
    data = (tmp_path / "cut.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(data[: len(data) // 2])
    Image.new("1", (9000, 9000)).save(tmp_path / "huge.png")
    for name, says in {
        "none.png": "there is no picture",
        "text.png": "no image that can be read",
        "cut.png": "cannot be read|no image",
        "good.png": r"300 x 200 pixels, which would be stretched on 300 x 300 mm.*300x200",
        "huge.png": "9000 x 9000 pixels; make it smaller",
        ".": "cannot be read|no image",
    }.items():
        with pytest.raises(TwinError, match=says) as raised:
            read_picture(tmp_path / name, (300.0, 300.0))
        assert "\n" not in str(raised.value)
        assert faults_of_picture(tmp_path / name, (300.0, 300.0)) == [str(raised.value)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"pixels": b""},
        {"pixels": b"12345"},
        {"columns": 0},
        {"size_mm": (0.0, 100.0)},
        {"size_mm": (100.0, float("nan"))},
        {"size_mm": (100.0, 20_000.0)},
        {"size_mm": 100.0},
        {"at_mm": (float("inf"), 0.0)},
    ],
)
def test_invalid_picture_raises(wrong: dict[str, object]) -> None:
    with pytest.raises(TwinError, match="scene: a picture"):
        replace(QUARTERS, **wrong)  # type: ignore[arg-type]
