"""A user's own picture as the floor: in a page, and in a site."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_page import run_program
from PIL import Image

from bricktwin.robots import TWO_WHEELER
from bricktwin.site.robots import write_robots
from bricktwin.target import load_scene, scene_name

if TYPE_CHECKING:
    from playwright.sync_api import Page

READ = """
from pybricks.pupdevices import ColorSensor
from pybricks.parameters import Port
print(ColorSensor(Port.B).hsv())
"""


def picture(size: tuple[int, int], color: str) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", size, color).save(file, "PNG")
    return file.getvalue()


def choose(page: Page, content: bytes, size: str = "width") -> None:
    page.select_option("#world", "own picture")
    file = {"name": "mat.png", "mimeType": "image/png", "buffer": content}
    page.set_input_files("#picture-file", files=[file])
    page.select_option("#picture-size", size)
    page.get_by_role("button", name="Take it").click()
    page.wait_for_selector("#note:not([hidden])")


@pytest.mark.slow
def test_a_color_sensor_reads_the_users_picture(page: Page) -> None:
    """The scout's looks at the floor."""
    page.select_option("#robot", "scout")
    choose(page, picture((400, 200), "red"))
    assert "stands on your picture" in (page.text_content("#note") or "")
    _, red, state = run_program(page, READ)
    assert state == "finished"
    choose(page, picture((2362, 1143), "blue"), "table")
    assert page.input_value("#world") == "table"
    _, blue, _ = run_program(page, READ)
    hues = [int(text.partition("h=")[2].partition(",")[0]) for text in (red, blue)]
    assert hues[0] in (*range(20), *range(340, 360))
    assert 200 <= hues[1] <= 250


@pytest.mark.slow
def test_a_picture_that_would_be_stretched_is_refused(page: Page) -> None:
    page.select_option("#robot", "scout")
    choose(page, picture((100, 100), "red"), "table")
    said = page.text_content("#note") or ""
    assert said.startswith("mat.png has 100 x 100 pixels, which would be stretched on 2362 x 1143")
    page.select_option("#robot", "bench")


def test_a_site_has_a_world_of_a_users_picture(tmp_path: Path) -> None:
    file = tmp_path / "mat.png"
    file.write_bytes(picture((100, 70), "red"))
    reference = f"{file}:1000x700"
    assert scene_name(reference) == "mat"
    scenes = {scene_name(reference): load_scene(reference)}
    (robot,) = write_robots(tmp_path, (TWO_WHEELER,), scenes, {})
    assert [world["name"] for world in robot["worlds"]] == ["open floor", "mat"]
    assert (tmp_path / f"{robot['worlds'][1]['file']}.packed").stat().st_size > 1000


def test_names_of_scenes() -> None:
    assert scene_name("my_scene.py:MAT") == "MAT"
    assert scene_name("my_scene.py") == "my_scene"
    assert scene_name("maze") == "maze"
