"""Rotations in plain Python, against MuJoCo's own."""

from __future__ import annotations

import math
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from bricktwin.twin.engines.rotations import (
    Quaternion,
    Vector,
    about,
    from_vertical,
    matrix_of,
    principal_axes,
    product,
    rotated,
    rotated_back,
    turn_between,
    vector,
)


def drawn() -> Iterator[tuple[Vector, Quaternion, Quaternion]]:
    rng = np.random.default_rng(0)
    for _ in range(300):
        first, second = rng.standard_normal((2, 4))
        for quaternion in (first, second):
            mujoco.mju_normalize4(quaternion)
        yield vector(rng.standard_normal(3).tolist()), tuple(first.tolist()), tuple(second.tolist())


def of_mujoco(function: str, size: int, *args: object) -> tuple[float, ...]:
    result = np.empty(size)
    arrays = [np.array(arg) if isinstance(arg, tuple) else arg for arg in args]
    getattr(mujoco, function)(result, *arrays)
    return tuple(result.tolist())


def test_rotations_are_those_of_mujoco_to_the_last_bits() -> None:
    for of, first, second in drawn():
        near = {"rel": 1e-14, "abs": 1e-15}
        assert rotated(of, first) == pytest.approx(
            of_mujoco("mju_rotVecQuat", 3, of, first), **near
        )
        assert product(first, second) == pytest.approx(
            of_mujoco("mju_mulQuat", 4, first, second), **near
        )
        assert turn_between(first, second) == pytest.approx(
            of_mujoco("mju_subQuat", 3, first, second), **near
        )
        flat = [value for row in matrix_of(first) for value in row]
        assert flat == pytest.approx(of_mujoco("mju_quat2Mat", 9, first), **near)
        assert rotated_back(rotated(of, first), first) == pytest.approx(of)
        axis = vector(of[number] / np.linalg.norm(of) for number in range(3))
        assert about(axis, of[0]) == pytest.approx(
            of_mujoco("mju_axisAngle2Quat", 4, axis, of[0]), **near
        )


@pytest.mark.parametrize(
    "to", [(0.0, 0.0, 2.0), (0.0, 0.0, -2.0), (0.0, 0.0, 0.0), (0.3, -4.0, 0.2), (1e-20, 0.0, 3.0)]
)
def test_shortest_turn_from_the_vertical(to: Vector) -> None:
    found = from_vertical(to)
    assert found == pytest.approx(of_mujoco("mju_quatZ2Vec", 4, to))
    length = float(np.linalg.norm(to))
    if length:
        assert rotated((0.0, 0.0, length), found) == pytest.approx(to, abs=1e-12)


def test_no_turn_and_the_shorter_way() -> None:
    turned = about((0.0, 1.0, 0.0), 0.1)
    assert turn_between(turned, turned) == (0.0, 0.0, 0.0)
    opposite = (-turned[0], -turned[1], -turned[2], -turned[3])
    assert turn_between(opposite, (1.0, 0.0, 0.0, 0.0)) == pytest.approx((0.0, 0.1, 0.0))


def test_principal_axes_give_the_matrix_again() -> None:
    rng = np.random.default_rng(0)
    matrices = [np.diag([3.0, 3.0, 3.0]), np.diag([1.0, 2.0, 2.0]), np.zeros((3, 3))]
    for _ in range(100):
        square = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-6, 3)
        matrices.append(square @ square.T)
    for matrix in matrices:
        first, second, third = (vector(row) for row in matrix.tolist())
        moments, turn = principal_axes((first, second, third))
        axes = np.array(matrix_of(turn))
        size = np.abs(matrix).max()
        assert axes @ np.diag(moments) @ axes.T == pytest.approx(matrix, abs=1e-11 * size)
        assert np.linalg.norm(turn) == pytest.approx(1.0)


def test_axes_of_what_is_no_number_are_found_in_the_end() -> None:
    row = (math.nan, math.nan, math.nan)
    moments, _ = principal_axes((row, row, row))
    assert all(math.isnan(moment) for moment in moments)
