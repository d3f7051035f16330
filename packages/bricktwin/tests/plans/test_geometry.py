"""Solids and directions against formulas of their own."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bricktwin.plans.geometry import (
    AXES,
    Floats,
    Solid,
    ball,
    bar,
    box,
    circle_sides,
    cylinder,
    frame_of,
    lines_coincide,
    ring,
    rotation,
)

angles = st.floats(-7.0, 7.0)
numbers = st.floats(-1.0, 1.0)
directions = (
    st.tuples(numbers, numbers, numbers)
    .filter(lambda values: math.hypot(*values) > 0.1)
    .map(lambda values: np.array(values) / math.hypot(*values))
)


@settings(max_examples=25)
@given(directions, directions, angles)
def test_a_rotation_turns_as_a_quaternion_does(axis: Floats, vector: Floats, angle: float) -> None:
    # q v q* with q = (cos a/2, sin a/2 axis), written out.
    scalar, imaginary = math.cos(angle / 2), math.sin(angle / 2) * axis
    twice = 2.0 * np.cross(imaginary, vector)
    turned = vector + scalar * twice + np.cross(imaginary, twice)
    assert rotation(axis, angle) @ vector == pytest.approx(turned, abs=1e-9)


@settings(max_examples=25)
@given(directions)
def test_a_frame_is_right_handed_along_its_axis(axis: Floats) -> None:
    frame = np.array(frame_of(tuple(3.0 * axis)))
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-9)
    assert frame[2] == pytest.approx(axis)
    assert np.cross(frame[0], frame[1]) == pytest.approx(frame[2])


@settings(max_examples=25)
@given(st.floats(0.05, 500.0), st.floats(0.01, 5.0))
def test_a_polygon_has_as_many_sides_as_its_error_takes_and_no_more(
    radius: float, error: float
) -> None:
    sides = circle_sides(radius, error)

    def gap(count: int) -> float:
        return radius * (1.0 - math.cos(math.pi / count))

    assert gap(sides) <= error * (1 + 1e-9)
    assert sides == 10 or gap(sides - 1) > error * (1 - 1e-9)


@pytest.mark.parametrize(
    ("shift", "angle", "coincide"),
    [
        ((0.0, 0.0, 40.0), 0.0, True),
        ((0.9, 0.0, -70.0), 0.0, True),
        ((1.1, 0.0, 0.0), 0.0, False),
        ((0.8, -0.8, 0.0), 0.0, False),
        ((0.0, 0.0, 0.0), 0.09, True),
        ((0.0, 0.0, 0.0), 0.11, False),
        ((0.0, 0.0, 0.0), math.pi - 0.09, True),
        ((0.0, 0.0, 0.0), math.pi / 2, False),
    ],
)
def test_lines_coincide_up_to_their_limits(
    shift: tuple[float, float, float], angle: float, coincide: bool
) -> None:
    point, axis = np.array([3.0, 4.0, 5.0]), np.array([0.0, 0.0, 1.0])
    other_axis = rotation(AXES["x"], angle) @ axis
    other = point + np.array(shift)
    for lines in ((point, axis, other, other_axis), (point, axis, other, -other_axis)):
        assert lines_coincide(*lines, offset=1.0, sine=math.sin(0.1)) is coincide


AT = (10.0, -20.0, 30.0)
TILTED = (0.0, 3.0, 4.0)
SOLIDS = [
    (box(AT, (4.0, 6.0, 8.0)), 4.0 * 6.0 * 8.0),
    (cylinder(AT, TILTED, 10.0, 3.0), math.pi * 9.0 * 10.0),
    (ring(AT, TILTED, 10.0, 4.0, 2.0), math.pi * (16.0 - 4.0) * 10.0),
    (ball(AT, 3.0), 4 / 3 * math.pi * 27.0),
    (bar((0.0, 0.0, 0.0), (0.0, 6.0, 8.0), (1.0, 0.0, 0.0), 4.0, 2.0), 10.0 * 4.0 * 2.0),
]


@pytest.mark.parametrize(("solid", "volume"), SOLIDS)
def test_a_solid_contains_its_volume_and_lies_in_its_corners(solid: Solid, volume: float) -> None:
    """Counted in points that are drawn in a box around it."""
    corners = solid.corners()
    assert len({tuple(corner) for corner in corners.round(6)}) == 8
    low, high = corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0
    points = np.random.default_rng(1).uniform(low, high, (20_000, 3))
    inside = solid.contains(points, 0.0)
    assert inside.mean() * np.prod(high - low) == pytest.approx(volume, rel=0.06)
    # Within the box along its own axes, and up to all of its faces.
    local = (points[inside] - np.array(solid.centre)) @ solid.frame.T
    reach = np.abs((corners - np.array(solid.centre)) @ solid.frame.T).max(axis=0)
    assert (np.abs(local).max(axis=0) < reach).all()
    assert (np.abs(local).max(axis=0) > 0.9 * reach).all()
    assert solid.offset == pytest.approx(solid.frame @ np.array(solid.centre))
    # What is deeper is a part of it, and at some depth nothing is left.
    deeper = solid.contains(points, 0.5)
    assert deeper.any() and not (deeper & ~inside).any() and deeper.sum() < inside.sum()
    assert not solid.contains(points, 5.0).any()


@pytest.mark.parametrize(("solid", "volume"), SOLIDS)
@pytest.mark.parametrize("depth", [0.0, 0.5])
def test_samples_fill_a_solid_up_to_their_depth(solid: Solid, volume: float, depth: float) -> None:
    samples = solid.samples(0.7, depth)
    assert solid.contains(samples, depth - 1e-6).all()
    # Any point of it has a sample near it.
    corners = solid.corners()
    points = np.random.default_rng(2).uniform(corners.min(axis=0), corners.max(axis=0), (2_000, 3))
    points = points[solid.contains(points, depth)][:200]
    nearest = np.linalg.norm(points[:, None] - samples[None], axis=2).min(axis=1)
    assert nearest.max() < 0.7
    # And they reach the limit on all sides, but there are not more than they have to be.
    assert not solid.contains(samples, depth + 1e-3).all()
    assert len(samples) < 5.0 * volume / 0.7**3


def test_what_is_too_thin_has_no_samples_inside_of_its_wall() -> None:
    assert len(ring(AT, TILTED, 10.0, 4.0, 3.2).samples(1.0, 0.5)) == 0
    # A plate has one layer.
    heights = box((0.0, 0.0, 0.0), (10.0, 0.4, 10.0)).samples(1.0, 0.0)[:, 1]
    assert set(heights) == {0.0}


@pytest.mark.parametrize("axis", range(3))
def test_a_box_is_as_large_as_said_on_each_axis(axis: int) -> None:
    solid = box((1.0, 2.0, 3.0), (4.0, 6.0, 8.0))
    half = (2.0, 3.0, 4.0)[axis]
    for side, margin in itertools.product((-1.0, 1.0), (0.0, 0.25)):
        point = np.array([[1.0, 2.0, 3.0]])
        point[0, axis] += side * (half - margin - 0.01)
        assert solid.contains(point, margin).all()
        point[0, axis] += side * 0.02
        assert not solid.contains(point, margin).any()


def test_a_bar_lies_between_its_ends_with_its_thickness_along_the_normal() -> None:
    solid = bar((1.0, 2.0, 3.0), (1.0, 8.0, 11.0), (1.0, 0.0, 0.0), 4.0, 2.0)
    assert solid.centre == (1.0, 5.0, 7.0) and solid.half == (5.0, 2.0, 1.0)
    along, across, normal = np.array(solid.axes)
    assert along == pytest.approx([0.0, 0.6, 0.8]) and normal.tolist() == [1.0, 0.0, 0.0]
    assert across == pytest.approx(np.cross(normal, along))
