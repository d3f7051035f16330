"""Camera as a sensor: its description in a task, detection of red objects in its frames, and sources of frames.

A frame is uint8 ``[height, width, 3]`` in RGB and is never drawn into. The agent does not get the frame but a small image of it
with the goal drawn in. Positions are ``(x, y)`` in px of the frame, from its upper left corner.
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
_HUE_AROUND_RED_DEG = 60.0  # hues within this distance of 0 have red as the strongest channel


@dataclass(frozen=True)
class RedWindow:
    """HSV window of colours that count as red, and the minimum area of an object. Raises DescriptionError if a limit is out of
    range.

    Attributes:
        hue_deg: lowest and highest hue; red is 0, hues below it are negative.
        saturation: lowest saturation, 0..1.
        value: lowest brightness, 0..1.
        area_px: an object is a connected region of more pixels than this.
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
    """Goal position in the frame for a red object; drawn for every episode.

    Attributes:
        places: candidate positions; one is drawn uniformly.
        jitter_px: maximum random shift of it, in whole px, in x and in y.
        radius_px: radius of the green disc that shows the goal to the agent.
        red: window of colours that count as red.
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
    """Camera that looks at the robot. Its image is part of the observation, under the key ``"image"``. Raises DescriptionError if
    the image is larger than the frame or the goal lies outside of it.

    Attributes:
        name: camera in a virtual robot's model.
        device: camera of a real robot: its OpenCV number, or the address of a stream.
        width_px, height_px: size of a frame.
        image_px: side of the agent's square image.
        goal: goal in the image; ``None`` for a camera without one.
        spot_px: without OpenGL, a virtual robot is drawn by ray casting, with one ray per square of this side.
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
        """Diagonal of a frame: the largest possible distance."""
        return math.hypot(self.width_px, self.height_px)


class Camera(Protocol):
    """Source of frames."""

    def frame(self) -> Frame:
        """Present frame; opens the camera if it is closed. Raises CameraError if a real camera cannot be read, or OpenCV is not
        installed, RenderingUnavailableError if a virtual robot cannot be drawn."""

    def close(self) -> None:
        """Release the camera; closing twice does nothing."""


# ---------------------------------------------------------------- detection in a frame


def find_red(frame: Frame, window: RedWindow) -> NDArray[np.float64]:
    """Centres of the bounding boxes of the red objects in a frame ``[height, width, 3]``: ``[objects, 2]``."""
    from scipy import ndimage

    # Hue is computed only for the few pixels that are mostly red. For this, each value of the flat array is compared with the two
    # that follow it: memory is passed through in order, and every third result belongs to a red channel.
    flat = np.ascontiguousarray(frame).reshape(-1)
    strong = flat[:-2] > flat[1:-1]
    strong &= flat[:-2] > flat[2:]
    strong &= flat[:-2] >= math.ceil(255 * window.value)
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
    """Distances from each of the centres ``[objects, 2]`` to the goal; ``[objects]``."""
    return np.hypot(centres[:, 0] - goal[0], centres[:, 1] - goal[1])


def shrink(frame: Frame, side_px: int, disc: tuple[Place, int] | None = None) -> Frame:
    """Area-averaged image ``[side, side, 3]`` of the frame, in which small objects stay visible. ``disc``: centre and radius, in
    px of the frame, of a green disc to draw into the image; the frame is not changed."""
    canvas = frame.astype(np.float32)
    if disc is not None:
        draw_disc(canvas, *disc)
    flat = _squash(canvas, side_px)  # [side, width, 3]
    image = _squash(np.ascontiguousarray(flat.swapaxes(0, 1)), side_px).swapaxes(0, 1)
    shrunk: Frame = np.rint(image).astype(np.uint8)
    return shrunk


def _squash(canvas: NDArray[np.float32], few: int) -> NDArray[np.float32]:
    """Area-average rows ``[many, ...]`` to ``[few, ...]``."""
    many, *rest = canvas.shape
    blocks = math.gcd(few, many)  # no new row spans two blocks
    squashed = _cover(few // blocks, many // blocks) @ canvas.reshape(blocks, many // blocks, -1)
    return squashed.reshape(few, *rest)


@functools.lru_cache(maxsize=16)
def _cover(few: int, many: int) -> NDArray[np.float32]:
    """Weights of area averaging from ``many`` pixels in a row to ``few``; ``[few, many]``."""
    edges = np.arange(few + 1)[:, None] * (many / few)
    reached = np.clip(edges - np.arange(many), 0.0, 1.0)  # share of each pixel that lies before each edge
    share: NDArray[np.float32] = (np.diff(reached, axis=0) * (few / many)).astype(np.float32)
    return share


def draw_disc(canvas: NDArray[Any], centre: Place, radius_px: int) -> None:
    """Draw a green disc into ``[height, width, 3]``; it is clipped at the edges."""
    x, y = centre
    left, top = max(x - radius_px, 0), max(y - radius_px, 0)
    part = canvas[top : max(y + radius_px + 1, 0), left : max(x + radius_px + 1, 0)]
    rows, columns = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
    part[(rows - y) ** 2 + (columns - x) ** 2 <= radius_px**2] = _GREEN


# ---------------------------------------------------------------- state of an episode


class Watch:
    """Goal, image and distances of a camera over one episode.

    Args:
        view: the task's camera.
        rng: generator that the goal is drawn from.
        frame: frame at the start.

    Attributes:
        goal: position of the goal, constant for the episode; ``None`` for a camera without one.
        image: the agent's image, uint8 ``[side, side, 3]``.
        mean_px: mean distance of the red objects from the goal; unchanged where none is seen, 0 at the start.
        nearest_px: distance of the nearest red object; the diagonal of the frame where none is seen.
    """

    def __init__(self, view: CameraView, rng: np.random.Generator, frame: Frame) -> None:
        self._view = view
        self.goal = None if view.goal is None else view.goal.draw(rng)
        self.mean_px, self.nearest_px = 0.0, view.farthest_px
        self.image = self._image(frame)

    def see(self, frame: Frame) -> None:
        """Update image and distances from the frame after a step."""
        self.image = self._image(frame)
        if self._view.goal is None or self.goal is None:
            return
        found_px = distances_px(find_red(frame, self._view.goal.red), self.goal)
        self.nearest_px = self._view.farthest_px
        if len(found_px):
            self.mean_px, self.nearest_px = float(found_px.mean()), float(found_px.min())

    def numbers(self) -> NDArray[np.float32]:
        """Mean and smallest distance in px ``[2]``; empty ``[0]`` for a camera without a goal."""
        return np.array([] if self.goal is None else [self.mean_px, self.nearest_px], np.float32)

    def _image(self, frame: Frame) -> Frame:
        goal, place = self._view.goal, self.goal
        return shrink(frame, self._view.image_px, None if goal is None or place is None else (place, goal.radius_px))


# ---------------------------------------------------------------- sources of frames


class TwinCamera:
    """Camera in the model of a virtual robot. Without OpenGL it is ray cast, coarser and without specular light."""

    def __init__(self, body: Body, view: CameraView) -> None:
        self._body, self._view = body, view
        self._renderer: Renderer | RayCaster | None = None

    def frame(self) -> Frame:
        """Present frame. Raises RenderingUnavailableError if the virtual robot has no MuJoCo model."""
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
            # Anti-aliasing would take most of the time, and its effect vanishes in the small image.
            return Renderer(body, view.width_px, view.height_px, view.name, smooth=False)
        except RenderingUnavailableError as error:
            _log.info("drawing by rays: %s", error)
            return RayCaster(body, view.width_px, view.height_px, view.name, view.spot_px)

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class VideoCamera:
    """Camera beside a real robot, read with OpenCV."""

    def __init__(self, view: CameraView) -> None:
        self._view = view
        self._capture: Any = None

    def frame(self) -> Frame:
        """Present frame. Raises CameraError if OpenCV is not installed, the camera cannot be read, or its frames have another
        size."""
        view = self._view
        if self._capture is None:
            self._capture = _open_capture(view)
        self._capture.grab()  # discard the driver's buffered frame, taken before the robot moved
        taken, frame = self._capture.read()
        if not taken:
            self.close()
            raise CameraError(f"camera {view.device} shows nothing; plug it in, end other programs that use it, or name another")
        height, width = frame.shape[:2]
        if (width, height) != (view.width_px, view.height_px):
            self.close()
            wanted = f"{view.width_px} x {view.height_px}"
            raise CameraError(f"camera {view.device} gives {width} x {height} px, not {wanted}; take one that can")
        return np.ascontiguousarray(frame[..., ::-1])  # BGR to RGB

    def close(self) -> None:
        """Release the camera."""
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
