"""Cameras: objects in frames, virtual and real cameras."""

from __future__ import annotations

import colorsys
import dataclasses
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tensordict import TensorDict
from torchrl.envs import check_env_specs

import bricksrl
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import Robot
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.envs.simulation import SimulatedEnv
from bricksrl.envs.task import Kinematics
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.vision.camera import (
    Camera,
    CameraView,
    TwinCamera,
    VideoCamera,
    VisualGoal,
    Watch,
)
from bricksrl.envs.vision.frames import Frame, RedWindow, distances_px, draw_disc, find_red, shrink
from bricksrl.errors import BricksError, CameraError, DescriptionError, RenderingUnavailableError
from bricktwin.robots import ROBO_ARM
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render import opengl
from bricktwin.twin.scene import Scene

RED = (220, 10, 10)
GOAL = VisualGoal(((30, 20),), radius_px=4)
VIEW = CameraView(width_px=80, height_px=60, image_px=20, goal=GOAL)


def frame_with(*things: tuple[slice, slice], colour: tuple[int, int, int] = RED) -> Frame:
    """A grey frame of 80 x 60 with coloured boxes."""
    frame = np.full((60, 80, 3), 180, np.uint8)
    for box in things:
        frame[box] = colour
    return frame


def box(x: int, y: int, width: int = 5, height: int = 5) -> tuple[slice, slice]:
    return slice(y, y + height), slice(x, x + width)


# ---------------------------------------------------------------- what is found in a frame


def test_red_objects_are_found_at_centre() -> None:
    assert find_red(frame_with(), RedWindow()).shape == (0, 2)
    found = find_red(frame_with(box(10, 40), box(60, 5, 9, 3)), RedWindow())
    assert sorted(found.tolist()) == [[12, 42], [64, 6]]


def test_small_components_are_ignored() -> None:
    assert len(find_red(frame_with(box(0, 0, 5, 2)), RedWindow())) == 0
    assert len(find_red(frame_with(box(0, 0, 11, 1)), RedWindow())) == 1
    assert len(find_red(frame_with(box(0, 0, 10, 1), box(0, 2, 10, 1)), RedWindow())) == 0
    touching_at_a_corner = frame_with(box(0, 0, 3, 3), box(3, 3, 3, 3))
    assert len(find_red(touching_at_a_corner, RedWindow())) == 1


@pytest.mark.parametrize("hue_deg", [-50, -20, -1, 0, 1, 10, 20])
def test_both_ends_of_hue_circle_are_red(hue_deg: int) -> None:
    red, green, blue = (
        round(255 * part) for part in colorsys.hsv_to_rgb(hue_deg % 360 / 360, 0.9, 0.8)
    )
    assert len(find_red(frame_with(box(3, 3), colour=(red, green, blue)), RedWindow())) == 1


@given(st.tuples(*[st.integers(0, 255)] * 3))
def test_red_mask_equals_hsv_formula(colour: tuple[int, int, int]) -> None:
    window = RedWindow()
    hue, saturation, value = colorsys.rgb_to_hsv(*(part / 255 for part in colour))
    hue_deg = (hue * 360 + 180) % 360 - 180
    limits = (
        hue_deg - window.hue_deg[0],
        window.hue_deg[1] - hue_deg,
        saturation - window.saturation,
        value - window.value,
    )
    if min(abs(limit) for limit in limits) < 1e-4:
        return  # on the edge, rounding decides
    assert len(find_red(frame_with(box(3, 3), colour=colour), window)) == (min(limits) > 0)


def test_windows_without_red_raise() -> None:
    for wrong in (
        {"hue_deg": (90.0, 120.0)},
        {"hue_deg": (10.0, 0.0)},
        {"saturation": 0.0},
        {"value": 1.5},
        {"area_px": -1},
    ):
        with pytest.raises(DescriptionError, match="red"):
            RedWindow(**wrong)  # type: ignore[arg-type]


def test_distances() -> None:
    assert distances_px(np.array([[3.0, 4.0], [0.0, 1.0]]), (0, 0)).tolist() == [5, 1]


def test_image_pixels_are_area_means() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    means = frame.reshape(20, 3, 20, 4, 3).mean((1, 3))
    # of integers, exact: ties are rounded to even
    assert np.array_equal(shrink(frame, 20), np.rint(means))
    assert np.array_equal(shrink(frame[:, :60], 60), frame[:, :60])


@given(st.integers(1, 60), st.integers(60, 90), st.integers(60, 90), st.integers(0, 255))
def test_uniform_frame_gives_uniform_image(side: int, height: int, width: int, grey: int) -> None:
    assert (shrink(np.full((height, width, 3), grey, np.uint8), side) == grey).all()


@given(st.integers(-30, 110), st.integers(-30, 90), st.integers(1, 25))
def test_disc_may_exceed_image(x: int, y: int, radius: int) -> None:
    frame, drawn = frame_with(), frame_with()
    draw_disc(drawn, (x, y), radius)
    rows, columns = np.mgrid[:60, :80]
    inside = np.hypot(rows - y, columns - x) <= radius
    assert np.array_equal((drawn != frame).any(-1), inside)
    assert (drawn[inside] == (0, 255, 0)).all()
    assert np.array_equal(shrink(frame, 12, ((x, y), radius)), shrink(drawn, 12))
    assert (frame == 180).all()


def test_invalid_views_raise() -> None:
    with pytest.raises(DescriptionError, match="spots of 0 px"):
        CameraView(spot_px=0)
    for wrong in (
        {"image_px": 61},
        {"image_px": 0},
        {"goal": VisualGoal(())},
        {"goal": VisualGoal(((80, 10),))},
    ):
        with pytest.raises(DescriptionError, match="80 x 60"):
            dataclasses.replace(VIEW, **wrong)


# ---------------------------------------------------------------- an episode before a camera


def test_camera_watch_measures_goal_distance() -> None:
    watch = Watch(VIEW, np.random.default_rng(0), frame_with(box(28, 18)))
    assert watch.goal == (30, 20)
    assert watch.numbers() == (0, 100)  # at the start nothing counts yet
    watch.see(frame_with())
    assert watch.numbers() == (0, 100)
    watch.see(frame_with(box(38, 18), box(28, 48)))
    assert watch.numbers() == (20, 10)
    watch.see(frame_with())
    assert watch.numbers() == (20, 100)


PARTS = st.lists(
    st.tuples(st.integers(-5, 79), st.integers(-5, 59), st.integers(1, 30), st.integers(1, 30)),
    max_size=3,
)


@given(st.integers(1, 60), PARTS, PARTS, st.integers(0, 2**32))
def test_camera_watch_equals_work_on_whole_frames(
    side: int, before: Any, after: Any, seed: int
) -> None:
    """Only what differs from the first frame is searched and shrunk again."""
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 150, (60, 80, 3), dtype=np.uint8)
    frame = first.copy()
    for canvas, parts in ((first, before), (frame, before), (frame, after)):
        for x, y, width, height in parts:
            canvas[box(max(x, 0), max(y, 0), width, height)] = (
                RED if width % 2 else rng.integers(0, 256, 3)
            )
    watch = Watch(dataclasses.replace(VIEW, image_px=side), rng, first)
    disc = (GOAL.places[0], GOAL.radius_px)
    assert np.array_equal(watch.image, shrink(first, side, disc))
    for seen in (frame, first, frame):
        watch.see(seen)
        assert np.array_equal(watch.image, shrink(seen, side, disc))
        found_px = distances_px(find_red(seen, GOAL.red), disc[0])
        assert watch.nearest_px == found_px.min(initial=100)
        assert watch.mean_px == (found_px.mean() if len(found_px) else watch.mean_px)


def test_goal_is_drawn_after_search() -> None:
    covered = frame_with(box(28, 18, 3, 4))
    watch = Watch(VIEW, np.random.default_rng(0), covered)
    watch.see(covered)
    assert watch.nearest_px < 2
    assert watch.image.shape == (20, 20, 3)
    assert watch.image[6, 7].tolist() == [0, 255, 0]
    assert (watch.image[12:] == 180).all()


def test_goals_are_drawn_around_their_places() -> None:
    goal = VisualGoal(((30, 20), (50, 40)), jitter_px=(2, 1))
    rng = np.random.default_rng(0)
    drawn = {goal.draw(rng) for _ in range(500)}
    assert drawn == {
        (x + dx, y + dy) for x, y in goal.places for dx in range(-2, 3) for dy in (-1, 0, 1)
    }


def test_camera_without_goal_has_image_only() -> None:
    view = dataclasses.replace(VIEW, goal=None)
    watch = Watch(view, np.random.default_rng(0), frame_with())
    watch.see(frame_with(box(0, 0)))
    assert watch.numbers() == ()
    assert watch.image[0, 0].tolist() == list(RED)


# ---------------------------------------------------------------- cameras


@pytest.fixture
def arm() -> MujocoBody:
    return MujocoBody(ROBO_ARM, Scene(ball=True), Physics(), 0)


@pytest.fixture
def webcam(arm: MujocoBody) -> Iterator[TwinCamera]:
    camera = TwinCamera(arm, CameraView())
    try:
        camera.frame()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    yield camera
    camera.close()


def test_ball_is_found_at_true_position(arm: MujocoBody, webcam: TwinCamera) -> None:
    camera, ball = arm.model.camera("webcam").id, arm.model.geom("ball").id
    # at first the gripper covers a part of the ball
    for port, time_ms in (("A", 200), ("B", 500), ("B", 800)):
        arm.set_voltage(port, 6000)
        arm.advance_to(time_ms)
        frame = webcam.frame()
        offset = arm.data.cam_xmat[camera].reshape(3, 3).T @ (
            arm.data.geom_xpos[ball] - arm.data.cam_xpos[camera]
        )
        focal_px = 240 / math.tan(math.radians(arm.model.cam_fovy[camera]) / 2)
        expected = (320 - focal_px * offset[0] / offset[2], 240 + focal_px * offset[1] / offset[2])
        assert find_red(frame, RedWindow()) == pytest.approx(np.array([expected]), abs=6)


def test_camera_works_without_opengl(arm: MujocoBody, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "Renderer", unavailable)
    arm.set_voltage("A", 6000)
    arm.advance_to(200)  # at first the gripper divides the ball
    coarse, fine = (TwinCamera(arm, CameraView(spot_px=spot_px)) for spot_px in (10, 4))
    assert coarse.frame().shape == fine.frame().shape == (480, 640, 3)
    squares = coarse.frame().reshape(48, 10, 64, 10, 3)
    assert (squares == squares[:, :1, :, :1]).all()
    assert not np.array_equal(coarse.frame(), fine.frame())
    for camera in (coarse, fine):
        camera.close()
        assert len(find_red(camera.frame(), RedWindow())) == 1


def unavailable(*_args: Any, **_kwargs: Any) -> None:
    raise RenderingUnavailableError("no OpenGL; install some")


def test_closed_camera_reopens(webcam: TwinCamera) -> None:
    first = webcam.frame()
    webcam.close()
    webcam.close()
    assert np.array_equal(webcam.frame(), first)


def test_robot_without_model_has_no_camera() -> None:
    bench = make_body(Robot("bench", ROBO_ARM.hub, ROBO_ARM.motors))
    with pytest.raises(RenderingUnavailableError, match="no picture"):
        TwinCamera(bench, CameraView()).frame()


def test_any_task_takes_a_camera() -> None:
    task = dataclasses.replace(
        SPINNING,
        id="SeenSpinning-v0",
        camera=CameraView("chase", width_px=96, height_px=72, image_px=32),
    )

    def connect(seed: int) -> Connection:
        twin = VirtualHub(make_body(task.robot, scene=task.scene, seed=seed))
        assert task.camera is not None
        camera = TwinCamera(twin.body, task.camera)
        return Connection(HubLink(twin, task.robot, task.interface), twin.reset, twin, camera)

    env = HubEnv(task, connect, seed=0)
    try:
        check_env_specs(env)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    steps = env.rollout(3)
    assert steps["image"].shape == (3, 32, 32, 3)
    assert (steps["next", "image"] != steps["image"]).any()
    assert torch.equal(
        env.task_observations(steps["next", "observation"]), steps["next", "observation"]
    )
    env.close()
    with pytest.raises(DescriptionError, match="simulated"):
        SimulatedEnv(task, Kinematics(noise=0.0))


class Film:
    """Frames in order; unplugged at the end."""

    def __init__(self, *frames: Frame) -> None:
        self.frames = list(frames)
        self.open = False

    def frame(self) -> Frame:
        if not self.frames:
            raise CameraError("the film is over")
        self.open = True
        return self.frames.pop(0)

    def close(self) -> None:
        self.open = False


def filmed(camera: Camera | None, **changes: Any) -> HubEnv:
    """Spinning in front of a camera."""
    task = dataclasses.replace(SPINNING, id="Filmed-v0", camera=VIEW, **changes)
    twin = VirtualHub(make_body(task.robot, scene=task.scene))
    link = HubLink(twin, task.robot, task.interface)
    return HubEnv(task, lambda _seed: Connection(link, twin.reset, twin, camera), seed=0)


def act() -> TensorDict:
    return TensorDict({"action": torch.zeros(2)})


def test_camera_findings_are_for_task_only() -> None:
    seen: list[torch.Tensor] = []

    def reward(
        previous: torch.Tensor, _action: torch.Tensor, observation: torch.Tensor
    ) -> torch.Tensor:
        seen.extend((previous, observation))
        return -observation[..., -2:-1]

    env = filmed(Film(frame_with(), frame_with(box(38, 18)), frame_with()), reward=reward)
    assert [entry.name for entry in env.task.task_entries[-2:]] == [
        "mean_distance",
        "nearest_distance",
    ]
    assert env.reset()["observation"].shape == (6,)
    steps = [env.step(act())["next"] for _ in range(2)]
    assert [step["reward"].item() for step in steps] == [-10, -10]
    assert [numbers[-2:].tolist() for numbers in seen] == [[0, 100], [10, 10], [10, 10], [10, 100]]
    assert steps[0]["observation"].shape == (6,)
    assert steps[0]["image"].dtype == torch.uint8
    judged = env.task_observations(torch.stack([step["observation"] for step in steps]))
    assert judged[:, 6:].tolist() == [[10, 10], [10, 100]]
    with pytest.raises(BricksError, match="before the next reset"):
        env.task_observations(torch.zeros(5, 6))


def test_failing_camera_stops_robot() -> None:
    film = Film(frame_with())
    env = filmed(film)
    env.reset()
    assert film.open
    after = env.step(act())["next"]
    assert bool(after["link_lost"]) and bool(after["truncated"])
    assert not film.open
    with pytest.raises(BricksError, match="reset"):
        env.step(act())
    film.frames = [frame_with(), frame_with()]
    env.reset()
    assert env.step(act())["next", "image"].shape == (20, 20, 3)
    env.close()
    assert not film.open


def test_missing_camera_raises() -> None:
    with pytest.raises(CameraError, match="needs a camera"):
        filmed(None).reset()


def test_missing_opencv_names_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(CameraError, match=r"bricksrl\[vision\]") as caught:
        VideoCamera(CameraView()).frame()
    assert "\n" not in str(caught.value)


def test_bluetooth_robot_with_webcam() -> None:
    env = bricksrl.make("RoboArm_mixed-v0", hub="ble", camera=3)
    camera = env._connected().camera
    assert isinstance(camera, VideoCamera)
    assert camera._view.device == 3


def test_opencv_reads_available_frames(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="the extra 'vision' is not installed")
    path = str(tmp_path / "film.avi")
    writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 10, (80, 60))
    for _ in range(4):
        writer.write(frame_with(box(20, 30, 16, 16))[..., ::-1].copy())
    writer.release()
    camera = VideoCamera(dataclasses.replace(VIEW, device=path))
    for _ in range(2):
        frame = camera.frame()
        assert frame.shape == (60, 80, 3)
        assert find_red(frame, RedWindow()) == pytest.approx(np.array([[27.5, 37.5]]), abs=2)
    with pytest.raises(CameraError, match="shows nothing"):
        camera.frame()
    with pytest.raises(CameraError, match="gives 80 x 60 px, not 640 x 480"):
        VideoCamera(CameraView(device=path)).frame()
