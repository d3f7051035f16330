"""Ray caster, for images of virtual robots without OpenGL: one ray per square of the image.

Coarser and simpler than `opengl`: no specular light, no shadows, and textures have their mean
colour.
"""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.render.opengl import MovingParts, is_fixed_camera, named_camera

_DRAWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)
"""Flags of the geometry groups that MuJoCo draws by default."""
_SKY = (0.50, 0.59, 0.69)
"""Colour of rays that hit nothing."""

Image = NDArray[np.uint8]


class RayCaster:
    """Ray caster of a body, as seen by one of its cameras. Raises TwinError if there is no such
    camera, or a size is invalid.

    With a fixed camera, the static background is cast once; after that, only rays that moving
    geometry may hit.

    Args:
        body: the robot.
        width, height: size of the image in pixels.
        camera: name of a camera.
        spot_px: side of the square of pixels per ray.
    """

    def __init__(
        self,
        body: MujocoBody,
        width: int,
        height: int,
        camera: str,
        spot_px: int = 5,
    ) -> None:
        if min(spot_px, width, height) < 1:
            raise TwinError(
                f"an image of {width} x {height} with spots of {spot_px} cannot be drawn; give "
                "positive sizes in px"
            )
        model = body.model
        self._body = body
        self._spot_px = spot_px
        self._camera = named_camera(model, camera).fixedcamid
        self._width = width
        self._height = height
        fovy = math.radians(float(model.cam_fovy[self._camera]))
        self._rays = _camera_rays(width, height, spot_px, fovy)
        self._colours, self._textures = _colours(model)
        # Geometry that is welded to the world never moves.
        self._is_moving = model.body_weldid[model.geom_bodyid] != 0
        self._image = np.empty(self._rays.shape, np.uint8)
        # These squares are cast anew: all of them at first, and later those with geometry that may
        # have moved.
        rows, columns, _ = self._rays.shape
        self._stale = np.ones((rows, columns), bool)
        self._moving: MovingParts | None = None
        if is_fixed_camera(model, self._camera):
            self._moving = MovingParts(
                model,
                self._camera,
                width,
                height,
                _DRAWN_GROUPS,
            )

    def render(self) -> Image:
        """Draw the present image.

        Returns:
            RGB image, uint8 [height, width, 3].
        """
        data = self._body.data
        self._body.update_visuals()
        if self._moving is not None:
            self._stale |= self._moving.mask(data, self._spot_px)
        camera_axes = data.cam_xmat[self._camera].reshape(3, 3)
        rays = self._rays[self._stale] @ camera_axes.T  # [stale, 3], in the world
        hits, normals = self._cast(rays)
        self._image[self._stale] = self._shade(hits, normals, rays)
        if self._moving is not None:
            # Where something that moves is seen now, the background has to be cast once that has
            # left.
            shows_moving = (hits >= 0) & self._is_moving[hits]
            self._stale[self._stale] = shows_moving
        # The last squares may reach beyond the image, so it is cut to its size.
        pixels = self._image.repeat(self._spot_px, 0).repeat(self._spot_px, 1)
        return pixels[: self._height, : self._width]

    def close(self) -> None:
        """Do nothing: there is nothing to free."""

    def _cast(self, rays: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """First geometry that each ray ``[rays, 3]`` hits, or -1, and the surface normal there."""
        model = self._body.model
        data = self._body.data
        eye = data.cam_xpos[self._camera]
        hits = np.empty((len(rays), 1), np.int32)
        normals = np.empty_like(rays)
        # Rays are cast one by one, because MuJoCo's function for many rays misses geometries that
        # do not collide (4.0.0).
        for ray, geom, normal in zip(rays, hits, normals, strict=True):
            mujoco.mj_ray(
                model,
                data,
                eye,
                ray,
                _DRAWN_GROUPS,
                True,
                -1,
                geom,
                normal,
            )
        return hits[:, 0], normals

    def _shade(
        self,
        hits: NDArray[np.int32],
        normals: NDArray[np.float64],
        rays: NDArray[np.float64],
    ) -> NDArray[np.uint8]:
        """Colours ``[rays, 3]`` under the headlight and the lights of the scene, without specular
        light."""
        model = self._body.model
        data = self._body.data
        # By Lambert's law, a surface reflects light by the cosine of its angle to the normal. The
        # headlight shines along the rays.
        headlight = model.vis.headlight
        cosines = -(normals * rays).sum(-1, keepdims=True)  # [rays, 1]
        facing = np.clip(cosines, 0.0, 1.0)
        light = headlight.ambient + facing * headlight.diffuse
        for lamp in range(model.nlight):
            cosines = -normals @ data.light_xdir[lamp]
            facing = np.clip(cosines, 0.0, 1.0)[:, None]
            diffuse = facing * model.light_diffuse[lamp]
            light = light + model.light_ambient[lamp] + diffuse
        # The sky is not lit, because it shines by itself.
        light[hits < 0] = 1.0
        # The lit colour is clipped to white before the texture is applied, as OpenGL does.
        lit = np.clip(self._colours[hits] * light, 0.0, 1.0)
        colours = lit * self._textures[hits]
        levels = np.rint(colours * 255)
        shaded: NDArray[np.uint8] = levels.astype(np.uint8)
        return shaded


def _camera_rays(
    width: int,
    height: int,
    spot_px: int,
    fovy: float,
) -> NDArray[np.float64]:
    """Directions of the rays through the middle of each square ``[rows, columns, 3]``, in the frame
    of a camera with this vertical field of view (rad): x to the right, y up, z back."""
    focal_px = height / 2 / math.tan(fovy / 2)
    corners = np.mgrid[:height:spot_px, :width:spot_px]
    rows, columns = corners + spot_px / 2
    across = (columns - width / 2) / focal_px
    down = (rows - height / 2) / focal_px
    ahead = np.full_like(across, -1.0)
    rays = np.stack([across, -down, ahead], -1)
    lengths = np.linalg.norm(rays, axis=-1, keepdims=True)
    directions: NDArray[np.float64] = rays / lengths
    return directions


def _colours(model: mujoco.MjModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Colour and mean texture colour (RGB in 0..1) of each geometry, and of the sky; ``[geometries
    + 1, 3]`` each."""
    # The sky is the last row, because a ray that hits nothing reads index -1.
    rgb = model.geom_rgba[:, :3].astype(float)
    colours = np.vstack((rgb, _SKY))
    textures = np.ones((model.ngeom + 1, 3))
    for geom, material in enumerate(model.geom_matid):
        if material < 0:
            continue
        colours[geom] = model.mat_rgba[material, :3]
        # A material has a slot for each role of a texture. Ours use one of them, and -1 means none.
        texture = int(model.mat_texid[material].max())
        if texture >= 0:
            textures[geom] = _mean_colour(model, texture)
    return colours, textures


def _mean_colour(model: mujoco.MjModel, texture: int) -> NDArray[np.float64]:
    """Mean of a texture's pixels [3], in 0..1."""
    start = int(model.tex_adr[texture])
    channels = int(model.tex_nchannel[texture])
    height = int(model.tex_height[texture])
    width = int(model.tex_width[texture])
    end = start + height * width * channels
    pixels = model.tex_data[start:end].reshape(-1, channels)
    mean: NDArray[np.float64] = pixels[:, :3].mean(0) / 255
    return mean
