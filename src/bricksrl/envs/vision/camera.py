"""A camera as a sensor: what a task says of it, what is found in its frames, and where the frames come from.

A frame is uint8 ``[height, width, 3]``, red, green, blue, as it was taken; nobody draws into it. The agent gets a small image of
it, into which the goal is drawn, and never the frame. Places are ``(x, y)`` in px of the frame, from its upper left.
"""

from __future__ import annotations

import functools
import logging
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import CameraError, DescriptionError, RenderingUnavailableError

if TYPE_CHECKING:
    from bricksrl.twin.mujoco_body import MujocoBody
    from bricksrl.twin.render.opengl import Renderer
    from bricksrl.twin.render.raycast import RayCaster
    from bricksrl.virtual_hub.body import Body

Frame = NDArray[np.uint8]
Place = tuple[int, int]

_log = logging.getLogger(__name__)

_GREEN = (0, 255, 0)
_HUE_AROUND_RED_DEG = 60.0  # where red is the strongest of the three colours


@dataclass(frozen=True)
class RedWindow:
    """Window of colours that count as red, and the pixels in one piece that make a thing.

    Attributes:
        hue_deg: lowest and highest hue; red is 0, and what lies below it on the circle of hues is negative.
        saturation: lowest, 0..1.
        value: lowest brightness, 0..1.
        area_px: a thing has more pixels than this.

    Raises:
        DescriptionError: at construction, when nothing red is in the window.
    """

    hue_deg: tuple[float, float] = (-60.0, 24.0)
    saturation: float = 0.6
    value: float = 0.34
    area_px: int = 10

    def __post_init__(self) -> None:
        low, high = self.hue_deg
        if not -_HUE_AROUND_RED_DEG <= low <= high <= _HUE_AROUND_RED_DEG:
            raise DescriptionError(f"hues of {self.hue_deg} degrees are not those around red; give (low, high) within -60 to 60")
        if not (0.0 < self.saturation <= 1.0 and 0.0 < self.value <= 1.0 and self.area_px >= 0):
            raise DescriptionError("a window of red needs saturation and value in 0..1, above 0, and an area_px of 0 or more")


@dataclass(frozen=True)
class VisualGoal:
    """A place in the frame that something red is to be brought to; drawn anew for every episode.

    Attributes:
        places: one of these is drawn,
        jitter_px: and moved by up to so many whole px to either side, in x and in y.
        radius_px: of the green disc that shows the goal to the agent.
        red: what counts as red.
    """

    places: tuple[Place, ...]
    jitter_px: tuple[int, int] = (0, 0)
    radius_px: int = 25
    red: RedWindow = field(default_factory=RedWindow)

    def draw(self, rng: np.random.Generator) -> Place:
        """A random goal."""
        x, y = self.places[int(rng.integers(len(self.places)))]
        moved_x, moved_y = (int(rng.integers(-jitter, jitter, endpoint=True)) for jitter in self.jitter_px)
        return x + moved_x, y + moved_y


@dataclass(frozen=True)
class CameraView:
    """A camera that looks at the robot. Its image joins the observation under the key ``"image"``.

    Attributes:
        name: of the camera in a virtual robot's model.
        device: of the camera beside a real robot: OpenCV's number of it, or an address of a stream.
        width_px, height_px: of a frame.
        image_px: side of the agent's square image.
        goal: what is to be reached in the image; ``None`` for a camera that only shows.
        spot_px: where no OpenGL works, a virtual robot is drawn by rays, one for each square of so many px of the frame.

    Raises:
        DescriptionError: at construction, when the image is larger than the frame or the goal lies outside of it.
    """

    name: str = "webcam"
    device: int | str = 0
    width_px: int = 640
    height_px: int = 480
    image_px: int = 64
    goal: VisualGoal | None = None
    spot_px: int = 5

    def __post_init__(self) -> None:
        if not 1 <= self.image_px <= min(self.width_px, self.height_px):
            raise DescriptionError(
                f"an image of {self.image_px} px cannot be made of a frame of {self.width_px} x {self.height_px}; make it smaller"
            )
        if self.spot_px < 1:
            raise DescriptionError(f"spots of {self.spot_px} px do not fill a frame; give 1 px or more")
        places = self.goal.places if self.goal is not None else ((0, 0),)
        if not places or not all(0 <= x < self.width_px and 0 <= y < self.height_px for x, y in places):
            raise DescriptionError(f"a goal needs places within the frame of {self.width_px} x {self.height_px} px; give some")

    @property
    def farthest_px(self) -> float:
        """Diagonal of a frame: nothing in it is farther from anything else."""
        return math.hypot(self.width_px, self.height_px)


class Camera(Protocol):
    """Source of frames."""

    def frame(self) -> Frame:
        """Frame that the camera sees now; opens the camera where it is closed.

        Raises:
            CameraError: a real camera is not there, or what reads it is not installed.
            RenderingUnavailableError: nothing is here to draw a virtual robot with.
        """

    def close(self) -> None:
        """Let go of the camera; closing twice does nothing."""


# ---------------------------------------------------------------- what is found in a frame


def find_red(frame: Frame, window: RedWindow) -> NDArray[np.float64]:
    """Centres of the red things in a frame ``[height, width, 3]``: of the box around each of them, ``[things, 2]``."""
    from scipy import ndimage

    # Cheap first: few pixels of a frame are mostly red, and only those have their hue computed. Each number is compared with the
    # two that follow it, whatever its colour: that passes through memory in order, and every third answer is about a red one.
    numbers = np.ascontiguousarray(frame).reshape(-1)
    strong = numbers[:-2] > numbers[1:-1]
    strong &= numbers[:-2] > numbers[2:]
    strong &= numbers[:-2] >= math.ceil(255 * window.value)
    rows, columns = np.divmod(np.flatnonzero(strong[::3]), frame.shape[1])
    strongest, second, third = frame[rows, columns].astype(np.float32).T
    chroma = strongest - np.minimum(second, third)
    hue_deg = 60.0 * (second - third) / chroma
    low_deg, high_deg = window.hue_deg
    found = (chroma >= window.saturation * strongest) & (hue_deg >= low_deg) & (hue_deg <= high_deg)
    rows, columns = rows[found], columns[found]
    if not len(rows):
        return np.empty((0, 2))
    top, left = int(rows.min()), int(columns.min())
    mask = np.zeros((int(rows.max()) - top + 1, int(columns.max()) - left + 1), bool)
    mask[rows - top, columns - left] = True
    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    areas = np.bincount(labels[mask])
    boxes = [box for label, box in enumerate(ndimage.find_objects(labels), 1) if areas[label] > window.area_px]
    middles = [[left + (x.start + x.stop - 1) / 2, top + (y.start + y.stop - 1) / 2] for y, x in boxes]
    return np.array(middles).reshape(-1, 2)


def distances_px(centres: NDArray[np.float64], goal: Place) -> NDArray[np.float64]:
    """Distances from each of the centres ``[things, 2]`` to the goal; ``[things]``."""
    return np.hypot(centres[:, 0] - goal[0], centres[:, 1] - goal[1])


def shrink(frame: Frame, side_px: int, disc: tuple[Place, int] | None = None) -> Frame:
    """The frame as an image ``[side, side, 3]``; each pixel is the mean of what it covers, so that small things stay visible.

    Args:
        disc: middle and radius, in px of the frame, of a green disc in the image; the frame itself stays as it is.
    """
    canvas = frame.astype(np.float32)
    if disc is not None:
        draw_disc(canvas, *disc)
    flat = _squash(canvas, side_px)  # [side, width, 3]
    image = _squash(np.ascontiguousarray(flat.swapaxes(0, 1)), side_px).swapaxes(0, 1)
    shrunk: Frame = np.rint(image).astype(np.uint8)
    return shrunk


def _squash(canvas: NDArray[np.float32], few: int) -> NDArray[np.float32]:
    """Rows ``[many, ...]`` to ``[few, ...]``, each the mean of those that it covers."""
    many, *rest = canvas.shape
    blocks = math.gcd(few, many)  # rows of two blocks have nothing to do with each other
    squashed = _cover(few // blocks, many // blocks) @ canvas.reshape(blocks, many // blocks, -1)
    return squashed.reshape(few, *rest)


@functools.lru_cache(maxsize=16)
def _cover(few: int, many: int) -> NDArray[np.float32]:
    """Share that each of ``many`` pixels in a row has in each of the ``few`` that cover the same length; ``[few, many]``."""
    edges = np.arange(few + 1)[:, None] * (many / few)
    reached = np.clip(edges - np.arange(many), 0.0, 1.0)  # share of each pixel that lies before each edge
    share: NDArray[np.float32] = (np.diff(reached, axis=0) * (few / many)).astype(np.float32)
    return share


def draw_disc(canvas: NDArray[Any], centre: Place, radius_px: int) -> None:
    """Draw a green disc, which may reach over the edges, into ``[height, width, 3]``."""
    x, y = centre
    left, top = max(x - radius_px, 0), max(y - radius_px, 0)
    part = canvas[top : max(y + radius_px + 1, 0), left : max(x + radius_px + 1, 0)]
    rows, columns = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
    part[(rows - y) ** 2 + (columns - x) ** 2 <= radius_px**2] = _GREEN


# ---------------------------------------------------------------- an episode before a camera


class Watch:
    """View of a camera over one episode.

    Args:
        view: the task's.
        rng: what the goal is drawn from.
        frame: at the start.

    Attributes:
        goal: its place, the same for the whole episode; ``None`` for a camera that only shows.
        image: the agent's, uint8 ``[side, side, 3]``.
        mean_px: mean distance of the red things from the goal; as before where none is seen, 0 at the start.
        nearest_px: distance of the nearest of them; the diagonal of the frame where none is seen.
    """

    def __init__(self, view: CameraView, rng: np.random.Generator, frame: Frame) -> None:
        self._view = view
        self.goal = None if view.goal is None else view.goal.draw(rng)
        self.mean_px, self.nearest_px = 0.0, view.farthest_px
        self.image = self._image(frame)

    def see(self, frame: Frame) -> None:
        """Take in what the camera sees after a step."""
        self.image = self._image(frame)
        if self._view.goal is None or self.goal is None:
            return
        found_px = distances_px(find_red(frame, self._view.goal.red), self.goal)
        self.nearest_px = self._view.farthest_px
        if len(found_px):
            self.mean_px, self.nearest_px = float(found_px.mean()), float(found_px.min())

    def numbers(self) -> NDArray[np.float32]:
        """Mean and smallest distance in px ``[2]``; of a camera that only shows, none ``[0]``."""
        return np.array([] if self.goal is None else [self.mean_px, self.nearest_px], np.float32)

    def _image(self, frame: Frame) -> Frame:
        goal, place = self._view.goal, self.goal
        return shrink(frame, self._view.image_px, None if goal is None or place is None else (place, goal.radius_px))


# ---------------------------------------------------------------- where frames come from


class TwinCamera:
    """A camera in the model of a virtual robot. Where no OpenGL works, rays draw what it sees, coarser and without shine."""

    def __init__(self, body: Body, view: CameraView) -> None:
        self._body, self._view = body, view
        self._renderer: Renderer | RayCaster | None = None

    def frame(self) -> Frame:
        """Frame that the camera sees now.

        Raises:
            RenderingUnavailableError: the robot has no picture.
        """
        if self._renderer is None:
            from bricksrl.twin.mujoco_body import MujocoBody

            if not isinstance(self._body, MujocoBody):
                raise RenderingUnavailableError("the virtual robot has no picture; give it a MuJoCo model or no camera")
            self._renderer = self._open(self._body)
        return self._renderer.render()

    def _open(self, body: MujocoBody) -> Renderer | RayCaster:
        from bricksrl.twin.render.opengl import Renderer
        from bricksrl.twin.render.raycast import RayCaster

        view = self._view
        try:
            # Smooth edges would take most of the time and vanish in the small image anyway.
            return Renderer(body, view.width_px, view.height_px, view.name, smooth=False)
        except RenderingUnavailableError as error:
            _log.info("drawing by rays: %s", error)
            return RayCaster(body, view.width_px, view.height_px, view.name, view.spot_px)

    def close(self) -> None:
        """Free what OpenGL holds."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class VideoCamera:
    """A camera beside a real robot, read with OpenCV."""

    def __init__(self, view: CameraView) -> None:
        self._view = view
        self._capture: Any = None

    def frame(self) -> Frame:
        """Frame that the camera sees now.

        Raises:
            CameraError: OpenCV is not installed, the camera is not there, or its frames have another size.
        """
        view = self._view
        if self._capture is None:
            self._capture = _open_capture(view)
        self._capture.grab()  # a driver keeps one frame in store, taken before the robot moved
        taken, frame = self._capture.read()
        if not taken:
            self.close()
            raise CameraError(f"camera {view.device} shows nothing; plug it in, end other programs that use it, or name another")
        height, width = frame.shape[:2]
        if (width, height) != (view.width_px, view.height_px):
            self.close()
            wanted = f"{view.width_px} x {view.height_px}"
            raise CameraError(f"camera {view.device} gives {width} x {height} px, not {wanted}; take one that can")
        return np.ascontiguousarray(frame[..., ::-1])  # OpenCV has blue first

    def close(self) -> None:
        """Let go of the camera."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def _open_capture(view: CameraView) -> Any:
    try:
        import cv2
    except ImportError as error:
        raise CameraError("no OpenCV is here to read cameras with; install it: pip install 'bricksrl[vision]'") from error
    capture = cv2.VideoCapture(view.device)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, view.width_px)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, view.height_px)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture
