from __future__ import annotations

import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bricktwin.twin.stance import standing_pose

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
