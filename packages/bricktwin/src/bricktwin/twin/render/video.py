"""Films of virtual robots: captions, a room with metre lines and a ghost of the robot at its goal,
and a robot that is filmed while a program moves it.

All of the room is drawn as decoration, without effect on the physics.
"""

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from brickhub.errors import TwinError
from brickhub.files import check_writable
from brickhub.virtual.body import Body
from bricktwin.drawing import import_matplotlib
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import Renderer, VideoWriter
from bricktwin.twin.scene import Goal
from bricktwin.twin.sensed_pose import pose_at

Pixels = NDArray[np.uint8]
_INK = (31, 36, 48)
_MUTED = (73, 81, 94)
_BACKGROUND = (255, 255, 255)
_OPACITY = 205


@functools.lru_cache(maxsize=8)
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, from Matplotlib's data."""
    import_matplotlib()
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size_px)


def captioned(
    image: Pixels,
    title: str,
    line: str,
    labels: Iterable[tuple[int, int, str]] = (),
) -> Pixels:
    """The image ``[height, width, 3]`` with title and line in its upper left corner, and labels
    (column, row, text)."""
    height = image.shape[0]
    # Text grows with the picture, but stays legible in a small one.
    title_font = _font(max(11, height // 26), True)
    small_font = _font(max(9, height // 34), False)
    picture = Image.fromarray(image)
    pen = ImageDraw.Draw(picture)
    for column, row, text in labels:
        pen.text(
            (column, row),
            text,
            _MUTED,
            small_font,
            anchor="mm",
        )
    lines = []
    if title:
        lines.append((title, title_font))
    if line:
        lines.append((line, small_font))
    if lines:
        _write(picture, pen, lines, height // 45)
    return np.asarray(picture)


def _write(
    picture: Image.Image,
    pen: ImageDraw.ImageDraw,
    lines: list[tuple[str, ImageFont.FreeTypeFont]],
    margin: int,
) -> None:
    """Write lines of text, each in its font, on a box in the upper left corner."""
    longest = max(pen.textlength(text, font) for text, font in lines)
    text_height = round(sum(font.size for _, font in lines))
    gap = margin // 2
    width = 2 * margin + round(longest)
    gaps = gap * (len(lines) - 1)
    height = 2 * margin + text_height + gaps
    # Only the area behind the text is blended, because blending the whole image takes longer than
    # drawing the robot.
    mask = Image.new("L", (width, height), 0)
    corners = (0, 0, width - 1, height - 1)
    ImageDraw.Draw(mask).rounded_rectangle(corners, gap, _OPACITY)
    area = (margin, margin, margin + width, margin + height)
    picture.paste(_BACKGROUND, area, mask)
    top = 2.0 * margin
    for text, font in lines:
        pen.text(
            (2 * margin, top),
            text,
            _INK,
            font,
        )
        top += font.size + gap


_BACK_M = 1.3
"""Distance of the wall behind the robot, to the left of its start."""
_HEIGHT_M = 1.6
"""Height of that wall."""
_SKIRTING_M = 0.07
"""Height of its skirting board."""
_LINE = (0.45, 0.50, 0.58, 1.0)
_PAINT_M = 0.0002
"""Height of a metre line, below whatever lies on the floor."""
_WALL = (0.90, 0.90, 0.87, 1.0)
_BOARD = (0.97, 0.97, 0.96, 1.0)
_GHOST = (0.10, 0.62, 0.25, 0.30)
_MOST_AWAY_M = 0.12
"""Farthest that the camera may look past the robot."""
_LAG = 0.06
"""Share of the distance to the robot by which the camera's target moves per image."""


class Room:
    """Decoration and camera of a film of a robot.

    Args:
        body: the robot.
        goal: pose that a ghost shows; ``None`` for a robot without such a goal.

    Attributes:
        camera: camera for a renderer; :meth:`follow` aims it.
    """

    def __init__(
        self,
        body: MujocoBody,
        goal: Goal | None = None,
    ) -> None:
        self._body = body
        self._place = None if goal is None else goal.at_mm
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._moves = body.model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        if not self._moves:
            self.camera.distance = 0.72
        elif self._place is None:
            self.camera.distance = 0.62
        else:
            # The camera is farther away here, because the robot and its goal are both to be seen.
            self.camera.distance = 1.1
        # The camera looks from behind, so that no wall ahead hides the robot.
        self.camera.azimuth = 62.0
        self.camera.elevation = -21.0
        self._target = np.array(self._robot())
        self.camera.lookat[:] = self._target
        self._option = mujoco.MjvOption()
        self._ghost: MujocoBody | None = None
        if goal is not None:
            self._ghost = MujocoBody(
                body.robot,
                body.scene,
                Physics(),
                0,
            )
        self._goal: Goal | None = None
        self.aim_for(goal)

    def aim_for(self, goal: Goal | None) -> None:
        """Let the ghost, if there is one, show another goal."""
        if self._ghost is not None and goal is not None and goal != self._goal:
            self._goal = goal
            pose_at(self._ghost, goal)

    def follow(self) -> None:
        """Move the camera's target towards the robot, or the middle between it and the place where
        it is to go, smoothly."""
        away_m = np.array(self._robot()) - self._target
        distance_m = float(np.linalg.norm(away_m))
        # A share alone would let a fast robot leave the picture.
        share = _LAG
        if distance_m > _MOST_AWAY_M:
            share = max(_LAG, 1.0 - _MOST_AWAY_M / distance_m)
        self._target += share * away_m
        self.camera.lookat[:] = self._target

    def _robot(self) -> tuple[float, float, float]:
        """The point at which the camera should look, m."""
        if not self._moves:
            return 0.04, 0.0, 0.13
        x, y = self._body.data.qpos[:2].tolist()
        if self._place is None:
            return x, y, 0.07
        goal_x, goal_y = (value / 1000 for value in self._place)
        middle_x = (x + goal_x) / 2
        middle_y = (y + goal_y) / 2
        return middle_x, middle_y, 0.07

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Add walls, metre lines and ghost to a scene."""
        # Walls and lines follow the camera in whole metres, so that the room seems to have no end.
        middle = round(float(self._target[0]))
        half_height = _HEIGHT_M / 2
        half_skirting = _SKIRTING_M / 2
        _box(
            scene,
            (middle, _BACK_M + 0.01, half_height),
            (6.0, 0.01, half_height),
            _WALL,
        )
        _box(
            scene,
            (middle, _BACK_M - 0.008, half_skirting),
            (6.0, 0.008, half_skirting),
            _BOARD,
        )
        # The lines across the robot's way end at the wall.
        line_middle = _BACK_M / 2 - 1.0
        half_line = _BACK_M / 2 + 1.0
        for metre in range(middle - 3, middle + 4):
            _box(
                scene,
                (metre, line_middle, 0.0),
                (0.003, half_line, _PAINT_M),
                _LINE,
            )
        for metre in range(-2, 2):
            _box(
                scene,
                (middle, metre, 0.0),
                (6.0, 0.003, _PAINT_M),
                _LINE,
            )
        if self._ghost is not None:
            self._add_ghost(scene, self._ghost)

    def _add_ghost(
        self,
        scene: mujoco.MjvScene,
        ghost: MujocoBody,
    ) -> None:
        """Add the robot at its goal, transparent and of one colour."""
        first = scene.ngeom
        mujoco.mjv_addGeoms(
            ghost.model,
            ghost.data,
            self._option,
            mujoco.MjvPerturb(),
            # Only the moving parts of the second robot are added: its floor and walls are there
            # already.
            mujoco.mjtCatBit.mjCAT_DYNAMIC,
            scene,
        )
        for geom in scene.geoms[first : scene.ngeom]:
            geom.rgba[:] = _GHOST
            geom.matid = -1

    def metre_marks(
        self,
        width: int,
        height: int,
    ) -> list[tuple[int, int, str]]:
        """Labels of the metre lines in an image of that size in px: column, row, text."""
        marks = []
        middle = round(float(self._target[0]))
        for metre in range(middle - 2, middle + 3):
            # Marks stand beside the robot's way, where they do not hide it.
            point = np.array([metre, -0.28, 0.0])
            pixel = self._project(point, width, height)
            if pixel is None:
                continue
            column, row = pixel
            if 0 < column < width and 0 < row < height:
                marks.append((column, row, f"{metre} m"))
        return marks

    def _project(
        self,
        point: NDArray[np.float64],
        width: int,
        height: int,
    ) -> tuple[int, int] | None:
        """Column and row of a point [3] in the image; ``None`` if it is behind the camera."""
        azimuth = math.radians(self.camera.azimuth)
        elevation = math.radians(self.camera.elevation)
        forward = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        # The camera does not lean, so this axis is level.
        right = np.array(
            [
                math.sin(azimuth),
                -math.cos(azimuth),
                0.0,
            ]
        )
        up = np.cross(right, forward)
        back = self.camera.distance * forward
        eye = np.array(self.camera.lookat) - back
        offset = point - eye
        depth = float(offset @ forward)
        if depth < 0.05:
            return None
        # A free camera takes its field of view from the options of the model.
        fovy = math.radians(float(self._body.model.vis.global_.fovy))
        focal_px = height / 2 / math.tan(fovy / 2)
        x = float(offset @ right)
        y = float(offset @ up)
        # Rows of an image count downwards, which reverses the sign of y.
        column = width / 2 + focal_px * x / depth
        row = height / 2 - focal_px * y / depth
        return round(column), round(row)


def _box(
    scene: mujoco.MjvScene,
    position: tuple[float, float, float],
    half: tuple[float, float, float],
    rgba: tuple[float, ...],
) -> None:
    """Add a box to a scene, unless that is full."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_BOX,
        np.array(half),
        np.array(position),
        np.eye(3).ravel(),
        np.array(rgba, np.float32),
    )
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.segid = -1
    scene.ngeom += 1


SIZE = (480, 360)
_FRAME_MS = 40


class Filmed:
    """Proxy of a body that takes an image, as ``render`` returns it, every ``frame_ms`` of
    simulated time."""

    def __init__(
        self,
        body: Any,
        render: Callable[[], Pixels],
        frame_ms: int,
        time_ms: int,
        on_image: Callable[[Pixels], None],
    ) -> None:
        self._body = body
        self._render = render
        self._frame_ms = frame_ms
        self._due_ms = time_ms
        self._on_image = on_image

    def advance_to(self, time_ms: int) -> None:
        """Advance the body; then take an image if one is due."""
        self._body.advance_to(time_ms)
        if time_ms >= self._due_ms:
            # The next frame is due after the last one was due. Counting from now would make the
            # film slower than the robot.
            self._due_ms += self._frame_ms
            self._on_image(self._render())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._body, name)


def check_film(path: Path) -> None:
    """Raise TwinError unless the name ends in .mp4, WriteError if the file cannot be written."""
    if path.suffix.lower() != ".mp4":
        raise TwinError(f"'{path}' is not a name of a film; end it in .mp4")
    check_writable(path)


@contextmanager
def filmed(body: Body, path: Path) -> Iterator[Body]:
    """Film a robot into an mp4 file inside this context, in simulated time. Use the body that it
    yields.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: the robot has no MuJoCo model, or the file is no mp4.
    """
    if not isinstance(body, MujocoBody):
        raise TwinError(
            f"there is nothing to see of robot '{body.robot.name}'; film one with a MuJoCo model"
        )
    check_film(path)
    width, height = SIZE
    fps = 1000 / _FRAME_MS
    # `closing` is used instead of `with writer`, because the film is kept even if the program
    # raises.
    with Renderer(body, width, height) as renderer, closing(VideoWriter(path, fps)) as video:
        video.add(renderer.render())
        yield Filmed(
            body,
            renderer.render,
            _FRAME_MS,
            _FRAME_MS,
            video.add,
        )
