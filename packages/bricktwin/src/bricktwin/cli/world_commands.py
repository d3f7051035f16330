"""``bricktwin world``: the gallery of scenes and its pictures; pictures and photographs of mats."""

import contextlib
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.terminal import print_line, print_note
from brickhub.errors import DescriptionError, counted
from brickhub.files import quoted, write_durably
from brickhub.options import option
from bricktwin.target import load_scene, picture_and_size
from bricktwin.twin.floor_picture import faults_of_picture
from bricktwin.worlds import WORLDS, summary

_WIDTH_PX = 480
_HEIGHT_PX = 300
_FOVY_DEG = 29.0
_COLORS = 96
"""Colours of a picture: few, as the documentation has many pictures."""


@dataclass(frozen=True)
class ListWorlds:
    """List the worlds that --scene knows, a line each.

    Examples:
      bricktwin world list
    """

    def execute(self) -> None:
        for name in WORLDS:
            print_line(f"{name:16}{summary(name)}")


@dataclass(frozen=True)
class CheckWorld:
    """Check a picture that is to be the floor: its file, size and proportions, how fine it is.

    One line per finding, with advice; exit code 1 if there are any.

    Examples:
      bricktwin world check mat.png:fll
      bricktwin world check course.png:1000x700
    """

    picture: Annotated[
        Positional[str],
        option(
            metavar="FILE:SIZE", help="An image with its size in mm, mat.png:1000x700, or :fll."
        ),
    ]

    def execute(self) -> int:
        path, size_mm = picture_and_size(self.picture)
        faults = faults_of_picture(path, size_mm)
        for fault in faults:
            print_line(fault)
        if faults:
            return 1
        width_mm, height_mm = size_mm
        print_line(f"{path} on {width_mm:g} x {height_mm:g} mm: all is well")
        return 0


def _point(text: str) -> tuple[float, float]:
    """Column and row of ``"412,310"``. Raises DescriptionError for other texts."""
    numbers = text.split(",")
    with contextlib.suppress(ValueError):
        x, y = map(float, numbers)
        if math.isfinite(x) and math.isfinite(y):
            return x, y
    raise DescriptionError(f"'{text}' is no point of a photograph; give column,row: 412,310")


@dataclass(frozen=True)
class StraightenPhoto:
    """Make a floor of a photograph of a mat: straighten it by the four corners of the mat.

    The corners are in pixels of the photograph, as a viewer shows them: first the upper left one of
    the mat, the others in any order. Without them, a page is written on which they are clicked. The
    picture has one pixel a millimetre.

    Examples:
      bricktwin world straighten photo.jpg:fll
      bricktwin world straighten photo.jpg:fll --corners 412,310 3580,295 3900,2400 120,2450
      bricktwin world straighten photo.jpg:1000x700 --corners 9,8 99,8 99,70 9,70 --out mat.png
    """

    photo: Annotated[
        Positional[str],
        option(
            metavar="FILE:SIZE",
            help="A photograph with the size of the mat in mm, photo.jpg:1000x700, or :fll.",
        ),
    ]
    corners: Annotated[tuple[str, str, str, str] | None, option(metavar="X,Y")] = None
    """The four corners of the mat in the photograph."""
    out: Annotated[Path, option(metavar="FILE")] = Path("mat.png")
    """The .png to write."""
    white: Annotated[str | None, option(metavar="X,Y")] = None
    """A point of white paper in the photograph: the light is corrected so that it is white."""

    def execute(self) -> None:
        # Late, as listing worlds needs no NumPy.
        from bricktwin.worlds.straighten import looks_turned, straightened

        if self.out.suffix.lower() != ".png":
            raise DescriptionError(f"'{self.out}' is no name of a picture; end it in .png")
        path, size_mm = picture_and_size(self.photo)
        if self.corners is None:
            self._ask_for_corners(path)
            return
        corners = [_point(corner) for corner in self.corners]
        picture = straightened(
            path,
            corners,
            size_mm,
            None if self.white is None else _point(self.white),
        )
        file = io.BytesIO()
        picture.save(file, "PNG")
        write_durably(self.out, file.getvalue())
        # A photograph from a flat angle looks so too, so this is no error.
        if looks_turned(corners, size_mm):
            print_note(
                "the mat looks as if its width and height were swapped; the first corner is its "
                "upper left one"
            )
        size = self.photo.rpartition(":")[2]
        print_line(f"{self.out}: {picture.width} x {picture.height} pixels, one a millimetre")
        print_line(f"look at it, then drive on it: --scene {self.out}:{size}")

    def _ask_for_corners(self, path: Path) -> None:
        """Write the page on which the corners are clicked."""
        from bricktwin.worlds.straighten import corners_page

        page = self.out.with_suffix(".html")
        before = f"bricktwin world straighten {quoted(self.photo)}"
        after = f"--out {quoted(self.out)}"
        if self.white is not None:
            after += f" --white {quoted(self.white)}"
        write_durably(page, corners_page(path, before, after).encode())
        print_line(f"{page}: open it in a browser, and click the four corners of the mat")


@dataclass(frozen=True)
class DrawWorlds:
    """Draw worlds as PNG files, with the scout at its start.

    Examples:
      bricktwin world draw --out pictures
      bricktwin world draw maze sumo --out pictures
    """

    scenes: Annotated[
        Positional[tuple[str, ...]],
        option(
            metavar="SCENE", help="Worlds or other scenes, as of --scene; by default all worlds."
        ),
    ] = ()
    out: Annotated[Path, option(metavar="FOLDER")] = Path()
    """Folder for the files, a NAME.png each."""

    def execute(self) -> None:
        for name in self.scenes or WORLDS:
            # The file of a picture, and of a scene in a file, is named by it.
            path = self.out / f"{Path(name).name.replace(':', '_')}.png"
            data = picture_of(name)
            write_durably(path, data)
            print_line(f"{path}: {len(data) / 1000:.0f} kB")
        print_line(f"{counted(len(self.scenes or WORLDS), 'picture')} in {self.out}")


def picture_of(scene: str) -> bytes:
    """PNG file of a scene with the scout at its start. Raises TwinError where nothing can be
    drawn."""
    from PIL import Image

    from bricktwin import robots
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.physics import Physics
    from bricktwin.twin.render.opengl import Renderer

    body = MujocoBody(
        robots.SCOUT,
        load_scene(scene),
        Physics(),
        0,
    )
    # Closer than the camera of films, which has to show where a robot may go.
    body.model.camera("overview").fovy = _FOVY_DEG
    # Twice as large, and made smaller, which smooths the edges of tape.
    with Renderer(
        body,
        2 * _WIDTH_PX,
        2 * _HEIGHT_PX,
        "overview",
        shadows=True,
    ) as renderer:
        drawn = Image.fromarray(renderer.render())
    small = drawn.resize((_WIDTH_PX, _HEIGHT_PX), Image.Resampling.BOX)
    file = io.BytesIO()
    small.quantize(_COLORS).save(file, "PNG", optimize=True)
    return file.getvalue()
