from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import TwinError
from bricktwin.twin.engines.conventions import FLOOR_GROUP, OBSTACLE_GROUP, SHAPE_GROUP
from bricktwin.twin.engines.engine import Touch
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.objects import Ball, Field, Wall
from bricktwin.twin.scene import Scene
from bricktwin.twin.stance import Feet, refuse_overlap, standing_pose

CORNERS = np.array([[0.06, 0.06], [0.06, -0.06], [-0.06, 0.06], [-0.06, -0.06]])
CENTRE = np.array([0.003, 0.001, 0.0])


def feet(heights: list[float]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.column_stack([CORNERS, heights])


def on_the_floor(
    heights: list[float], centre: np.ndarray = CENTRE
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feet and centre of mass in the world, and the rotation [3, 3]."""
    points = feet(heights)
    quaternion, height = standing_pose(points, centre)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    turn = matrix.reshape(3, 3)
    up = np.array([0.0, 0.0, height])
    return points @ turn.T + up, turn @ centre + up, turn


@given(st.lists(st.floats(-0.1, -0.08), min_size=4, max_size=4))
def test_three_feet_carry_robot(heights: list[float]) -> None:
    points, _, _ = on_the_floor(heights)
    assert points[:, 2].min() >= -1e-9
    assert (points[:, 2] < 1e-9).sum() >= 3


@given(st.lists(st.floats(-0.1, -0.08), min_size=4, max_size=4))
def test_stance_is_stable(heights: list[float]) -> None:
    points, centre, _ = on_the_floor(heights)
    touching = points[points[:, 2] < 1e-9][:, :2]
    # No line through the centre of mass has all feet that touch on one side.
    angles = np.arctan2(*(touching - centre[:2]).T[::-1])
    gaps = np.diff(np.sort(np.concatenate([angles, [angles.min() + 2 * np.pi]])))
    assert gaps.max() <= np.pi + 1e-6


@given(st.lists(st.floats(-0.1, -0.08), min_size=4, max_size=4))
def test_stance_keeps_heading(heights: list[float]) -> None:
    quaternion, _ = standing_pose(feet(heights), CENTRE)
    assert quaternion[3] == 0.0
    assert np.linalg.norm(quaternion) == 1.0 or abs(np.linalg.norm(quaternion) - 1.0) < 1e-12


def test_equal_feet_are_level() -> None:
    quaternion, height = standing_pose(feet([-0.09] * 4), CENTRE)
    np.testing.assert_allclose(quaternion, [1, 0, 0, 0], atol=1e-12)
    assert height == 0.09


def test_short_leg_is_off_floor() -> None:
    points, _, _ = on_the_floor([-0.09, -0.09, -0.09, -0.08], np.array([0.02, 0.02, 0.0]))
    assert points[3, 2] > 0.009


def test_of_two_stances_the_lower_is_taken() -> None:
    """With its centre near the diagonal the robot stands on the short leg, too, tilted and
    lower."""
    points, centre, _ = on_the_floor([-0.09, -0.09, -0.09, -0.08])
    assert points[3, 2] < 1e-9
    assert 0.089 < centre[2] < 0.09


def test_feet_touch_with_the_balls_at_their_ends_or_the_corners_of_their_boxes() -> None:
    spec = mujoco.MjSpec()
    leg = spec.worldbody.add_body(pos=[1.0, 0.0, 0.0], quat=[0.5**0.5, 0.0, 0.5**0.5, 0.0])
    geom = mujoco.mjtGeom
    leg.add_geom(type=geom.mjGEOM_SPHERE, size=[0.02, 0.0, 0.0], pos=[0.0, 0.1, 0.0])
    leg.add_geom(type=geom.mjGEOM_CAPSULE, size=[0.01, 0.03, 0.0])
    leg.add_geom(type=geom.mjGEOM_BOX, size=[0.01, 0.02, 0.03], pos=[0.0, 0.0, 0.1])
    engine = MujocoEngine(spec.compile())
    engine.forward()
    found = {
        (*(round(value, 6) + 0.0 for value in point), round(radius, 6))
        for point, radius in Feet(engine, [0, 1, 2]).points_m()
    }
    # The leg is turned: its z axis is x of the world, and its x axis is -z.
    corners = {
        (1.1 + x, y, z, 0.0) for x in (-0.03, 0.03) for y in (-0.02, 0.02) for z in (-0.01, 0.01)
    }
    balls = {(1.0, 0.1, 0.0, 0.02), (1.03, 0.0, 0.0, 0.01), (0.97, 0.0, 0.0, 0.01)}
    assert found == balls | {tuple(round(value, 6) for value in corner) for corner in corners}


@pytest.mark.parametrize(
    ("points", "height"),
    [
        ([[0.0, 0.0, -0.1], [0.1, 0.0, -0.2], [0.2, 0.0, -0.3]], 0.3),
        ([[0.0, 0.0, -0.1], [0.1, 0.0, -0.05]], 0.1),
    ],
)
def test_what_no_three_feet_carry_stays_upright_on_the_lowest(points: Any, height: float) -> None:
    assert standing_pose(points, (0.0, 0.0, 0.0)) == ((1.0, 0.0, 0.0, 0.0), height)


def test_of_very_many_points_the_highest_are_no_feet() -> None:
    above = [[0.01 * number, 0.02 * number**2, 0.1] for number in range(60)]
    quaternion, height = standing_pose(above + feet([-0.09] * 4).tolist(), CENTRE)
    assert quaternion == (1.0, 0.0, 0.0, 0.0) and height == pytest.approx(0.09)


GROUPS = {"floor": FLOOR_GROUP, "wall": OBSTACLE_GROUP, "object_0": OBSTACLE_GROUP}
GROUPS |= {"object_1": OBSTACLE_GROUP, "": OBSTACLE_GROUP, "leg": SHAPE_GROUP}
NAMES = list(GROUPS)


def touching(first: str, second: str, distance_m: float) -> Any:
    touch = Touch(NAMES.index(first), NAMES.index(second), distance_m)
    harmless = Touch(NAMES.index("leg"), NAMES.index("floor"), -0.5)
    return SimpleNamespace(
        touches=lambda: [harmless, touch],
        indices=lambda field: list(GROUPS.values()),
        names=lambda kind: NAMES,
    )


@pytest.mark.parametrize(
    ("first", "second", "distance_m", "is_refused"),
    [
        ("leg", "wall", -0.01, True),
        ("wall", "leg", -0.01, True),
        ("leg", "wall", -0.007, False),
        ("leg", "wall", 0.02, False),
        ("leg", "floor", -0.05, False),
        ("leg", "leg", -0.05, False),
        ("object_0", "object_1", -0.05, False),
        ("object_0", "floor", -0.05, False),
    ],
)
def test_only_a_robot_deep_in_an_obstacle_is_refused(
    first: str, second: str, distance_m: float, is_refused: bool
) -> None:
    engine = touching(first, second, distance_m)
    if is_refused:
        with pytest.raises(TwinError, match="a robot would start inside of wall; narrow the place"):
            refuse_overlap(engine)
    else:
        refuse_overlap(engine)


@pytest.mark.parametrize(
    ("obstacle", "scene", "words"),
    [
        # The user knows an object as it was written; what lies flat counts not.
        (
            "object_1",
            Scene(objects=(Ball((9.0, 0.0)), Field((0.0, 0.0), (5.0, 5.0)), Wall((1, 2), (3, 4)))),
            r"Wall\(from_mm=\(1, 2\).*; move that, or change start_mm or heading_deg",
        ),
        (
            "wall",
            Scene(wall_distance_mm=(100.0, 200.0)),
            "wall; move that, or change wall_distance_mm or heading_deg",
        ),
        ("", None, "an obstacle; narrow the place of the robot"),
    ],
)
def test_an_obstacle_at_the_start_is_named_with_what_helps(
    obstacle: str, scene: Scene | None, words: str
) -> None:
    with pytest.raises(TwinError, match=f"^a robot would start inside of {words}"):
        refuse_overlap(touching("leg", obstacle, -0.02), scene)
