"""Rays through solids, against points along them; and the light on what they meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bricktwin.plans.booklet import sprite
from bricktwin.plans.booklet.picture import View
from bricktwin.plans.booklet.rays import Box, around, cuts_in, first_material, grid, pixel_boxes
from bricktwin.plans.drawing.looks import Tint
from bricktwin.plans.geometry import Floats, Solid, ball, bar, box, cylinder, ring

TILTED = (1.0, 2.0, 2.0)
SOLIDS = {
    "box": box((3.0, -2.0, 1.0), (12.0, 8.0, 6.0)),
    "bar": bar((0.0, 0.0, 0.0), (6.0, 8.0, 0.0), (0.0, 0.0, 1.0), 4.0, 2.0),
    "ball": ball((3.0, -2.0, 1.0), 5.0),
    "cylinder": cylinder((3.0, -2.0, 1.0), TILTED, 12.0, 4.0),
    "upright cylinder": cylinder((3.0, -2.0, 1.0), (0.0, 1.0, 0.0), 12.0, 4.0),
    "ring": ring((3.0, -2.0, 1.0), TILTED, 6.0, 5.0, 3.0),
}
VIEWS = {
    "aslant": View(40.0, 30.0).axes,
    # Along the axes of some solids, to which the rays are parallel.
    "from the front": View(0.0, 0.0).axes,
    "from above": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
DEPTHS = np.linspace(-20.0, 20.0, 401)


def along_rays(whole: Box, axes: Floats, zoom: float) -> Floats:
    """Points [h, w, depths, 3] in the part's frame."""
    x = (np.arange(whole.left, whole.right) + 0.5) / zoom
    y = (np.arange(whole.top, whole.bottom) + 0.5) / zoom
    right, down, away = axes
    flat = x[None, :, None] * right + y[:, None, None] * down
    return flat[:, :, None] + DEPTHS[:, None] * away


def is_in(solid: Solid, points: Floats) -> Floats:
    return solid.contains(points.reshape(-1, 3), 0.0).reshape(points.shape[:-1])


def is_near_surface(solid: Solid, points: Floats) -> Floats:
    """Where rounding may decide."""
    inner = solid.contains(points.reshape(-1, 3), 0.02).reshape(points.shape[:-1])
    outer = solid.contains(points.reshape(-1, 3), -0.02).reshape(points.shape[:-1])
    return outer & ~inner


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("name", SOLIDS)
def test_a_ray_is_in_a_solid_from_where_it_enters_to_where_it_leaves(name: str, view: str) -> None:
    solid, axes = SOLIDS[name], VIEWS[view]
    (whole,) = pixel_boxes([solid], axes, 0.7)
    # A point more on each side: rays there are beside it.
    whole = Box(whole.left - 1, whole.top - 1, whole.right + 1, whole.bottom + 1)
    points = along_rays(whole, axes, 0.7)
    with np.errstate(invalid="ignore"):
        spans = grid(whole, axes, 0.7).spans(solid)
        inside = np.zeros(points.shape[:-1], dtype=bool)
        for span in spans:
            enter, leave = span.enter[..., None], span.leave[..., None]
            inside |= (enter < DEPTHS) & (leave > DEPTHS)
    wrong = (inside != is_in(solid, points)) & ~is_near_surface(solid, points)
    assert not wrong.any()
    assert inside.any() and not inside[[0, -1]].any() and not inside[:, [0, -1]].any()


def test_material_begins_behind_all_cuts() -> None:
    block = box((0.0, 0.0, 0.0), (16.0, 16.0, 16.0))
    cuts = [
        cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 40.0, 3.0),
        # A recess that overlaps the bore, one behind it, and one that no ray meets.
        cylinder((0.0, 0.0, 8.0), (0.0, 0.0, 1.0), 6.0, 5.0),
        ball((2.0, 0.0, 4.0), 3.0),
        ball((90.0, 0.0, 0.0), 3.0),
    ]
    axes = View(12.0, 9.0).axes
    (whole,) = pixel_boxes([block], axes, 1.0)
    with np.errstate(invalid="ignore"):
        found = cuts_in(cuts, whole, axes, 1.0)
        (span,) = grid(whole, axes, 1.0).spans(block)
        at, cut_by = first_material(span, found)
    assert {id(cut.solid) for cut in found} == {id(cut) for cut in cuts[:3]}
    points = along_rays(whole, axes, 1.0)
    material = is_in(block, points)
    for cut in cuts:
        material &= ~is_in(cut, points)
    first = np.where(material.any(axis=2), DEPTHS[material.argmax(axis=2)], np.nan)
    near = ~(np.isnan(first) | np.isnan(at))
    # A step of a tenth; at some edges a ray just misses what a sample hits.
    assert np.isnan(first) == pytest.approx(np.isnan(at), abs=0.0) or (
        (np.isnan(first) != np.isnan(at)).mean() < 0.02
    )
    assert (np.abs(first - at)[near] < 0.15).mean() > 0.98
    # What is seen is the surface of the block, or of the cut that a ray comes out of.
    assert (cut_by[np.isclose(at, span.enter)] == -1).all()
    for number in (0, 1, 2):
        here = (cut_by == number) & ~np.isnan(at)
        assert here.any()
        rows, columns = np.nonzero(here)
        x, y = (columns + whole.left + 0.5), (rows + whole.top + 0.5)
        ends = x[:, None] * axes[0] + y[:, None] * axes[1] + at[here][:, None] * axes[2]
        assert is_near_surface(found[number].solid, ends).mean() > 0.98


def test_boxes_of_points_share_what_both_have() -> None:
    one, other = Box(0, 0, 10, 6), Box(4, -3, 12, 2)
    assert one.shared_with(other) == other.shared_with(one) == Box(4, 0, 10, 2)
    assert one.shared_with(Box(10, 0, 12, 6)) is None
    assert one.shared_with(Box(0, 6, 10, 9)) is None
    assert around([one, other]) == Box(0, -3, 12, 6)
    assert other.window(3, -5) == (slice(2, 7), slice(1, 9))
    # A solid has at least one point, however small.
    (tiny,) = pixel_boxes([box((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))], np.eye(3), 2.0)
    assert (tiny.right - tiny.left, tiny.bottom - tiny.top) == (1, 1)


def drawn(solid: Solid, *, is_cut: bool = False) -> tuple[sprite.Sprite, Floats]:
    """A sprite of a solid alone, and the depths of its points."""
    axes = VIEWS["aslant"]
    (whole,) = pixel_boxes([solid], axes, 2.0)
    with np.errstate(invalid="ignore"):
        span = grid(whole, axes, 2.0).spans(solid)[0]
        is_there = span.enter < span.leave
    depth = np.where(is_there, span.enter, np.inf).astype(np.float32)
    source = np.where(is_there, 0, -1).astype(np.int16)
    sources = (sprite._Source(solid, Tint(0), is_cut),)
    return sprite.Sprite(whole.left, whole.top, depth, source, sources, axes, 2.0), is_there


@pytest.mark.parametrize("name", ["box", "ball", "cylinder"])
def test_normals_are_those_of_the_surface_that_is_seen(name: str) -> None:
    """By the differences of the depth of neighbouring points."""
    solid = SOLIDS[name]
    made, is_there = drawn(solid)
    numbers = np.flatnonzero(is_there.ravel())
    _, normals = made._normals(solid, made._places()[:, numbers])
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-3)
    # Towards the viewer.
    assert (normals[:, 2] < 0.05).all()
    field = np.full((*is_there.shape, 3), np.nan)
    field.reshape(-1, 3)[numbers] = normals
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (made.depth[:, 2:] - made.depth[:, :-2]) * made.zoom / 2
        wanted = -field[:, 1:-1, 0] / field[:, 1:-1, 2]
        is_smooth = np.isfinite(slope) & (np.abs(wanted) < 1.0)
        steps = np.abs(field[:, 2:] - field[:, :-2]).sum(axis=2)
    is_smooth &= steps < 0.3
    assert is_smooth.sum() > 40
    assert np.abs(slope - wanted)[is_smooth].max() < 0.3


def test_faces_of_one_solid_are_told_apart() -> None:
    made, is_there = drawn(SOLIDS["box"])
    points = made._places()[:, is_there.ravel()]
    faces, normals = made._normals(SOLIDS["box"], points)
    # Three sides of a box are seen, each with one normal.
    assert len(set(faces.tolist())) == 3
    assert all(np.ptp(normals[faces == face], axis=0).max() < 1e-6 for face in set(faces.tolist()))
    for name, seen in (("ball", 1), ("cylinder", 2)):
        made, is_there = drawn(SOLIDS[name])
        faces, _ = made._normals(SOLIDS[name], made._places()[:, is_there.ravel()])
        assert len(set(faces.tolist())) == seen
    # In a bore, the normal points to the axis.
    tube = ring((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 10.0, 5.0, 3.0)
    places = np.array([[3.0, 0.0, 1.0], [5.0, 0.0, 1.0], [4.0, 0.0, 5.0], [0.0, 4.0, -5.0]]).T
    face, normal = sprite._round_faces(tube, tube.frame @ places, tube.frame)
    assert normal == pytest.approx(
        np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    )
    assert len(set(face.tolist())) == 4


def test_light_comes_from_above_on_the_left_and_holes_are_darker() -> None:
    """Directions are right, down and away."""
    towards = {
        "up": (0.0, -1.0, 0.0),
        "viewer": (0.0, 0.0, -1.0),
        "left": (-1.0, 0.0, 0.0),
        "right": (1.0, 0.0, 0.0),
        "down": (0.0, 1.0, 0.0),
    }
    normals = np.array(list(towards.values()))
    bright = dict(zip(towards, sprite._shades(normals, is_cut=False), strict=True))
    assert bright["up"] > bright["viewer"] > bright["left"] > bright["right"] >= bright["down"]
    assert min(bright.values()) > 0.4 * sprite.SHADES
    light = np.array([[-0.42, -0.72, -0.55]]) / math.hypot(0.42, 0.72, 0.55)
    assert sprite._shades(light, is_cut=False) == [sprite.SHADES - 1]
    dark = dict(zip(towards, sprite._shades(normals, is_cut=True), strict=True))
    assert all(0.75 * bright[name] < dark[name] < 0.85 * bright[name] for name in towards)
    # What is turned away from the light gets no darker than what is a little.
    away = sprite._shades(np.concatenate([-light, [[0.0, 1.0, 0.0]]]), is_cut=False)
    assert away[0] == away[1]
