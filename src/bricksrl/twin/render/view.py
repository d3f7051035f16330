"""Static-scene culling: the part of a picture that changes when nothing but the robot moves, and how to aim at it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_NEAR_M = 1e-3
"""Nothing nearer to a camera than this is seen as it is."""


@dataclass(frozen=True)
class Box:
    """A part of an image in px, from its upper left; the right column and the bottom row lie beyond it."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        return self.right - self.left

    @property
    def height(self) -> int:
        return self.bottom - self.top


def stands_still(model: mujoco.MjModel, camera: int) -> bool:
    """True if a camera never moves."""
    fixed = model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    return bool(fixed and model.body_weldid[model.cam_bodyid[camera]] == 0)


def is_opaque(model: mujoco.MjModel, shown: NDArray[np.uint8]) -> bool:
    """True if nothing in the groups of geometries that are drawn can be seen through."""
    geoms = np.flatnonzero(shown[model.geom_group])
    materials = model.geom_matid[geoms]
    alphas = *model.geom_rgba[geoms, 3], *model.mat_rgba[materials[materials >= 0], 3]
    return all(alpha == 1.0 for alpha in alphas)


class MovingParts:
    """Part of the image of a camera that stands still in which something may move.

    Args:
        shown: which groups of geometries are drawn, one flag each.
    """

    def __init__(self, model: mujoco.MjModel, camera: int, width: int, height: int, shown: NDArray[np.uint8]) -> None:
        self._camera, self._width, self._height = camera, width, height
        moves = model.body_weldid[model.geom_bodyid] != 0
        self._geoms = np.flatnonzero(moves & (shown[model.geom_group] != 0))
        middle, half = model.geom_aabb[self._geoms, None, :3], model.geom_aabb[self._geoms, None, 3:]
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        self._corners = middle + half * signs  # [geoms, 8, 3], in the frame of each
        self._focal_px = height / 2 / math.tan(math.radians(float(model.cam_fovy[camera])) / 2)

    def box(self, data: mujoco.MjData) -> Box:
        """The part of the image that holds all of them, with a px to spare; of no width where there are none."""
        if not len(self._geoms):
            return Box(0, 0, 0, 0)
        left, top, right, bottom = self._bounds(data)
        return Box(int(left.min()), int(top.min()), int(right.max()), int(bottom.max()))

    def mask(self, data: mujoco.MjData, spot_px: int) -> NDArray[np.bool_]:
        """The squares of so many px ``[rows, columns]`` that one of them may show in."""
        mask = np.zeros((-(-self._height // spot_px), -(-self._width // spot_px)), bool)
        bounds = self._bounds(data)
        bounds[2:] += spot_px - 1
        for left, top, right, bottom in (bounds // spot_px).T:
            mask[top:bottom, left:right] = True
        return mask

    def _bounds(self, data: mujoco.MjData) -> NDArray[np.int64]:
        """Left, top, right and bottom of the box around each of them, with a px to spare; ``[4, geometries]``."""
        turned = self._corners @ data.geom_xmat[self._geoms].reshape(-1, 3, 3).transpose(0, 2, 1)
        corners = turned + data.geom_xpos[self._geoms, None] - data.cam_xpos[self._camera]
        right, up, back = np.moveaxis(corners @ data.cam_xmat[self._camera].reshape(3, 3), -1, 0)
        depth = np.maximum(-back, _NEAR_M)
        columns = self._width / 2 + self._focal_px * right / depth
        rows = self._height / 2 - self._focal_px * up / depth
        upper_left = [np.floor(part.min(1)) - 1 for part in (columns, rows)]
        bounds = np.array([*upper_left, *(np.ceil(part.max(1)) + 1 for part in (columns, rows))])
        beside = back.max(1) > -_NEAR_M  # or behind the camera: it may show anywhere
        bounds[:2, beside], bounds[2:, beside] = 0, [[self._width], [self._height]]
        limits = np.array([[self._width], [self._height]] * 2)
        within: NDArray[np.int64] = np.clip(bounds, 0, limits).astype(np.int64)
        return within


def aim(scene: mujoco.MjvScene, box: Box, width: int, height: int) -> None:
    """Narrow the view of the scene's camera to a part of its image of ``width`` x ``height`` px."""
    for camera in scene.camera:
        top, bottom = camera.frustum_top, camera.frustum_bottom
        half_width, rise = (top - bottom) / 2 * width / height, top - bottom
        camera.frustum_center = half_width * ((box.left + box.right) / width - 1.0)
        camera.frustum_width = half_width * box.width / width
        camera.frustum_top = top - rise * box.top / height
        camera.frustum_bottom = top - rise * box.bottom / height
