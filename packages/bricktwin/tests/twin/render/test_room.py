"""Room of videos: captions, metre labels, goal ghost."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from brickhub.errors import RenderingUnavailableError
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.render.opengl import Image, Renderer
from bricktwin.twin.render.video import Filmed, Room, captioned
from bricktwin.twin.scene import Goal, Scene

SIZE = (320, 180)


def drawn(robot, goal=None) -> tuple[Image, Room]:
    body = make_body(robot)
    room = Room(body, goal)
    try:
        with Renderer(body, *SIZE, room.camera, smooth=False, decorate=room.decorate) as renderer:
            return renderer.render(), room
    except RenderingUnavailableError as error:
        pytest.skip(str(error))


def test_captions_change_only_corner_and_labels() -> None:
    image = np.full((180, 320, 3), 90, np.uint8)
    told = captioned(image, "Walker-v1", "step 3", [(200, 150, "1 m")])
    assert told.shape == image.shape and told.dtype == np.uint8 and (image == 90).all()
    assert (told[5:20, 5:60] != 90).any() and (told[140:160, 185:215] != 90).any()
    assert (told[60:130] == 90).all() and (told[:60, 200:] == 90).all()
    assert (captioned(image, "", "") == image).all()


def test_camera_follows_with_metre_labels() -> None:
    _, room = drawn(WALKER)
    ((column, row, text),) = [mark for mark in room.metre_marks(*SIZE) if mark[2] == "0 m"]
    assert 0 < column < SIZE[0] and SIZE[1] / 2 < row < SIZE[1] and text == "0 m"
    room._body.data.qpos[0] += 1.0
    for _ in range(200):
        room.follow()
    assert abs(room.camera.lookat[0] - 1.0) < 0.01
    assert "1 m" in [text for _, _, text in room.metre_marks(*SIZE)]


def test_camera_keeps_a_fast_robot_in_its_picture() -> None:
    _, room = drawn(WALKER)
    room._body.data.qpos[0] += 3.0
    room.follow()
    assert abs(room.camera.lookat[0] - 3.0) < 0.2


def test_ghost_is_at_goal() -> None:
    plain, _ = drawn(ROBO_ARM)
    ghost, _ = drawn(ROBO_ARM, Goal({"rotation": 90.0, "low": 60.0, "high": -90.0, "grab": -100.0}))
    green = (ghost[..., 1].astype(int) - ghost[..., 0] > 40) & (
        plain[..., 1].astype(int) - plain[..., 0] < 20
    )
    assert green.sum() > 100
    assert (ghost[-20:] == plain[-20:]).all(), "the floor before it is as it was"


def test_camera_is_farther_away_where_a_goal_is_to_be_seen_too() -> None:
    body = make_body(WALKER)
    near, far = Room(body), Room(body, Goal(at_mm=(600.0, 200.0)))
    assert far.camera.distance > near.camera.distance
    assert near.camera.lookat[:2] == pytest.approx((0.0, 0.0), abs=0.01)
    # It looks at the middle between both.
    assert far.camera.lookat[:2] == pytest.approx((0.3, 0.1), abs=0.01)
    assert Room(make_body(ROBO_ARM)).camera.distance > near.camera.distance, "it reaches far"


def test_no_wall_ahead_hides_the_robot() -> None:
    body = make_body(TWO_WHEELER, scene=Scene(wall_distance_mm=(150.0, 150.0)))
    camera = Room(body).camera
    back = (
        camera.distance * np.cos(np.radians(camera.elevation)) * np.cos(np.radians(camera.azimuth))
    )
    assert camera.lookat[0] - back < 0.15


def room_of_a_ball(goal: Goal | None = None) -> Room:
    """The room of something that is a ball, without a drawing of it."""
    spec = mujoco.MjSpec()
    ball = spec.worldbody.add_body()
    ball.add_freejoint()
    ball.add_geom(size=[0.05, 0.0, 0.0])
    model = spec.compile()
    body: Any = SimpleNamespace(model=model, data=mujoco.MjData(model), robot=None, scene=None)
    made = Room(body)
    made._place = None if goal is None else goal.at_mm
    return made


def test_points_are_seen_where_a_camera_of_that_pose_sees_them() -> None:
    room = room_of_a_ball()
    camera, model = room.camera, room._body.model
    width, height = 640, 360
    room.camera.lookat[:] = (1.0, 2.0, 0.5)
    # What it looks at is in the middle.
    assert room._project(np.array([1.0, 2.0, 0.5]), width, height) == (320, 180)
    # The camera's axes, by MuJoCo.
    scene = mujoco.MjvScene(model, 100)
    data, option = room._body.data, mujoco.MjvOption()
    mujoco.mj_forward(model, data)
    mujoco.mjv_updateScene(
        model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene
    )
    one, other = scene.camera
    eye = (np.array(one.pos) + np.array(other.pos)) / 2
    forward, up = np.array(one.forward), np.array(one.up)
    right = np.cross(forward, up)
    focal = height / 2 / math.tan(math.radians(model.vis.global_.fovy) / 2)
    for x, y, depth in ((0.1, 0.05, 0.7), (-0.3, -0.1, 1.5), (0.0, 0.2, 0.3)):
        point = eye + depth * forward + x * right + y * up
        wanted = (320 + focal * x / depth, 180 - focal * y / depth)
        assert room._project(point, width, height) == pytest.approx(wanted, abs=0.6)
    assert room._project(eye - 0.1 * forward, width, height) is None
    assert room._project(eye + 0.04 * forward, width, height) is None


def boxes_of(room: Room, most: int = 100) -> list[tuple[list[float], list[float]]]:
    """Lowest and highest corner of each box of the decoration."""
    scene = mujoco.MjvScene(room._body.model, most)
    room.decorate(scene)
    return [
        (
            (np.array(geom.pos, float) - np.array(geom.size, float)).round(4).tolist(),
            (np.array(geom.pos, float) + np.array(geom.size, float)).round(4).tolist(),
        )
        for geom in scene.geoms[: scene.ngeom]
    ]


def test_a_room_has_a_wall_behind_the_robot_and_a_line_each_metre() -> None:
    room = room_of_a_ball()
    room._target[:] = (4.4, 0.0, 0.07)
    wall, board, *lines = boxes_of(room)
    # Whole metres around the camera, so that it seems to have no end.
    assert (wall[0], wall[1]) == ([-2.0, 1.3, 0.0], [10.0, 1.32, 1.6])
    assert board[0][2] == 0.0 and board[1][2] == pytest.approx(0.07)
    # The board stands before the wall, and both as far to the sides.
    assert board[1][1] == pytest.approx(1.3) and (board[0][0], board[1][0]) == (-2.0, 10.0)
    across, along = lines[:7], lines[7:]
    middles = [(low[0] + high[0]) / 2 for low, high in across]
    assert middles == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], abs=1e-3)
    assert {high[1] for _, high in across} == {1.3} and len(along) == 4
    assert [(low[1] + high[1]) / 2 for low, high in along] == pytest.approx([-2, -1, 0, 1])
    # Thin paint, as wide on both axes.
    widths = [high[0] - low[0] for low, high in across] + [high[1] - low[1] for low, high in along]
    assert widths == pytest.approx([0.006] * 11, abs=2e-4)
    assert max(high[2] for _, high in lines) < 0.0006
    # A scene that is full takes no more.
    assert len(boxes_of(room, 3)) == 3


def test_the_target_lags_behind_a_slow_robot_and_keeps_near_a_fast_one() -> None:
    room = room_of_a_ball()
    x = room._body.data.qpos
    x[0] = 0.1
    room.follow()
    assert room.camera.lookat[0] == pytest.approx(0.006)
    x[0] = 2.006
    room.follow()
    assert room.camera.lookat[0] == pytest.approx(2.006 - 0.12)
    assert room.camera.lookat[2] == pytest.approx(0.07)
    to_goal = room_of_a_ball(Goal(at_mm=(600.0, -200.0)))
    to_goal._body.data.qpos[:2] = 0.2, 0.4
    assert to_goal._robot() == pytest.approx((0.4, 0.1, 0.07))


def test_images_are_due_by_the_time_of_the_last_one() -> None:
    class Ticking:
        battery_mv = 8000
        time_ms = 0

        def advance_to(self, time_ms: int) -> None:
            self.time_ms = time_ms

    body, taken = Ticking(), []
    film = Filmed(body, lambda: body.time_ms, 40, 40, taken.append)  # type: ignore[arg-type]
    for time_ms in (10, 39, 45, 79, 80, 120, 205, 210, 215):
        film.advance_to(time_ms)
    # Who was late is not late for the next one.
    assert taken == [45, 80, 120, 205, 210]
    assert film.battery_mv == 8000
