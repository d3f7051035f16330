"""Color calibration of cameras."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bricksrl
from bricksrl.envs import get_task
from bricksrl.envs.vision.camera import VideoCamera
from bricksrl.envs.vision.color_calibration import (
    FoundRed,
    calibrate_red,
    picture,
    read_red,
    saved_path,
    saved_red,
    spanning,
    write_red,
)
from bricksrl.envs.vision.frames import Frame, RedWindow, find_red
from bricksrl.errors import CameraError

ID = "RoboArm_mixed-v0"


def ball(
    hue_deg: float = 0.0,
    saturation: float = 0.9,
    value: float = 0.8,
    at: tuple[int, int] = (60, 40),
    noise: float = 6.0,
) -> Frame:
    """A frame of 120 x 80 with a shaded ball of 12 px on a grey table, with noise."""
    rows, columns = np.mgrid[:80, :120]
    distance = np.hypot(rows - at[1], columns - at[0])
    colour = np.array(colorsys.hsv_to_rgb(hue_deg % 360 / 360, saturation, value))
    shade = np.clip(1.15 - 0.6 * (distance / 12) ** 2, 0, 1)[..., None]
    frame = np.where(distance[..., None] <= 12, 255 * colour * shade, 150)
    return np.clip(frame + np.random.default_rng(0).normal(0, noise, frame.shape), 0, 255).astype(
        np.uint8
    )


@given(st.floats(-45, 45), st.floats(0.35, 1.0), st.floats(0.35, 1.0))
def test_calibrated_window_finds_ball_in_any_light(
    hue_deg: float, saturation: float, value: float
) -> None:
    frame = ball(hue_deg, saturation, value)
    found = calibrate_red(frame)
    assert found.window.hue_deg[0] < hue_deg < found.window.hue_deg[1]
    assert found.window.saturation < saturation
    assert found.window.value < value
    assert find_red(frame, found.window) == pytest.approx(np.array([[60, 40]]), abs=2)
    assert found.middle == pytest.approx((60, 40), abs=2)


def test_unusual_red_needs_calibration() -> None:
    for frame in (ball(hue_deg=40), ball(saturation=0.45), ball(value=0.32)):
        assert len(find_red(frame, RedWindow())) == 0
        assert len(find_red(frame, calibrate_red(frame).window)) == 1


def test_point_selects_object() -> None:
    frame = ball(hue_deg=-20, saturation=0.6, at=(30, 40))
    frame[:, 60:] = ball(hue_deg=15, saturation=0.9, at=(90, 40))[:, 60:]
    assert calibrate_red(frame).middle == pytest.approx((90, 40), abs=2)
    assert calibrate_red(frame, (30, 40)).middle == pytest.approx((30, 40), abs=2)
    assert find_red(frame, calibrate_red(frame, (30, 40)).window) == pytest.approx(
        np.array([[30, 40]]), abs=2
    )


@pytest.mark.parametrize("at", [(60, 40), (60, 31), (69, 41)])
def test_table_beside_the_point_does_not_count(at: tuple[int, int]) -> None:
    frame = ball(noise=0.0)
    frame[(frame == 150).all(-1)] = 255
    window, middle = calibrate_red(frame, at).window, calibrate_red(frame, (60, 40)).window
    assert window.hue_deg == middle.hue_deg
    assert (window.saturation, window.value) == pytest.approx(
        (middle.saturation, middle.value), abs=0.01
    )


def test_no_red_object_raises() -> None:
    grey = np.full((80, 120, 3), 150, np.uint8)
    for frame, at in (
        (grey, None),
        (ball(), (5, 5)),
        (ball(hue_deg=120), None),
        (ball(), (500, 5)),
    ):
        with pytest.raises(CameraError, match="nothing is red in the frame") as caught:
            calibrate_red(frame, at)
        assert "\n" not in str(caught.value)
    speck = grey.copy()
    speck[10:12, 10:13] = (220, 10, 10)
    with pytest.raises(CameraError, match="only 6 px"):
        calibrate_red(speck)


def test_calibration_picture_marks_object_and_mask() -> None:
    frame = ball(noise=0)
    shown = picture(frame, calibrate_red(frame))
    assert shown.shape == (80, 240, 3)
    assert ((shown[:, :120] == (0, 255, 0)).all(-1)).sum() > 60
    assert np.array_equal(shown[40, 120 + 60], frame[40, 60])
    assert (shown[5, 125] == 30).all()


def test_what_the_window_leaves_out_is_dimmed_and_its_limits_are_in_it() -> None:
    window = RedWindow((0.0, 30.0), 0.6, 0.4)
    # By hue, saturation and value: within, at each limit, and beyond each.
    kept = [(255, 60, 0), (255, 0, 0), (200, 100, 0), (255, 102, 102), (102, 0, 0)]
    left_out = [(255, 0, 30), (200, 120, 0), (255, 110, 110), (95, 0, 0), (0, 255, 0), (0, 0, 0)]
    frame = np.array([[*kept, *left_out]], np.uint8)
    mask = np.zeros(frame.shape[:2], bool)
    mask[0, 0] = True
    shown = picture(frame, FoundRed(window, mask))
    outlined, dimmed = shown[:, : len(mask[0])], shown[:, len(mask[0]) :]
    assert outlined[0, :4].tolist() == [[255, 60, 0], [0, 255, 0], [0, 255, 0], [255, 102, 102]]
    assert dimmed[0, :5].tolist() == [list(color) for color in kept]
    assert dimmed[0, 5:].tolist() == [[part // 5 for part in color] for color in left_out]


def test_windows_are_saved_and_joined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "bricksrl.envs.vision.color_calibration.calibration_folder", lambda: tmp_path / "deep"
    )
    one, other = RedWindow((-20, 5), 0.6, 0.5), RedWindow((-10, 15), 0.4, 0.7)
    assert spanning([one, other]) == RedWindow((-20, 15), 0.4, 0.5)
    path = saved_path("rtsp://eye/1")
    assert saved_red("rtsp://eye/1") is None
    write_red(path, one)
    assert saved_red("rtsp://eye/1") == read_red(path) == one


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"red": {"hue_deg": [0]}}',
        '{"red": {"hue_deg": [90, 99], "saturation": 1}}',
        None,
    ],
)
def test_foreign_calibration_file_raises(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "red.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(CameraError, match="bricksrl camera calibrate") as caught:
        read_red(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(CameraError, match=r"red\.json"):
        bricksrl.make(ID, calibration=path)


def test_task_uses_calibration(tmp_path: Path) -> None:
    path = tmp_path / "red.json"
    write_red(path, RedWindow((-60, -30), 0.9, 0.9))
    blind, seeing = bricksrl.make(ID, seed=0, calibration=str(path)), bricksrl.make(ID, seed=0)
    steps = [
        env.rollout(2, lambda td: td.set("action", td["observation"] * 0.0))
        for env in (blind, seeing)
    ]
    assert steps[0]["next", "reward"].abs().max() == 0
    assert steps[1]["next", "reward"].max() < 0
    blind.close()
    seeing.close()


def test_calibration_is_found_by_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "bricksrl.envs.vision.color_calibration.calibration_folder", lambda: tmp_path
    )
    write_red(saved_path(3), RedWindow((-5, 5), 0.3, 0.3))
    given_path = tmp_path / "given.json"
    write_red(given_path, RedWindow((-7, 7), 0.3, 0.3))

    def low(**options: object) -> float:
        camera = bricksrl.make(ID, hub="ble", **options)._connected().camera  # type: ignore[arg-type]
        assert isinstance(camera, VideoCamera)
        goal = bricksrl.make(ID, hub="ble", **options).task.camera.goal  # type: ignore[arg-type]
        assert goal is not None
        return goal.red.hue_deg[0]

    assert low(camera=3) == -5
    assert low(camera=2) == get_task(ID).camera.goal.red.hue_deg[0] == -60  # type: ignore[union-attr]
    assert low(camera=3, calibration=given_path) == -7
