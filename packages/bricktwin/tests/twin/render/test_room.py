"""Room of videos: captions, metre labels, goal ghost."""

from __future__ import annotations

import numpy as np
import pytest

from brickhub.errors import RenderingUnavailableError
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.render.opengl import Image, Renderer
from bricktwin.twin.render.video import Room, captioned
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
