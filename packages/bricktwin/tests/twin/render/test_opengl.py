from __future__ import annotations

import errno
import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from videos import read_video

from brickhub.errors import RenderingUnavailableError, TwinError, WriteError
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render import opengl
from bricktwin.twin.render.opengl import Image, Renderer, VideoWriter
from bricktwin.twin.scene import Scene

SCENE = Scene(wall_distance_mm=(250.0, 250.0))


@pytest.fixture(scope="module")
def body() -> MujocoBody:
    return MujocoBody(TWO_WHEELER, SCENE, Physics(), 0)


@pytest.fixture(scope="module", autouse=True)
def _opengl(body: MujocoBody) -> None:
    try:
        Renderer(body, 16, 16).close()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))


def picture(
    body: MujocoBody, width: int, height: int, camera: str = "chase", **options: bool
) -> Image:
    with Renderer(body, width, height, camera, **options) as renderer:
        return renderer.render()


def turquoise(image: Image) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Position of the robot's lower half."""
    red, green, blue = (image[..., channel].astype(int) for channel in range(3))
    return (green > red + 40) & (blue > red + 40)


@pytest.mark.parametrize(("width", "height"), [(64, 64), (320, 240), (640, 480)])
def test_picture_has_given_size_and_shows_robot(body: MujocoBody, width: int, height: int) -> None:
    image = picture(body, width, height)
    assert image.shape == (height, width, 3)
    assert image.dtype == np.uint8
    rows, columns = np.nonzero(turquoise(image))
    assert len(rows) > 0.002 * width * height
    assert 0.25 < rows.mean() / height < 0.75
    assert 0.25 < columns.mean() / width < 0.75


def test_picture_is_upright(body: MujocoBody) -> None:
    image = picture(body, 160, 120)
    red = (image[..., 0] > 100) & (image[..., 1] < 60)
    assert red[:40].mean() > 0.2
    assert red[80:].mean() == 0.0


def test_chase_camera_follows_overview_is_fixed() -> None:
    robot = MujocoBody(TWO_WHEELER, SCENE, Physics(), 0)
    before = {camera: picture(robot, 320, 240, camera) for camera in ("chase", "overview")}
    robot.set_voltage("E", 5000)
    robot.set_voltage("A", -5000)
    robot.advance_to(2000)
    columns = {}
    for camera, image in before.items():
        now = picture(robot, 320, 240, camera)
        columns[camera] = (
            np.nonzero(turquoise(now))[1].mean() - np.nonzero(turquoise(image))[1].mean()
        )
    assert abs(columns["chase"]) < 10
    assert columns["overview"] < -40


def test_shadows_darken_and_smoothing_changes_edges(body: MujocoBody) -> None:
    plain = picture(body, 160, 120, "portrait", smooth=False)
    assert (
        picture(body, 160, 120, "portrait", smooth=False, shadows=True).mean() < plain.mean() - 0.5
    )
    assert not np.array_equal(picture(body, 160, 120, "portrait"), plain)


def test_rendering_does_not_change_physics() -> None:
    poses = []
    for draws in (False, True):
        robot = MujocoBody(TWO_WHEELER, SCENE, Physics(), 0)
        robot.set_voltage("E", 4000)
        for now_ms in range(0, 400, 100):
            robot.advance_to(now_ms)
            if draws:
                picture(robot, 32, 32)
        poses.append(robot.pose())
    assert poses[0] == poses[1]


@pytest.mark.parametrize(
    ("camera", "smooth", "alpha"),
    [
        ("webcam", False, None),
        ("overview", False, None),
        ("webcam", True, None),
        ("webcam", False, 0.5),
    ],
)
def test_static_culling_gives_same_picture(
    camera: str, smooth: bool, alpha: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = MujocoBody(ROBO_ARM, Scene(ball=True), Physics(), 0)
    if alpha is not None:  # of all that can be seen
        arm.model.geom_rgba[:, 3] = arm.model.mat_rgba[:, 3] = alpha
    with Renderer(arm, 160, 120, camera, smooth=smooth) as renderer:
        for port, volts, now_ms in (("B", 6000, 400), ("A", 6000, 900), ("D", -6000, 1500)):
            arm.set_voltage(port, volts)
            arm.advance_to(now_ms)
            with monkeypatch.context() as patched:
                patched.setattr(opengl, "is_fixed_camera", lambda model, camera: False)
                whole = picture(arm, 160, 120, camera, smooth=smooth)
            part = renderer.render()
            assert renderer._moving is not None
            assert renderer._is_composited is (not smooth and alpha is None)
            assert 0 < renderer._moving.box(arm.data).width < 160
            apart = np.abs(part.astype(int) - whole).max(-1)
            # Where surfaces of moving and still parts meet in a pixel, rounding decides which one
            # is seen.
            assert (apart > 2).sum() <= 6


def test_picture_is_reproducible_and_independent(body: MujocoBody) -> None:
    with Renderer(body, 64, 64) as renderer:
        first, second = renderer.render(), renderer.render()
    assert np.array_equal(first, second)
    assert first.base is None or first.base is not second.base


def test_mistakes_raise(body: MujocoBody) -> None:
    with pytest.raises(TwinError, match="choose one of overview, chase, portrait"):
        Renderer(body, camera="selfie")
    with pytest.raises(TwinError, match="0 x 240"):
        Renderer(body, width=0)
    renderer = Renderer(body, 16, 16)
    renderer.close()
    renderer.close()
    with pytest.raises(TwinError, match="closed"):
        renderer.render()


PROGRAM = """
from brickhub.errors import RenderingUnavailableError
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
try:
    body = make_body(TWO_WHEELER)
    from bricktwin.twin.render.opengl import Renderer
    Renderer(body)
except RenderingUnavailableError as error:
    print(error)
"""


@pytest.mark.parametrize("backend", ["disable", "nonsense"])
def test_missing_opengl_names_remedy(backend: str) -> None:
    environment = {**os.environ, "MUJOCO_GL": backend}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    assert len(done.stdout.splitlines()) == 1
    assert "MUJOCO_GL" in done.stdout
    assert backend in done.stdout + done.stderr


def test_physics_need_no_opengl() -> None:
    program = (
        "import sys\nfrom bricktwin.robots import TWO_WHEELER\n"
        "from bricktwin.twin.make_body import make_body\n"
    )
    program += (
        "make_body(TWO_WHEELER).advance_to(100)\nprint('bricktwin.twin.render.opengl' in "
        "sys.modules, 'mujoco' in sys.modules)"
    )
    environment = {**os.environ, "MUJOCO_GL": "disable"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "True"]


def test_video_has_frames(body: MujocoBody, tmp_path: Path) -> None:
    frame = picture(body, 96, 64)
    frames = [np.roll(frame, 3 * shift, axis=1) for shift in range(12)]
    path = tmp_path / "deep" / "run.mp4"
    with VideoWriter(path, 20) as video:
        for one in frames:
            video.add(one)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == 12
    assert seconds == pytest.approx(0.6, abs=0.05)
    decoded = read_video(path)
    assert decoded.shape == (12, 64, 96, 3)
    assert np.abs(decoded[0].astype(int) - frame).mean() < 12


def test_mixed_frames_raise_and_leave_no_file(tmp_path: Path) -> None:
    video = VideoWriter(tmp_path / "two.mp4", 20)
    video.add(np.zeros((16, 16, 3), np.uint8))
    with pytest.raises(TwinError, match="one size"), video:
        video.add(np.zeros((32, 16, 3), np.uint8))
    assert not list(tmp_path.iterdir())


def test_video_without_frames_is_no_file(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "none.mp4", 20):
        pass
    assert not list(tmp_path.iterdir())


def test_dropped_renderer_does_not_affect_next() -> None:
    body = MujocoBody(TWO_WHEELER, Scene(), Physics(), 0)
    renderer = Renderer(body, 64, 48)
    first = renderer.render()
    renderer = Renderer(body, 64, 48)
    assert np.array_equal(renderer.render(), first)


def test_renderer_is_silently_collected_at_the_end_of_the_process() -> None:
    """After MuJoCo has closed the display; libraries collect garbage there."""
    program = (
        "import atexit, gc, weakref\n"
        # registers the end of all finalizers, which must be later
        "weakref.finalize(atexit, int)\n"
        "atexit.register(gc.collect)\n"
        "from bricktwin.robots import TWO_WHEELER\n"
        "from bricktwin.twin.make_body import make_body\n"
        "from bricktwin.twin.render.opengl import Renderer\n"
        "gc.disable()\n"
        "renderer = Renderer(make_body(TWO_WHEELER), 16, 16)\n"
        "renderer.itself = renderer\n"
        "del renderer\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_finished_film_takes_no_more_images(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "film.mp4", 20) as video:
        video.add(np.zeros((16, 16, 3), np.uint8))
    with pytest.raises(TwinError, match=r"film .*film.mp4 is finished"):
        video.add(np.zeros((16, 16, 3), np.uint8))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
@pytest.mark.parametrize("at", [0, 2])
def test_ctrl_c_in_the_middle_of_an_image_keeps_the_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """Ctrl-C is a KeyboardInterrupt, and no film that cannot be written."""
    write_frames = imageio_ffmpeg.write_frames

    def interrupted(*arguments: object, **options: object) -> Iterator[None]:
        file = write_frames(*arguments, **options)
        file.send(None)
        for number in itertools.count():
            frame = yield
            if number == at:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.05)  # Python raises it where the main thread is
            file.send(frame)

    monkeypatch.setattr(imageio_ffmpeg, "write_frames", interrupted)
    path = tmp_path / "film.mp4"
    images = itertools.repeat(np.zeros((16, 16, 3), np.uint8), 5)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), closing(VideoWriter(path, 20)) as video:
            list(map(video.add, images))
    finally:
        signal.signal(signal.SIGINT, before)
    assert read_video(path).shape == (at + 1, 16, 16, 3)


def test_film_that_somebody_watches_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows does not replace it."""

    def refuse(_path: Path, _target: Path) -> Path:
        raise PermissionError(errno.EACCES, "Access is denied")

    monkeypatch.setattr(Path, "replace", refuse)
    video = VideoWriter(tmp_path / "film.mp4", 20)
    video.add(np.zeros((16, 16, 3), np.uint8))
    with pytest.raises(WriteError, match=r"cannot write .*film\.mp4 \(Access is denied\)"):
        video.close()
    assert not list(tmp_path.iterdir())
