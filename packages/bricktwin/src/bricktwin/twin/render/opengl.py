"""Offscreen OpenGL renderer of virtual robots, which draws only what may have changed. Training
never imports this."""

import contextlib
import ctypes
import errno
import importlib
import itertools
import math
import os
import shutil
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import RenderingUnavailableError, TwinError, message_of
from brickhub.files import check_writable, put_in_place, temporary_beside, writing
from bricktwin.twin.make_body import ASKED_GL
from bricktwin.twin.mujoco_body import MujocoBody

_NEAR_M = 1e-3
"""Least depth in the projection; nearer points are treated as at this depth."""


@dataclass(frozen=True)
class Box:
    """Part of an image in px, from its upper left corner; ``right`` and ``bottom`` are
    exclusive."""

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
    body = model.cam_bodyid[camera]
    # The world is body 0, so this camera is welded to it.
    return bool(fixed and model.body_weldid[body] == 0)


def is_opaque(model: mujoco.MjModel, groups: NDArray[np.uint8]) -> bool:
    """True if no geometry of the drawn groups is transparent."""
    drawn = np.flatnonzero(groups[model.geom_group])
    # A geometry has its own colour, and may have that of a material instead.
    materials = model.geom_matid[drawn]
    used = materials[materials >= 0]
    own_alphas = model.geom_rgba[drawn, 3]
    material_alphas = model.mat_rgba[used, 3]
    return bool((own_alphas == 1.0).all() and (material_alphas == 1.0).all())


class MovingParts:
    """Part of a fixed camera's image that moving geometry may cover. ``groups``: flags of the
    geometry groups that are drawn."""

    def __init__(
        self,
        model: mujoco.MjModel,
        camera: int,
        width: int,
        height: int,
        groups: NDArray[np.uint8],
    ) -> None:
        self._camera = camera
        self._width = width
        self._height = height
        moves = model.body_weldid[model.geom_bodyid] != 0
        is_drawn = groups[model.geom_group] != 0
        self._geoms = np.flatnonzero(moves & is_drawn)
        middle = model.geom_aabb[self._geoms, None, :3]  # [geoms, 1, 3]
        half = model.geom_aabb[self._geoms, None, 3:]
        signs = np.array(list(itertools.product((-1, 1), repeat=3)))  # [8, 3]
        self._corners = middle + half * signs  # [geoms, 8, 3], in the frame of each geometry
        fovy = math.radians(float(model.cam_fovy[camera]))
        focal_px = height / 2 / math.tan(fovy / 2)
        # Rows of an image count downwards, unlike the camera's y axis.
        self._focal_px = np.array((focal_px, -focal_px))
        self._middle_px = np.array((width, height)) / 2
        self._whole = (0, 0, width, height)

    def box(self, data: mujoco.MjData) -> Box:
        """Bounding box of all moving geometry, with a margin of 1 px; empty if there is none."""
        if not len(self._geoms):
            return Box(0, 0, 0, 0)
        bounds = self._bounds(data)
        upper_left = bounds[:, :2].min(0)
        lower_right = bounds[:, 2:].max(0)
        left, top = upper_left.tolist()
        right, bottom = lower_right.tolist()
        return Box(left, top, right, bottom)

    def mask(
        self,
        data: mujoco.MjData,
        spot_px: int,
    ) -> NDArray[np.bool_]:
        """Mask ``[rows, columns]`` of the squares of ``spot_px`` that moving geometry may cover."""
        # Counts are rounded up, because the last squares may reach beyond the image.
        rows = -(-self._height // spot_px)
        columns = -(-self._width // spot_px)
        mask = np.zeros((rows, columns), bool)
        bounds = self._bounds(data)
        bounds[:, 2:] += spot_px - 1
        for left, top, right, bottom in bounds // spot_px:
            mask[top:bottom, left:right] = True
        return mask

    def _bounds(self, data: mujoco.MjData) -> NDArray[np.int64]:
        """Left, top, right and bottom of each geometry's bounding box, with a margin of 1 px;
        ``[geometries, 4]``."""
        # The corners of the boxes, seen from the camera, are [geoms, 8, 3] in the axes of the
        # world.
        axes = data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        rotated = self._corners @ axes.transpose(0, 2, 1)
        middles = data.geom_xpos[self._geoms, None]
        corners = rotated + middles - data.cam_xpos[self._camera]

        # In the camera's axes they are to the right, up and back, and a central projection makes
        # the image of them.
        camera_axes = data.cam_xmat[self._camera].reshape(3, 3)
        local = corners @ camera_axes
        depths = np.maximum(-local[..., 2:], _NEAR_M)  # [geoms, 8, 1]
        from_middle_px = self._focal_px * local[..., :2] / depths
        pixels = self._middle_px + from_middle_px  # [geoms, 8, 2]
        upper_left = np.floor(pixels.min(1)) - 1
        lower_right = np.ceil(pixels.max(1)) + 1
        bounds = np.concatenate((upper_left, lower_right), 1)
        # What reaches beside or behind the camera may cover any part of the image.
        is_beside = local[..., 2].max(1) > -_NEAR_M
        bounds[is_beside] = self._whole
        size = self._whole[2:]
        clipped = np.minimum(np.maximum(bounds, 0), size * 2)
        whole_px: NDArray[np.int64] = clipped.astype(np.int64)
        return whole_px


def aim(
    scene: mujoco.MjvScene,
    box: Box,
    width: int,
    height: int,
) -> None:
    """Narrow the view of the scene's camera to a part of its image of ``width`` x ``height`` px."""
    for camera in scene.camera:
        top = camera.frustum_top
        bottom = camera.frustum_bottom
        height_m = top - bottom
        half_width = height_m / 2 * width / height
        middle = (box.left + box.right) / width
        camera.frustum_center = half_width * (middle - 1.0)
        camera.frustum_width = half_width * box.width / width
        camera.frustum_top = top - height_m * box.top / height
        camera.frustum_bottom = top - height_m * box.bottom / height


Image = NDArray[np.uint8]

_REMEDY = (
    "install one (Debian: apt install libegl1 libgl1-mesa-dri, or libosmesa6) or set "
    "MUJOCO_GL to one that works"
)
_LIBRARIES = {
    "egl": ("libEGL.so.1",),
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
}
_DISABLED = ("disable", "disabled", "off", "false", "0")
"""Values of MUJOCO_GL that disable MuJoCo's rendering."""
_MAX_GEOMS = 1000
"""Geometries of a scene, with decorations."""
_TABLE_BYTES = 2**20
"""Size that a film's table of images never reaches."""
_LITTLE_BYTES = 2**20
"""Free space below which a disk counts as full."""
_PIXEL = np.dtype("V3")
"""Type of a pixel as one value, which is copied several times as fast as its three colours."""

Decorate = Callable[[mujoco.MjvScene], None]
"""A function that adds decorations to a scene before each rendering."""


class Renderer(contextlib.AbstractContextManager["Renderer"]):
    """Renderer of a body, as seen by a camera.

    With a fixed camera, the static background is drawn once; after that, only the part of the image
    with moving geometry is redrawn. Without anti-aliasing and transparency, only the moving
    geometry is drawn there, and composited over the background by depth.

    Args:
        body: the robot.
        width, height: size of the image in pixels.
        camera: name of a camera: "chase" follows the robot, "overview" is fixed; or a camera
            object, whose present pose is used for each image.
        decorate: adds decorations to the scene.
        shadows: draw shadows; without a graphics card they take far longer than all the rest.
        smooth: anti-aliasing; without a graphics card it doubles the time.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: there is no such camera, or the image size is invalid.
    """

    def __init__(
        self,
        body: MujocoBody,
        width: int = 320,
        height: int = 240,
        camera: str | mujoco.MjvCamera = "chase",
        *,
        decorate: Decorate | None = None,
        shadows: bool = False,
        smooth: bool = True,
    ) -> None:
        if not isinstance(body, MujocoBody):
            raise TwinError(
                f"there is nothing to see of robot '{body.robot.name}', which has no MuJoCo model"
            )
        model = body.model
        if width < 1 or height < 1:
            raise TwinError(
                f"an image of {width} x {height} cannot be drawn; give positive sizes in pixels"
            )
        is_named = isinstance(camera, str)
        self._camera = named_camera(model, camera) if isinstance(camera, str) else camera
        self._decorate = decorate
        self._body = body
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._whole = Box(0, 0, width, height)
        self._background: tuple[Image, NDArray[np.float32]] | None = None
        self._moving: MovingParts | None = None
        # The background is kept only for a camera that stays where it is, without shadows and
        # decorations, which would change it.
        keeps_background = is_named and not shadows and decorate is None
        fixed = self._camera.fixedcamid
        groups = self._option.geomgroup
        if keeps_background and is_fixed_camera(model, fixed):
            self._moving = MovingParts(
                model,
                fixed,
                width,
                height,
                groups,
            )
            # Smoothing and transparency mix a moving part with what is behind it, so drawing it on
            # a kept background would differ.
            self._is_composited = not smooth and is_opaque(model, groups)
        model.vis.global_.offwidth = width
        model.vis.global_.offheight = height
        model.vis.quality.offsamples = 4 if smooth else 0
        self._gl, self._context = _open_context(model, width, height)
        # OpenGL objects must be freed in their own context, because another one may have an object
        # of the same number.
        self._free = weakref.finalize(
            self,
            _free_context,
            self._gl,
            self._context,
        )
        # The end of the process frees everything anyway, and by then the display may be gone.
        self._free.atexit = False

    def render(self) -> Image:
        """Draw the present image.

        Returns:
            RGB image, uint8 [height, width, 3].
        """
        if not self._free.alive:
            raise TwinError("this renderer is closed; make a new one")
        data = self._body.data
        self._body.update_visuals()
        self._gl.make_current()
        if self._moving is None:
            pixels, _ = self._draw(self._whole, mujoco.mjtCatBit.mjCAT_ALL)
            return pixels.copy()
        if self._background is None:
            self._background = self._draw(self._whole, mujoco.mjtCatBit.mjCAT_STATIC)
        background, background_depth = self._background
        image = background.copy()
        box = self._moving.box(data)
        if not (box.width and box.height):
            return image
        rows = slice(box.top, box.bottom)
        columns = slice(box.left, box.right)
        part = (rows, columns)
        is_nearer: NDArray[np.bool_] | np.bool_
        if self._is_composited:
            pixels, depth = self._draw(box, mujoco.mjtCatBit.mjCAT_DYNAMIC)
            is_nearer = (depth < background_depth[part])[..., None]
        else:
            pixels, _ = self._draw(box, mujoco.mjtCatBit.mjCAT_ALL)
            is_nearer = np.True_
        target = image.view(_PIXEL)[part]
        np.copyto(target, pixels.view(_PIXEL), where=is_nearer)
        return image

    def _draw(
        self,
        box: Box,
        categories: int,
    ) -> tuple[Image, NDArray[np.float32]]:
        """Part of the image and its depth, 0 (near) to 1; ``categories`` selects all, static or
        moving geometry."""
        mujoco.mjv_updateScene(
            self._body.model,
            self._body.data,
            self._option,
            None,
            self._camera,
            categories,
            self._scene,
        )
        # A picture of moving parts alone must not have the sky, which belongs to the background.
        has_sky = categories != mujoco.mjtCatBit.mjCAT_DYNAMIC
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = has_sky
        if self._decorate is not None:
            self._decorate(self._scene)
        aim(
            self._scene,
            box,
            self._whole.width,
            self._whole.height,
        )
        viewport = mujoco.MjrRect(0, 0, box.width, box.height)
        size = (box.height, box.width)
        pixels = np.empty((*size, 3), np.uint8)
        depth = np.empty(size, np.float32)
        # A buffer of exactly this size is cleared at once, but a part of a larger one pixel by
        # pixel.
        mujoco.mjr_resizeOffscreen(box.width, box.height, self._context)
        mujoco.mjr_render(viewport, self._scene, self._context)
        mujoco.mjr_readPixels(
            pixels,
            depth,
            viewport,
            self._context,
        )
        # OpenGL's first row is the lowest one.
        return pixels[::-1], depth[::-1]

    def close(self) -> None:
        """Free the OpenGL context; closing twice does nothing."""
        self._free()

    def __exit__(self, *_: object) -> None:
        self.close()


class VideoWriter(contextlib.AbstractContextManager["VideoWriter"]):
    """Writer of an mp4 file (H.264, playable in browsers), image by image; the file is renamed to
    ``path`` when complete. Raises WriteError if it cannot be written.

    Args:
        path: path of the file; its folder is created.
        fps: images per second.
    """

    def __init__(
        self,
        path: str | Path,
        fps: float,
    ) -> None:
        self.path = Path(path)
        check_writable(self.path)
        self._fps = fps
        # Python raises Ctrl-C in the main thread, and in the middle of an image it would kill the
        # encoder, and with it the film so far. So another thread talks to the encoder.
        self._thread: ThreadPoolExecutor | None = None
        self._file: Any = None
        self._part: Path | None = None
        self._size: tuple[int, ...] = ()
        self._is_closed = False

    def add(self, frame: Image) -> None:
        """Add an image, uint8 [height, width, 3]. Raises TwinError if its size differs from the
        first one's, or after `close`."""
        if self._is_closed:
            raise TwinError(
                f"the film {self.path} is finished and takes no more images; write another one"
            )
        size = self._size or frame.shape
        if frame.shape != size or frame.dtype != np.uint8:
            raise TwinError(
                f"a frame is {frame.dtype} {frame.shape}, the first was uint8 {size}; give "
                "frames of one size"
            )
        try:
            if self._file is None:
                self._open(frame)
            else:
                self._in_thread(self._file.send, np.ascontiguousarray(frame))
        except (OSError, StopIteration):
            # The encoder has ended, most likely because the disk is full.
            self._file = None
            self._fail()

    def _open(self, frame: Image) -> None:
        import imageio_ffmpeg

        with writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            # The path is absolute, because in others the encoder takes what is before a colon for a
            # protocol.
            self._part = temporary_beside(self.path.absolute(), ".mp4")
            self._part.touch(exist_ok=False)
        self._size = frame.shape
        height, width, *_ = self._size
        self._file = imageio_ffmpeg.write_frames(
            str(self._part),
            (width, height),
            fps=self._fps,
            codec="libx264",
            quality=7,
            macro_block_size=2,
            ffmpeg_log_level="quiet",
        )
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="bricktwin-film")
        # This runs the generator up to its first `yield`, where it takes images. The first image
        # follows in the same go, as the encoder makes no film of none.
        self._in_thread(self._begin, np.ascontiguousarray(frame))

    def _begin(self, frame: Image) -> None:
        self._file.send(None)
        self._file.send(frame)

    def _in_thread(self, call: Callable[..., object], *arguments: object) -> None:
        """Call this after what was called before, and wait for it. Raises what it raises."""
        assert self._thread is not None  # noqa: S101  it begins with the encoder
        self._thread.submit(call, *arguments).result()

    def close(self, *, complete: bool = True) -> None:
        """Finish and rename the file, or delete it if it is not ``complete``; closing twice does
        nothing."""
        self._is_closed = True
        file = self._file
        self._file = None
        if file is None or self._part is None:
            return
        try:
            self._in_thread(file.close)
            if complete:
                if not _is_whole(self._part):
                    self._fail()
                with writing(self.path):
                    put_in_place(self._part, self.path)
        finally:
            self._part.unlink(missing_ok=True)
            if self._thread is not None:
                self._thread.shutdown(wait=False)

    def _fail(self) -> NoReturn:
        """Raise WriteError, with what is probably the reason: the encoder says none."""
        with writing(self.path):
            assert self._part is not None  # noqa: S101  the encoder has begun it
            self._part.unlink(missing_ok=True)
            if shutil.disk_usage(self.path.parent).free < _LITTLE_BYTES:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            raise OSError(errno.EIO, "the encoder ended")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        *_: object,
    ) -> None:
        self.close(complete=kind is None)


def _is_whole(path: Path) -> bool:
    """Whether an mp4 file has its table of images, which the encoder writes last."""
    with path.open("rb") as written:
        size = path.stat().st_size
        written.seek(max(0, size - _TABLE_BYTES))
        return b"moov" in written.read()


def named_camera(model: mujoco.MjModel, name: str) -> mujoco.MjvCamera:
    """Camera of a model. Raises TwinError if there is none of this name."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    camera.fixedcamid = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if camera.fixedcamid < 0:
        names = [model.camera(index).name for index in range(model.ncam)]
        cameras = ", ".join(names)
        raise TwinError(f"there is no camera '{name}'; choose one of {cameras}")
    return camera


def _free_context(gl: Any, context: Any) -> None:
    # This fails while the process ends, after MuJoCo has closed the display; by then everything is
    # freed.
    with contextlib.suppress(Exception):
        gl.make_current()
        context.free()
        gl.free()


def _open_context(
    model: mujoco.MjModel,
    width: int,
    height: int,
) -> tuple[Any, Any]:
    """An OpenGL context and MuJoCo's rendering context in it."""
    asked_for = os.environ.get("MUJOCO_GL", "")
    backend = asked_for.lower().strip() or _choose_backend()
    if backend:
        # MuJoCo reads this variable when it loads OpenGL's functions, so it has to be set before.
        os.environ["MUJOCO_GL"] = backend
    if backend in _DISABLED:
        asked = os.environ.get(ASKED_GL, backend)
        raise RenderingUnavailableError(
            f"nothing is drawn with MUJOCO_GL={asked}; unset it, or {_REMEDY}"
        )
    try:
        module: Any = mujoco
        if backend in ("egl", "osmesa", "glfw", "cgl"):
            # MuJoCo chose its library when it was imported, which may be another one than was asked
            # for.
            module = importlib.import_module(f"mujoco.{backend}")
        if not hasattr(module.GLContext, "_context"):
            # The destructor reads this attribute even if the constructor failed.
            module.GLContext._context = None
        gl = module.GLContext(width, height)
        gl.make_current()
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    except Exception as error:
        # All errors are caught, because libraries fail with different ones: ImportError,
        # AttributeError, RuntimeError, or those of ctypes and GL.
        name = backend or "the system's OpenGL"
        raise RenderingUnavailableError(
            f"nothing can be drawn with {name} ({message_of(error, 120)}); {_REMEDY}"
        ) from error
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    return gl, context


def _choose_backend() -> str:
    """OpenGL library if the user named none; empty for MuJoCo's default."""
    # MuJoCo's own choice works with a window system, and on other systems, so only a Linux without
    # one needs ours.
    has_windows = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not sys.platform.startswith("linux") or has_windows:
        return ""
    for backend, names in _LIBRARIES.items():
        for name in names:
            with contextlib.suppress(OSError):
                ctypes.CDLL(name)
                return backend
    raise RenderingUnavailableError(f"no OpenGL library is here to draw with; {_REMEDY}")
