"""``bricktwin world``, and worlds and pictures as scenes of ``bricktwin run``."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from browser import chromium, tab
from PIL import Image

from bricktwin.cli import world_commands
from bricktwin.cli.run_command import Run
from bricktwin.worlds import WORLDS

SEES = """from pybricks.parameters import Port
from pybricks.pupdevices import ColorSensor
print(ColorSensor(Port.B).color())
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a program and a picture, half red, half blue."""
    (tmp_path / "main.py").write_text(SEES)
    image = Image.new("RGB", (800, 400), (200, 20, 20))
    image.paste((20, 60, 190), (0, 0, 400, 400))
    image.save(tmp_path / "mat.png")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_worlds_are_listed_everywhere(bricktwin) -> None:
    done = bricktwin("world", "list")
    assert [line.split()[0] for line in done.out.splitlines()] == list(WORLDS)
    help_text = " ".join(bricktwin("run", "--help").out.replace("│", " ").split())
    for name in WORLDS:
        assert f" {name}" in help_text, name
    assert Run.__doc__ is not None


def test_docs_show_each_world() -> None:
    docs = Path(__file__).parents[4] / "docs"
    page = (docs / "worlds.md").read_text(encoding="utf-8")
    for name in WORLDS:
        assert f"`{name}`" in page and f"images/worlds/{name}.png" in page, name
        assert (docs / "images" / "worlds" / f"{name}.png").stat().st_size < 40_000


def test_scene_by_name_and_picture(bricktwin, folder) -> None:
    """The scout is the robot; its sensor is over the line, and over the red half."""
    assert bricktwin("run", "main.py", "--scene", "sumo") == (0, "Color.NONE\n", "")
    assert bricktwin("run", "main.py", "--scene", "mat.png:800x400") == (0, "Color.RED\n", "")


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ("line-simpel", "'line-simpel' is not a scene (did you mean 'line-simple'?); choose line-"),
        ("mat", "or a picture, mat.png:fll or mat.png:1000x700"),
        ("mat.png", "how large is mat.png on the floor? Give width and height in mm"),
        ("mat.png:big", "how large is mat.png on the floor?"),
        ("mat.png:fll", "800 x 400 pixels"),
        ("mat.png:0x0", "give its width and height"),
        ("none.png:800x400", "there is no picture none.png"),
    ],
)
def test_scene_that_is_none_is_said(fails, folder, scene: str, says: str) -> None:
    fails("run", "main.py", "--scene", scene, says=says)


def test_pictures_are_checked(bricktwin, folder) -> None:
    good = bricktwin("world", "check", "mat.png:800x400")
    assert good == (0, "mat.png on 800 x 400 mm: all is well\n", "")
    coarse = bricktwin("world", "check", "mat.png:2400x1200")
    assert coarse.code == 1 and "give an image of 1200 pixels across or more" in coarse.out
    assert bricktwin("world", "check", "mat.png").code == 2


def test_world_is_drawn(bricktwin, folder) -> None:
    pytest.importorskip("mujoco")
    done = bricktwin("world", "draw", "wall", "--out", "pictures")
    if "OpenGL" in done.err:
        pytest.skip("no OpenGL here")
    assert done.code == 0 and "1 picture in pictures" in done.out
    with Image.open(folder / "pictures" / "wall.png") as image:
        assert image.size == (480, 300)


@pytest.mark.parametrize(
    ("named", "drawn"), [((), tuple(WORLDS)), (("maze", "sumo"), ("maze", "sumo"))]
)
def test_worlds_that_are_named_are_drawn_or_all(
    monkeypatch, bricktwin, folder, named, drawn
) -> None:
    asked = []
    monkeypatch.setattr(
        world_commands, "picture_of", lambda scene: asked.append(scene) or bytes(2000)
    )
    done = bricktwin("world", "draw", *named, "--out", "pictures")
    assert done.code == 0
    assert tuple(asked) == drawn
    *files, last = done.out.splitlines()
    assert files == [f"{Path('pictures') / name}.png: 2 kB" for name in drawn]
    assert last == f"{len(drawn)} pictures in pictures"
    written = {path.stem for path in (folder / "pictures").iterdir()}
    assert written == set(drawn)


def test_photograph_becomes_a_floor(bricktwin, folder) -> None:
    """The mat lies on a black floor, and is seen from its right side: its upper left corner is the
    lower left one of the photograph."""
    seen = Image.new("RGB", (600, 900), "black")
    with Image.open("mat.png") as mat:
        seen.paste(mat.transpose(Image.Transpose.ROTATE_90), (100, 50))
    seen.save("photo.png")
    corners = ("100,850", "100,50", "500,850", "500,50")
    done = bricktwin(
        "world", "straighten", "photo.png:800x400", "--corners", *corners, "--out", "floor.png"
    )
    says = (
        "floor.png: 800 x 400 pixels, one a millimetre\n"
        "look at it, then drive on it: --scene floor.png:800x400\n"
    )
    assert done == (0, says, "")
    assert bricktwin("world", "check", "floor.png:800x400").code == 0
    assert bricktwin("run", "main.py", "--scene", "floor.png:800x400") == (0, "Color.RED\n", "")
    swapped = bricktwin(
        "world", "straighten", "photo.png:400x800", "--corners", *corners, "--out", "floor.png"
    )
    assert swapped.code == 0 and "as if its width and height were swapped" in swapped.err


@pytest.mark.slow
def test_corners_are_clicked_on_a_page(bricktwin, folder) -> None:
    """The page is narrower than the photograph."""
    done = bricktwin("world", "straighten", "mat.png:800x400", "--out", "floor.png")
    says = "floor.html: open it in a browser, and click the four corners of the mat\n"
    assert done == (0, says, "")
    url = (folder / "floor.html").as_uri()
    with chromium() as browser, tab(browser, url, width=500) as page:
        image = page.locator("#inner img")
        size = image.bounding_box()
        for x, y in ((0.0, 0.0), (0.999, 0.0), (0.999, 0.999), (0.0, 0.999)):
            image.click(position={"x": x * size["width"], "y": y * size["height"]})
        command = page.locator("#command").inner_text()
        assert page.locator("#inner span").count() == 4
    words = command.split()
    assert words[:4] == ["bricktwin", "world", "straighten", "mat.png:800x400"]
    clicked = [tuple(map(int, word.split(","))) for word in words[5:9]]
    corners = [(0, 0), (800, 0), (800, 400), (0, 400)]
    # A click is within a pixel of the page, which is two of the photograph.
    assert all(math.dist(*pair) < 4 for pair in zip(clicked, corners, strict=True))
    assert bricktwin(*words[1:]).code == 0 and (folder / "floor.png").exists()


@pytest.mark.parametrize(
    ("corner", "out", "says"),
    [
        ("100;850", "floor.png", "'100;850' is no point of a photograph; give column,row: 412,310"),
        ("nan,850", "floor.png", "'nan,850' is no point of a photograph"),
        ("500,50", "floor.png", "the corner 500,50 is none"),
        ("9999,50", "floor.png", "9999,50 is outside of mat.png, which has 800 x 400 pixels"),
        ("100,50", "floor.jpg", "'floor.jpg' is no name of a picture; end it in .png"),
    ],
)
def test_what_is_no_photograph_is_said(fails, folder, corner: str, out: str, says: str) -> None:
    corners = (corner, "500,50", "500,300", "100,300")
    fails("world", "straighten", "mat.png:80x40", "--corners", *corners, "--out", out, says=says)
