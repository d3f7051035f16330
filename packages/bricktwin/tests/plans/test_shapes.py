"""Meshes of primitives: closed, seen from outside, of the size and the volume that is said."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from bricktwin.plans.drawing import shapes
from bricktwin.plans.drawing.shapes import Shape
from bricktwin.plans.geometry import Floats

SQUARE = np.array([(-6.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-6.0, 4.0)])


def volume(shape: Shape) -> float:
    """By the divergence theorem; positive if faces are counter-clockwise seen from outside."""
    a, b, c = (shape.points[shape.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def across(shape: Shape) -> Floats:
    """Normals of the faces, as long as twice their area."""
    a, b, c = (shape.points[shape.faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


CLOSED = {
    # Shape, size along x, y and z, and its volume.
    "rounded box": (shapes.box(12.0, 8.0, 6.0), (12.0, 8.0, 6.0), 12 * 8 * 6 - 8.0),
    "sharp box": (shapes.block(12.0, 8.0, 6.0), (12.0, 8.0, 6.0), 12 * 8 * 6),
    "rod": (shapes.cylinder(5.0, 30.0), (10.0, 10.0, 30.0), math.pi * 25 * 30),
    "bevelled rod": (
        shapes.cylinder(5.0, 30.0, 1.0),
        (10.0, 10.0, 30.0),
        # Each bevel is a cone's frustum of height 1 from radius 5 to 4.
        math.pi * (25 * 28 + 2 * (25 + 20 + 16) / 3),
    ),
    "ring": (
        shapes.ring(5.0, 3.0, 8.0),
        (10.0, 10.0, 8.0),
        math.pi * (25 * 6.8 + 2 * 0.6 * (25 + 22 + 4.4**2) / 3 - 9 * 8),
    ),
    "thin ring": (
        shapes.ring(5.0, 3.0, 1.0),
        (10.0, 10.0, 1.0),
        math.pi * (25 * 0.5 + 2 * 0.25 * (25 + 5 * 4.75 + 4.75**2) / 3 - 9),
    ),
    "cone": (
        shapes.turned([(0.0, 9.0), (4.0, 0.0), (0.0, 0.0)]),
        (8.0, 8.0, 9.0),
        math.pi * 16 * 9 / 3,
    ),
    "extruded": (
        shapes.extruded(SQUARE, 5.0, 1e-6),
        (12.0, 8.0, 5.0),
        12 * 8 * 5,
    ),
}


@pytest.mark.parametrize("name", CLOSED)
def test_a_shape_is_closed_and_of_its_size_and_volume(name: str) -> None:
    shape, size, expected = CLOSED[name]
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    assert high - low == pytest.approx(size, rel=0.05)
    # About the origin, but for the cone, which stands on it.
    middle = 9.0 if name == "cone" else 0.0
    assert high + low == pytest.approx([0.0, 0.0, middle], abs=0.3)
    assert volume(shape) == pytest.approx(expected, rel=0.04)
    # Each edge has a face on both sides, which go along it in opposite directions.
    places = [tuple(point) for point in shape.points.round(5)]
    edges = Counter(
        (places[face[corner - 1]], places[face[corner]])
        for face in shape.faces
        for corner in range(3)
        if places[face[corner - 1]] != places[face[corner]]
    )
    assert {edge: edges[edge[::-1]] for edge in edges} == dict(edges)


@pytest.mark.parametrize("name", CLOSED)
def test_normals_point_out_of_a_shape_as_its_faces_do(name: str) -> None:
    shape, _, _ = CLOSED[name]
    assert np.linalg.norm(shape.normals, axis=1) == pytest.approx(1.0)
    faces = across(shape)
    area = np.linalg.norm(faces, axis=1)
    for corner in range(3):
        cosine = np.einsum("ij,ij->i", faces, shape.normals[shape.faces[:, corner]])
        # But for rounding, to the side where a face of a rounded edge looks.
        assert (cosine[area > 1e-6] > 0.5 * area[area > 1e-6]).all()


def test_a_box_is_rounded_by_its_radius() -> None:
    shape = shapes.box(20.0, 20.0, 20.0, radius=2.0, arc=4)
    corner = np.full(3, 8.0)
    beyond = shape.points[(shape.points > 8.0 + 1e-9).all(axis=1)]
    assert len(beyond) and np.linalg.norm(beyond - corner, axis=1) == pytest.approx(2.0)


def test_a_circle_is_as_round_as_a_camera_sees() -> None:
    shape = shapes.cylinder(10.0, 4.0)
    a, b = (shape.points[shape.faces[:, corner]] for corner in (0, 1))
    rim = np.isclose(np.linalg.norm(a[:, :2], axis=1), 10.0)
    rim &= np.isclose(np.linalg.norm(b[:, :2], axis=1), 10.0) & ~np.isclose(a, b).all(axis=1)
    middles = np.linalg.norm((a + b)[rim, :2] / 2, axis=1)
    assert 9.88 <= middles.min() < 10.0 - 0.03


def test_discs_close_both_ends_and_nothing_between() -> None:
    shape = shapes.discs(3.0, 10.0, 12)
    assert set(shape.points[:, 2]) == {5.0, -5.0} and len(shape.faces) == 2 * 10
    area = np.linalg.norm(across(shape), axis=1).sum() / 2
    assert area == pytest.approx(2 * 12 * 9 * math.sin(2 * math.pi / 12) / 2)
    outwards = np.sign(shape.points[shape.faces[:, 0], 2])
    assert (across(shape)[:, 2] * outwards > 0).all()
    assert (shape.normals[:, 2] == np.sign(shape.points[:, 2])).all()


def test_an_extruded_outline_is_bevelled_at_both_edges() -> None:
    shape = shapes.extruded(SQUARE, 5.0, 0.5)
    heights = {float(z) for z in shape.points[:, 2]}
    assert heights == {2.5, 2.0, -2.0, -2.5}
    # Moved inwards along the bisector of a corner.
    top = shape.points[shape.points[:, 2] == 2.5]
    distances = np.abs(top[:, None, :2] - SQUARE[None]).sum(axis=2).min(axis=1)
    assert distances == pytest.approx(0.5 * (0.8320503 + 0.5547002), abs=1e-6)
    assert (np.abs(top[:, 0]) < 6.0).all() and (np.abs(top[:, 1]) < 4.0).all()


def test_a_rounded_rectangle_goes_round_counter_clockwise_within_its_sides() -> None:
    outline = shapes.rounded_rectangle(20.0, 10.0, 3.0)
    assert outline.max(axis=0).tolist() == [10.0, 5.0]
    assert outline.min(axis=0) == pytest.approx([-10.0, -5.0])
    following = np.roll(outline, -1, axis=0)
    area = (outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum() / 2
    assert area == pytest.approx(20 * 10 - (4 - math.pi) * 9, rel=0.01)
    first = outline[(outline > [7.0, 2.0]).all(axis=1)]
    assert np.linalg.norm(first - [7.0, 2.0], axis=1) == pytest.approx(3.0)


def test_a_tube_follows_its_curve_at_its_radius() -> None:
    """A curve of four control points: their cubic, by de Casteljau's steps."""
    control = [(0.0, 0.0, 0.0), (0.0, 0.0, 30.0), (20.0, 10.0, 30.0), (40.0, 10.0, 0.0)]
    shape = shapes.tube(control, 2.0, steps=11, segments=8)
    rings = shape.points.reshape(11, 8, 3)
    for step, ring in enumerate(rings):
        points = np.array(control)
        while len(points) > 1:
            points = points[:-1] + (points[1:] - points[:-1]) * step / 10
        assert ring.mean(axis=0) == pytest.approx(points[0])
        assert np.linalg.norm(ring - points[0], axis=1) == pytest.approx(2.0)
    # Its ends are square to the curve, and no ring is twisted against the next one.
    assert rings[0][:, 2] == pytest.approx(0.0, abs=1.5)
    twist = np.einsum("ij,ij->i", shape.normals[:-8], shape.normals[8:])
    assert twist.min() > 0.8
    outwards = np.einsum("ij,ij->i", across(shape), shape.normals[shape.faces[:, 0]])
    assert (outwards > 0).all() and np.linalg.norm(shape.normals, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_shape_is_laid_along_an_axis_and_moved(axis: tuple[float, float, float]) -> None:
    cone = shapes.turned([(0.0, 9.0), (4.0, 0.0), (0.0, 0.0)])
    laid = cone.along(axis).at(1.0, 2.0, 3.0)
    tip = laid.points - np.array([1.0, 2.0, 3.0])
    assert tip[(tip @ axis).argmax()] == pytest.approx(9.0 * np.array(axis), abs=1e-9)
    assert volume(laid) == pytest.approx(volume(cone))
    assert cone.turned((1.0, 0.0, 0.0), 90.0).points[0] == pytest.approx([0.0, -9.0, 0.0], abs=1e-9)


def test_merged_shapes_are_both_of_them() -> None:
    one, other = shapes.block(2.0, 2.0, 2.0), shapes.block(4.0, 4.0, 4.0).at(9.0, 0.0, 0.0)
    both = shapes.merge([one, other, one])
    assert volume(both) == pytest.approx(8.0 + 64.0 + 8.0)
    assert len(both.points) == len(both.normals) == 72 and both.faces.max() == 71


def test_triangles_are_smooth_where_they_meet_at_small_angles() -> None:
    def ridge(angle_deg: float, length: float) -> Shape | None:
        """Two triangles that meet at an edge, the other one of this length across it."""
        angle = math.radians(angle_deg)
        start, end = [0.0, 0.0, 0.0], [0.0, 10.0, 0.0]
        folded = [-length * math.cos(angle), 0.0, -length * math.sin(angle)]
        return shapes.shape_of(
            np.array([[start, [10.0, 0.0, 0.0], end], [start, end, folded], [start, end, end]])
        )

    smooth, sharp = ridge(40.0, 20.0), ridge(100.0, 10.0)
    assert smooth is not None and sharp is not None
    # The one without an area is left out.
    assert len(smooth.faces) == len(sharp.faces) == 2
    for shape, is_smooth in ((smooth, True), (sharp, False)):
        faces = across(shape) / np.linalg.norm(across(shape), axis=1)[:, None]
        for face, normal in zip(shape.faces, faces, strict=True):
            on_edge = np.isclose(shape.points[face][:, [0, 2]], 0.0).all(axis=1)
            own = shape.normals[face]
            assert own[~on_edge] == pytest.approx(np.tile(normal, (1, 1)))
            assert np.allclose(own[on_edge], normal) is not is_smooth
    # The larger one counts twice.
    mean = across(smooth)[0] + across(smooth)[1]
    assert smooth.normals[0] == pytest.approx(mean / np.linalg.norm(mean))
    assert shapes.shape_of(np.zeros((2, 3, 3))) is None
