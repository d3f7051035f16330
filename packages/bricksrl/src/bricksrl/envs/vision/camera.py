"""Camera as a sensor: its description in a task, sources of frames, and what is seen in an episode.

The agent does not get the frame but a small image of it with the goal drawn in.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from bricksrl.envs.vision.frames import (
    Disc,
    Frame,
    Place,
    RedWindow,
    distances_px,
    find_red,
    shrink,
)
from bricksrl.errors import CameraError, DescriptionError, RenderingUnavailableError, installed

if TYPE_CHECKING:
    from brickhub.virtual.body import Body
    from bricktwin.twin.render.opengl import Renderer
    from bricktwin.twin.render.raycast import RayCaster

_log = logging.getLogger(__name__)


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
        number = int(rng.integers(len(self.places)))
        x, y = self.places[number]
        jitter_x, jitter_y = self.jitter_px
        shift_x = int(rng.integers(-jitter_x, jitter_x, endpoint=True))
        shift_y = int(rng.integers(-jitter_y, jitter_y, endpoint=True))
        return x + shift_x, y + shift_y


@dataclass(frozen=True)
class CameraView:
    """Camera that looks at the robot. Its image is part of the observation, under the key
    ``"image"``. Raises DescriptionError if the image is larger than the frame or the goal lies
    outside of it.

    Attributes:
        name: camera in a virtual robot's model.
        device: camera of a real robot: its OpenCV number, or the address of a stream.
        width_px, height_px: size of a frame.
        image_px: side of the agent's square image.
        goal: goal in the image; ``None`` for a camera without one.
        spot_px: without OpenGL, a virtual robot is drawn by ray casting, with one ray per square of
            this side.
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
                f"an image of {self.image_px} px cannot be made of a frame of {self.width_px} x "
                f"{self.height_px}; make it smaller"
            )
        if self.spot_px < 1:
            raise DescriptionError(
                f"spots of {self.spot_px} px do not fill a frame; give 1 px or more"
            )
        if self.goal is not None and not self._shows(self.goal.places):
            raise DescriptionError(
                f"a goal needs places within the frame of {self.width_px} x {self.height_px} px; "
                "give some"
            )

    def _shows(self, places: tuple[Place, ...]) -> bool:
        """Whether there are places, all of them in the frame."""
        width = self.width_px
        height = self.height_px
        return bool(places) and all(0 <= x < width and 0 <= y < height for x, y in places)

    @property
    def farthest_px(self) -> float:
        """Diagonal of a frame: the largest possible distance."""
        return math.hypot(self.width_px, self.height_px)


class Camera(Protocol):
    """Source of frames."""

    def frame(self) -> Frame:
        """Present frame, as a new array; opens the camera if it is closed. Raises CameraError if a
        real camera cannot be read, or OpenCV is not installed, RenderingUnavailableError if a
        virtual robot cannot be drawn."""

    def close(self) -> None:
        """Release the camera; closing twice does nothing."""


class TwinCamera:
    """Camera in the model of a virtual robot. Without OpenGL it is ray cast, coarser and without
    specular light."""

    def __init__(
        self,
        body: Body,
        view: CameraView,
    ) -> None:
        self._body = body
        self._view = view
        self._renderer: Renderer | RayCaster | None = None

    def frame(self) -> Frame:
        """Present frame. Raises RenderingUnavailableError if the virtual robot has no MuJoCo
        model."""
        if self._renderer is None:
            from bricktwin.twin.mujoco_body import MujocoBody
            from bricktwin.twin.render.opengl import Renderer
            from bricktwin.twin.render.raycast import RayCaster

            if not isinstance(self._body, MujocoBody):
                raise RenderingUnavailableError(
                    "the virtual robot has no picture; give it a MuJoCo model or no camera"
                )
            view = self._view
            try:
                # Anti-aliasing would take most of the time, and its effect vanishes in the small
                # image.
                self._renderer = Renderer(
                    self._body,
                    view.width_px,
                    view.height_px,
                    view.name,
                    smooth=False,
                )
            except RenderingUnavailableError as error:
                _log.info("drawing by rays: %s", error)
                self._renderer = RayCaster(
                    self._body,
                    view.width_px,
                    view.height_px,
                    view.name,
                    view.spot_px,
                )
        return self._renderer.render()

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
        """Present frame. Raises CameraError if OpenCV is not installed, the camera cannot be read,
        or its frames have another size."""
        view = self._view
        if self._capture is None:
            with installed("OpenCV", CameraError, '"bricksrl[vision]"'):
                import cv2
            # Our own message tells of a missing camera, so OpenCV is silenced.
            level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
            self._capture = cv2.VideoCapture(view.device)
            cv2.utils.logging.setLogLevel(level)
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, view.width_px)
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, view.height_px)
            # A frame that waits in a buffer shows the past.
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        # The driver's buffered frame was taken before the robot moved, so it is dropped.
        self._capture.grab()
        is_read, frame = self._capture.read()
        if not is_read:
            self.close()
            raise CameraError(
                f"camera {view.device} shows nothing; plug it in, allow this program to use it, "
                "end other programs that do, or name another"
            )
        height, width = frame.shape[:2]
        if (width, height) != (view.width_px, view.height_px):
            self.close()
            expected = f"{view.width_px} x {view.height_px}"
            raise CameraError(
                f"camera {view.device} gives {width} x {height} px, not {expected}; take one "
                "that can"
            )
        # OpenCV has BGR, but images here are RGB.
        return np.ascontiguousarray(frame[..., ::-1])

    def close(self) -> None:
        """Release the camera."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None


class Watch:
    """Goal, image and distances of a camera over one episode.

    Args:
        view: the task's camera.
        rng: generator that the goal is drawn from.
        frame: frame at the start.

    Attributes:
        goal: position of the goal, constant for the episode; ``None`` for a camera without one.
        image: the agent's image, uint8 ``[side, side, 3]``.
        mean_px: mean distance of the red objects from the goal; unchanged where none is seen, 0 at
            the start.
        nearest_px: distance of the nearest red object; the diagonal of the frame where none is
            seen.
    """

    def __init__(
        self,
        view: CameraView,
        rng: np.random.Generator,
        frame: Frame,
    ) -> None:
        self._view = view
        self.goal = None if view.goal is None else view.goal.draw(rng)
        self.mean_px = 0.0
        self.nearest_px = view.farthest_px
        self._disc: Disc | None = None
        self._red = RedWindow()
        if view.goal is not None and self.goal is not None:
            self._disc = (self.goal, view.goal.radius_px)
            self._red = view.goal.red
        self.image = shrink(frame, view.image_px, self._disc)

    def see(self, frame: Frame) -> None:
        """Update image and distances from the frame after a step."""
        self.image = shrink(frame, self._view.image_px, self._disc)
        if self.goal is None:
            return
        # Red is looked for in the frame, because a small ball is only a few pixels of the image.
        centres = find_red(frame, self._red)
        found_px = distances_px(centres, self.goal)
        self.nearest_px = self._view.farthest_px
        if len(found_px):
            self.mean_px = float(found_px.mean())
            self.nearest_px = float(found_px.min())

    def numbers(self) -> tuple[float, ...]:
        """Mean and smallest distance in px; empty for a camera without a goal."""
        return () if self.goal is None else (self.mean_px, self.nearest_px)
