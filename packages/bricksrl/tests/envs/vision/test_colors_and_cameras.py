"""Windows of red by hand-computed colours, and a camera of OpenCV that is none."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bricksrl.envs.vision import color_calibration
from bricksrl.envs.vision.camera import CameraView, TwinCamera, VideoCamera, VisualGoal, Watch
from bricksrl.envs.vision.color_calibration import (
    FoundRed,
    calibrate_red,
    picture,
    read_red,
    saved_path,
    spanning,
    write_red,
)
from bricksrl.envs.vision.frames import Frame, RedWindow, find_red
from bricksrl.errors import CameraError, DescriptionError, RenderingUnavailableError

Color = tuple[int, int, int]


def grey(*patches: tuple[int, int, int, int, Color]) -> Frame:
    """A grey frame of 60 x 40 with patches: x, y, width, height and colour."""
    frame = np.full((40, 60, 3), 150, np.uint8)
    for x, y, width, height, color in patches:
        frame[y : y + height, x : x + width] = color
    return frame


# ---------------------------------------------------------------- calibration


@pytest.mark.parametrize(
    ("color", "window"),
    [
        # Hue, saturation and value: 0 degrees, 0.9 and 0.784.
        ((200, 20, 20), ((-8.0, 8.0), 0.72, 0.627)),
        # 60 * 90 / 180 = 30 degrees.
        ((200, 110, 20), ((22.0, 38.0), 0.72, 0.627)),
        ((200, 20, 110), ((-38.0, -22.0), 0.72, 0.627)),
        # No hue beyond 60 degrees has red as the strongest channel.
        ((200, 191, 20), ((49.0, 60.0), 0.72, 0.627)),
        ((200, 20, 191), ((-60.0, -49.0), 0.72, 0.627)),
        # Saturation 0.5 and value 1.
        ((255, 127, 127), ((-8.0, 8.0), 0.402, 0.8)),
    ],
)
def test_window_leaves_8_degrees_and_a_fifth_around_one_color(
    color: Color, window: tuple[tuple[float, float], float, float]
) -> None:
    found = calibrate_red(grey((20, 10, 8, 6, color)))
    hue_deg, saturation, value = window
    assert found.window.hue_deg == pytest.approx(hue_deg, abs=0.05)
    assert (found.window.saturation, found.window.value) == pytest.approx(
        (saturation, value), abs=6e-4
    )
    assert found.window.area_px == RedWindow.area_px
    assert found.mask.sum() == 48 and found.middle == (24, 12)


@pytest.mark.parametrize(
    ("other", "belongs"),
    [
        # The seed has the hue 0, the saturation 0.9 and the value 0.784.
        ((200, 106, 20), True),  # 28.7 degrees
        ((200, 114, 20), False),  # 31.3 degrees
        ((200, 105, 105), True),  # a saturation of 0.475
        ((200, 112, 112), False),  # of 0.44
        ((75, 8, 8), True),  # a value of 0.294, where 0.274 is the least
        ((66, 7, 7), False),  # of 0.259
    ],
)
def test_shades_and_highlights_belong_to_an_object_and_other_colors_do_not(
    other: Color, belongs: bool
) -> None:
    frame = grey((20, 10, 8, 6, (200, 20, 20)), (28, 10, 4, 6, other))
    assert calibrate_red(frame, (23, 13)).mask.sum() == (72 if belongs else 48)


def test_what_touches_at_a_corner_is_one_object() -> None:
    red = (200, 20, 20)
    frame = grey((10, 10, 8, 6, red), (18, 16, 2, 2, red), (30, 30, 2, 2, red))
    assert calibrate_red(frame).mask.sum() == 52


@pytest.mark.parametrize(
    ("at", "is_of_it"),
    [
        # Of the seven columns around it, four are of the object, or three.
        ((19, 15), True),
        ((20, 15), False),
        ((10, 15), True),
        ((9, 15), False),
        ((15, 19), True),
        ((15, 20), False),
    ],
)
def test_point_of_an_object_has_more_of_it_around_than_of_the_table(
    at: tuple[int, int], is_of_it: bool
) -> None:
    frame = grey((10, 10, 10, 10, (200, 20, 20)), (40, 10, 10, 10, (200, 130, 20)))
    if is_of_it:
        assert calibrate_red(frame, at).mask.sum() == 100
        return
    with pytest.raises(CameraError) as caught:
        calibrate_red(frame, at)
    assert str(caught.value) == (
        f"nothing is red in the frame at {at[0]}, {at[1]}; bring the ball into the picture, give "
        "it light, or name a point of it"
    )


@pytest.mark.parametrize(("count", "is_enough"), [(10, False), (11, True)])
def test_object_has_more_than_10_pixels(count: int, is_enough: bool) -> None:
    frame = grey((20, 10, count, 1, (200, 20, 20)))
    if is_enough:
        assert calibrate_red(frame).mask.sum() == count
        return
    with pytest.raises(CameraError) as caught:
        calibrate_red(frame)
    assert str(caught.value) == (
        "the red thing has only 10 px; bring it nearer to the camera, or name a point of the ball"
    )


@pytest.mark.parametrize(
    ("color", "is_red"),
    [
        # Saturation times value: 0.118 and 0.125.
        ((180, 150, 150), False),
        ((182, 150, 150), True),
    ],
)
def test_pale_colors_have_no_sure_hue(color: Color, is_red: bool) -> None:
    frame = grey((10, 10, 20, 10, color))
    if is_red:
        assert calibrate_red(frame).mask.sum() == 200
        return
    with pytest.raises(CameraError, match="^nothing is red in the frame; bring"):
        calibrate_red(frame)


def test_largest_of_the_vivid_objects_is_the_ball() -> None:
    red, paler = (200, 20, 20), (200, 80, 80)
    # The vivid ones have 60 and 80 px; the paler one has three quarters of their chroma at most.
    frame = grey((2, 2, 10, 6, red), (20, 2, 10, 8, red), (5, 20, 30, 15, paler))
    found = calibrate_red(frame)
    assert found.mask.sum() == 80 and found.middle == (24, 6)


def test_outline_is_two_pixels_wide_and_around_the_object() -> None:
    mask = np.zeros((40, 60), bool)
    mask[15:20, 20:30] = True
    frame = grey((20, 15, 10, 5, (200, 20, 20)))
    shown = picture(frame, FoundRed(RedWindow(), mask))
    green = (shown[:, :60] == (0, 255, 0)).all(-1)
    assert green[17, 18:20].all() and not green[17, 17] and not green[17, 20:30].any()
    assert green[13:15, 25].all() and not green[12, 25]
    assert (frame != shown[:, :60]).any(-1).sum() == green.sum(), "the rest is as it was"
    assert shown[0, 60].tolist() == [30, 30, 30], "a fifth"


def test_calibrations_are_files_of_their_cameras(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(color_calibration, "calibration_folder", lambda: tmp_path)
    names = [saved_path(device).name for device in (0, "rtsp://eye/1?a=b", "/dev/video_2-x")]
    assert names == ["camera-0.json", "camera-rtsp-eye-1-a-b.json", "camera--dev-video_2-x.json"]
    path = tmp_path / "red.json"
    write_red(path, RedWindow((-20.5, 5.0), 0.6, 0.5, 12))
    assert path.read_text(encoding="utf-8") == (
        '{\n  "red": {\n    "hue_deg": [\n      -20.5,\n      5.0\n    ],\n'
        '    "saturation": 0.6,\n    "value": 0.5,\n    "area_px": 12\n  }\n}\n'
    )
    assert read_red(path) == RedWindow((-20.5, 5.0), 0.6, 0.5, 12)
    values = {"hue_deg": [1, 2], "saturation": "0.5", "value": 1, "area_px": 3.0}
    path.write_text(json.dumps({"red": values}), encoding="utf-8")
    assert read_red(path) == RedWindow((1.0, 2.0), 0.5, 1.0, 3)


def test_joined_window_holds_all_of_them() -> None:
    windows = [RedWindow((-5, 9), 0.7, 0.3), RedWindow((-9, 5), 0.5, 0.6), RedWindow((0, 1), 0.9)]
    assert spanning(windows) == RedWindow((-9, 9), 0.5, 0.3)


@pytest.mark.parametrize(
    ("window", "colors"),
    [
        # Of each pair the first is just inside and the second one just outside.
        (RedWindow(value=0.5, saturation=0.1), ((128, 10, 10), (127, 10, 10))),
        (RedWindow(saturation=0.5, value=0.1), ((200, 100, 100), (200, 101, 101))),
        (RedWindow((-60.0, 30.0), 0.1, 0.1), ((200, 110, 20), (200, 111, 20))),
        (RedWindow((-30.0, 60.0), 0.1, 0.1), ((200, 20, 110), (200, 20, 111))),
    ],
)
def test_limits_of_a_window_are_within_it(window: RedWindow, colors: tuple[Color, Color]) -> None:
    found = [len(find_red(grey((5, 5, 5, 5, color)), window)) for color in colors]
    assert found == [1, 0]


def test_objects_are_where_their_boxes_have_their_middle() -> None:
    red = (200, 20, 20)
    frame = grey((0, 0, 5, 4, red), (50, 30, 10, 10, red))
    # What is left is a corner: a column and a row.
    frame[30:39, 50:59] = 150
    assert sorted(find_red(frame, RedWindow()).tolist()) == [[2.0, 1.5], [54.5, 34.5]]


# ---------------------------------------------------------------- cameras


@pytest.mark.parametrize(
    ("places", "shows"),
    [
        (((0, 0),), True),
        (((79, 59),), True),
        (((80, 0),), False),
        (((0, 60),), False),
        (((-1, 0),), False),
        (((0, -1),), False),
        (((1, 1), (80, 1)), False),
        ((), False),
    ],
)
def test_goals_are_within_the_frame(places: tuple[tuple[int, int], ...], shows: bool) -> None:
    def view() -> CameraView:
        return CameraView(width_px=80, height_px=60, image_px=60, goal=VisualGoal(places))

    if shows:
        assert view().farthest_px == 100.0
        return
    with pytest.raises(DescriptionError) as caught:
        view()
    says = "a goal needs places within the frame of 80 x 60 px; give some"
    assert str(caught.value) == says


class Capture:
    """A camera of OpenCV whose picture has this size."""

    def __init__(self, log: list[Any], size: tuple[int, int] | None) -> None:
        self.log = log
        self.size = size

    def set(self, what: int, value: float) -> None:
        self.log.append((what, value))

    def grab(self) -> None:
        self.log.append("grab")

    def read(self) -> tuple[bool, Any]:
        self.log.append("read")
        if self.size is None:
            return False, None
        width, height = self.size
        frame = np.zeros((height, width, 3), np.uint8)
        frame[..., 2] = 9  # OpenCV's red
        return True, frame

    def release(self) -> None:
        self.log.append("release")


@pytest.fixture
def opencv(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """OpenCV, whose cameras give pictures of ``size``."""
    log: list[Any] = []

    def set_level(level: int) -> int:
        log.append(f"level {level}")
        return 3

    cv2: Any = SimpleNamespace(
        log=log,
        size=(80, 60),
        CAP_PROP_FRAME_WIDTH="width",
        CAP_PROP_FRAME_HEIGHT="height",
        CAP_PROP_BUFFERSIZE="buffer",
    )
    cv2.utils = SimpleNamespace(
        logging=SimpleNamespace(LOG_LEVEL_SILENT=0, setLogLevel=set_level),
    )

    def opened(device: int | str) -> Capture:
        log.append(f"open {device}")
        return Capture(log, cv2.size)

    cv2.VideoCapture = opened
    monkeypatch.setitem(sys.modules, "cv2", cv2)
    return cv2


VIEW = CameraView(device=3, width_px=80, height_px=60, image_px=20)
OPENED = ["level 0", "open 3", "level 3", ("width", 80), ("height", 60), ("buffer", 1)]


def test_camera_is_opened_once_silently_and_shows_the_present(opencv: Any) -> None:
    camera = VideoCamera(VIEW)
    camera.close()
    assert opencv.log == []
    for _ in range(2):
        frame = camera.frame()
        assert frame.shape == (60, 80, 3) and frame.flags.c_contiguous
        assert frame[0, 0].tolist() == [9, 0, 0], "red comes first here"
    # What waits in the driver's buffer was taken before the robot moved.
    assert opencv.log == [*OPENED, "grab", "read", "grab", "read"]
    camera.close()
    camera.close()
    assert opencv.log[-2:] == ["read", "release"]
    camera.frame()
    assert opencv.log[-8:] == [*OPENED, "grab", "read"]


@pytest.mark.parametrize(
    ("size", "says"),
    [
        (
            None,
            (
                "camera 3 shows nothing; plug it in, allow this program to use it, end other "
                "programs that do, or name another"
            ),
        ),
        ((60, 80), "camera 3 gives 60 x 80 px, not 80 x 60; take one that can"),
        ((80, 61), "camera 3 gives 80 x 61 px, not 80 x 60; take one that can"),
        ((81, 60), "camera 3 gives 81 x 60 px, not 80 x 60; take one that can"),
    ],
)
def test_camera_that_does_not_fit_is_released(
    opencv: Any, size: tuple[int, int] | None, says: str
) -> None:
    opencv.size = size
    with pytest.raises(CameraError) as caught:
        VideoCamera(VIEW).frame()
    assert str(caught.value) == says
    assert opencv.log == [*OPENED, "grab", "read", "release"]


class Drawer:
    """A renderer of a robot, which notes how it was made."""

    def __init__(self, *about: Any, **named: Any) -> None:
        self.about = about
        self.named = named
        self.closed = 0
        self.drawn = 0

    def render(self) -> str:
        self.drawn += 1
        return f"picture {self.drawn}"

    def close(self) -> None:
        self.closed += 1


@pytest.mark.parametrize("has_opengl", [True, False])
def test_twin_is_drawn_by_opengl_or_else_by_rays(
    monkeypatch: pytest.MonkeyPatch, has_opengl: bool
) -> None:
    made: list[tuple[str, Drawer]] = []

    class Body:
        pass

    def opengl(*about: Any, **named: Any) -> Drawer:
        if not has_opengl:
            raise RenderingUnavailableError("no OpenGL; install some")
        made.append(("opengl", Drawer(*about, **named)))
        return made[-1][1]

    def rays(*about: Any, **named: Any) -> Drawer:
        made.append(("rays", Drawer(*about, **named)))
        return made[-1][1]

    monkeypatch.setattr("bricktwin.twin.mujoco_body.MujocoBody", Body)
    monkeypatch.setattr("bricktwin.twin.render.opengl.Renderer", opengl)
    monkeypatch.setattr("bricktwin.twin.render.raycast.RayCaster", rays)
    body: Any = Body()
    view = CameraView("side", width_px=80, height_px=60, image_px=20, spot_px=7)
    camera = TwinCamera(body, view)
    camera.close()
    assert [camera.frame() for _ in range(2)] == ["picture 1", "picture 2"]
    ((name, drawer),) = made
    if has_opengl:
        assert (name, drawer.about, drawer.named) == (
            "opengl",
            (body, 80, 60, "side"),
            {"smooth": False},
        )
    else:
        assert (name, drawer.about, drawer.named) == ("rays", (body, 80, 60, "side", 7), {})
    camera.close()
    camera.close()
    assert drawer.closed == 1
    assert camera.frame() == "picture 1" and len(made) == 2
    with pytest.raises(RenderingUnavailableError) as caught:
        TwinCamera(object(), view).frame()  # type: ignore[arg-type]
    says = "the virtual robot has no picture; give it a MuJoCo model or no camera"
    assert str(caught.value) == says


def test_watch_begins_with_nothing_seen_and_keeps_the_last_mean() -> None:
    view = CameraView(
        width_px=60,
        height_px=40,
        image_px=20,
        goal=VisualGoal(((30, 20),), radius_px=3, red=RedWindow(area_px=0)),
    )
    watch = Watch(view, np.random.default_rng(0), grey())
    farthest_px = float(np.hypot(60, 40))
    assert watch.goal == (30, 20) and watch.numbers() == (0.0, farthest_px)
    watch.see(grey((33, 24, 1, 1, (200, 20, 20)), (30, 30, 1, 1, (200, 20, 20))))
    assert watch.numbers() == (7.5, 5.0)
    watch.see(grey())
    assert watch.numbers() == (7.5, farthest_px)
    # The green disc stands at the goal of the small image.
    assert watch.image[10, 10].tolist() == [0, 255, 0]
