"""Static-scene culling: the part of an image that may change when only the robot moves, and a view narrowed to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_NEAR_M = 1e-3
"""Least depth in the projection; nearer points are treated as at this depth."""


@dataclass(frozen=True)
class Box:
    """Part of an image in px, from its upper left corner; ``right`` and ``bottom`` are exclusive."""

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


def is_fixed_camera(model: mujoco.MjModel, camera: int) -> bool:
    """True if a camera is fixed in the world."""
    fixed = model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    return bool(fixed and model.body_weldid[model.cam_bodyid[camera]] == 0)


def is_opaque(model: mujoco.MjModel, groups: NDArray[np.uint8]) -> bool:
    """True if no geometry of the drawn groups is transparent."""
    geoms = np.flatnonzero(groups[model.geom_group])
    materials = model.geom_matid[geoms]
    alphas = *model.geom_rgba[geoms, 3], *model.mat_rgba[materials[materials >= 0], 3]
    return all(alpha == 1.0 for alpha in alphas)


class MovingParts:
    """Part of a fixed camera's image that moving geometry may cover. ``groups``: flags of the geometry groups that are drawn."""

    def __init__(self, model: mujoco.MjModel, camera: int, width: int, height: int, groups: NDArray[np.uint8]) -> None:
        self._camera, self._width, self._height = camera, width, height
        moves = model.body_weldid[model.geom_bodyid] != 0
        self._geoms = np.flatnonzero(moves & (groups[model.geom_group] != 0))
        middle, half = model.geom_aabb[self._geoms, None, :3], model.geom_aabb[self._geoms, None, 3:]
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        self._corners = middle + half * signs  # [geoms, 8, 3], in the frame of each geometry
        focal_px = height / 2 / math.tan(math.radians(float(model.cam_fovy[camera])) / 2)
        self._focal_px, self._middle_px = np.array((focal_px, -focal_px)), np.array((width, height)) / 2
        self._whole = 0, 0, width, height

    def box(self, data: mujoco.MjData) -> Box:
        """Bounding box of all moving geometry, with a margin of 1 px; empty if there is none."""
        if not len(self._geoms):
            return Box(0, 0, 0, 0)
        bounds = self._bounds(data)
        return Box(*bounds[:, :2].min(0).tolist(), *bounds[:, 2:].max(0).tolist())

    def mask(self, data: mujoco.MjData, spot_px: int) -> NDArray[np.bool_]:
        """Mask ``[rows, columns]`` of the squares of ``spot_px`` that moving geometry may cover."""
        mask = np.zeros((-(-self._height // spot_px), -(-self._width // spot_px)), bool)
        bounds = self._bounds(data)
        bounds[:, 2:] += spot_px - 1
        for left, top, right, bottom in bounds // spot_px:
            mask[top:bottom, left:right] = True
        return mask

    def _bounds(self, data: mujoco.MjData) -> NDArray[np.int64]:
        """Left, top, right and bottom of each geometry's bounding box, with a margin of 1 px; ``[geometries, 4]``."""
        rotated = self._corners @ data.geom_xmat[self._geoms].reshape(-1, 3, 3).transpose(0, 2, 1)
        corners = rotated + data.geom_xpos[self._geoms, None] - data.cam_xpos[self._camera]
        local = corners @ data.cam_xmat[self._camera].reshape(3, 3)  # right, up, back
        pixels = self._middle_px + self._focal_px * local[..., :2] / np.maximum(-local[..., 2:], _NEAR_M)
        bounds = np.concatenate((np.floor(pixels.min(1)) - 1, np.ceil(pixels.max(1)) + 1), 1)
        bounds[local[..., 2].max(1) > -_NEAR_M] = self._whole  # beside or behind the camera: it may cover anything
        clipped: NDArray[np.int64] = np.minimum(np.maximum(bounds, 0), self._whole[2:] * 2).astype(np.int64)
        return clipped


def aim(scene: mujoco.MjvScene, box: Box, width: int, height: int) -> None:
    """Narrow the view of the scene's camera to a part of its image of ``width`` x ``height`` px."""
    for camera in scene.camera:
        top, bottom = camera.frustum_top, camera.frustum_bottom
        half_width, height_m = (top - bottom) / 2 * width / height, top - bottom
        camera.frustum_center = half_width * ((box.left + box.right) / width - 1.0)
        camera.frustum_width = half_width * box.width / width
        camera.frustum_top = top - height_m * box.top / height
        camera.frustum_bottom = top - height_m * box.bottom / height
