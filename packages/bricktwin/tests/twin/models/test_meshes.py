"""Meshes of drawn parts: closed surfaces seen from outside, with no more triangles than a camera
can tell apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bricktwin.plans import catalogue
from bricktwin.plans.drawing.meshes import surface_of
from bricktwin.plans.drawing.shapes import Shape, block, cylinder, ring, turned
from bricktwin.plans.geometry import circle_sides

SHAPES = {
    "block": (block(2.0, 3.0, 4.0), 24.0),
    "cylinder": (cylinder(5.0, 4.0), np.pi * 25 * 4),
    "cone": (turned([(0, 3), (5, -3), (0, -3)]), np.pi * 25 * 6 / 3),
    "ring": (ring(9.0, 6.0, 4.0), np.pi * (81 - 36) * 4),
}


def corners(shape: Shape) -> np.ndarray:
    return shape.points[shape.faces]


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_closed_and_face_outwards(name: str) -> None:
    shape, volume = SHAPES[name]
    a, b, c = np.moveaxis(corners(shape), 1, 0)
    areas = np.cross(b - a, c - a) / 2
    assert np.allclose(areas.sum(0), 0.0, atol=1e-9), "the areas of a closed surface cancel out"
    assert (a * areas).sum() / 3 == pytest.approx(volume, rel=0.06), (
        "positive, as they face outwards"
    )
    assert (np.einsum("ij,ij->i", areas, shape.normals[shape.faces].mean(1)) > 0).all()


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_shapes_are_turned_along_an_axis(axis: tuple[float, float, float]) -> None:
    # A cone, so that its two ends are told apart.
    cone = turned([(0, 3), (5, -3), (0, -3)]).along(axis)
    along = cone.points @ np.array(axis)
    across = np.linalg.norm(cone.points - np.outer(along, axis), axis=1)
    assert (along.min(), along.max()) == pytest.approx((-3.0, 3.0))
    assert across[np.isclose(along, 3.0)] == pytest.approx(0.0, abs=1e-9)
    assert across[np.isclose(along, -3.0)].max() == pytest.approx(5.0)


@given(st.floats(0.2, 200.0), st.floats(0.01, 1.0))
def test_polygon_is_nowhere_far_from_its_circle(radius: float, chord_error: float) -> None:
    sides = circle_sides(radius, chord_error)
    assert radius * (1 - np.cos(np.pi / sides)) <= chord_error * (1 + 1e-9)
    assert sides == 10 or radius * (1 - np.cos(np.pi / (sides - 1))) > chord_error * (1 - 1e-9)


def test_surfaces_have_no_triangles_without_area() -> None:
    for part in catalogue.parts():
        a, b, c = np.moveaxis(surface_of(part).triangles, 1, 0)
        assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min(initial=1.0) > 1e-6, part.number
