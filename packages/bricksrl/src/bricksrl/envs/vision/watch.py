"""Goal, image and distances of a camera in an episode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bricksrl.envs.vision.camera import CameraView
from bricksrl.envs.vision.frames import Frame, changed_part, distances_px, find_red, hull, red_part, shrink, shrink_part


class Watch:
    """Goal, image and distances of a camera over one episode. Only changes from the first frame are processed.

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
        self._disc = None if view.goal is None or self.goal is None else (self.goal, view.goal.radius_px)
        self._first, self._first_image = frame, shrink(frame, view.image_px, self._disc)
        self._red_part = None if view.goal is None else red_part(frame, view.goal.red)
        self.image = self._first_image.copy()

    def see(self, frame: Frame) -> None:
        """Update image and distances from the frame after a step."""
        changed = changed_part(frame, self._first)
        self.image = self._first_image.copy()
        shrink_part(self.image, frame, changed, self._disc)
        if self._view.goal is None or self.goal is None:
            return
        rows, columns = changed if self._red_part is None else hull(changed, self._red_part)
        goal = self.goal[0] - columns.start, self.goal[1] - rows.start
        found_px = distances_px(find_red(frame[rows, columns], self._view.goal.red), goal)
        self.nearest_px = self._view.farthest_px
        if len(found_px):
            self.mean_px, self.nearest_px = float(found_px.mean()), float(found_px.min())

    def numbers(self) -> NDArray[np.float32]:
        """Mean and smallest distance in px ``[2]``; empty ``[0]`` for a camera without a goal."""
        return np.array([] if self.goal is None else [self.mean_px, self.nearest_px], np.float32)
