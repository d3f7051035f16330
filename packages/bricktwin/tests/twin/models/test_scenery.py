"""Objects of a scene in a model: where they are, how they are turned, and what pushes them."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from bricktwin.plans.geometry import Floats
from bricktwin.twin.floor_picture import Picture
from bricktwin.twin.models import scenery
from bricktwin.twin.objects import COLORS, Ball, Block, Field, Line, Object, Ramp, Wall
from bricktwin.twin.scene import Scene


def model_of(*objects: Object) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    scenery.add_objects(spec, Scene(objects=objects))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def corners_mm(model: mujoco.MjModel, data: mujoco.MjData, geom: int = 0) -> Floats:
    """Corners [8, 3] of a box in the world."""
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    turn = data.geom_xmat[geom].reshape(3, 3)
    return 1000 * (signs * model.geom_size[geom] @ turn.T + data.geom_xpos[geom])


def test_a_wall_stands_from_point_to_point() -> None:
    model, data = model_of(Wall((100.0, 50.0), (400.0, 450.0), 120.0, thickness_mm=20.0))
    corners = corners_mm(model, data)
    across = np.array([-0.8, 0.6]) * 10.0
    wanted = {
        (*np.round(np.array(end) + side * across, 6), height)
        for end in ((100.0, 50.0), (400.0, 450.0))
        for side in (-1, 1)
        for height in (0.0, 120.0)
    }
    assert {tuple(np.round(corner, 6) + 0.0) for corner in corners} == wanted
    assert model.geom_rgba[0].tolist() == pytest.approx([*COLORS["red"], 1.0])


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -30.0])
def test_a_ramp_rises_from_its_lower_edge_to_its_height(heading_deg: float) -> None:
    ramp = Ramp((200.0, 100.0), 400.0, 300.0, 60.0, heading_deg)
    model, data = model_of(ramp)
    # A heading is clockwise.
    heading = -math.radians(heading_deg)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    offsets = corners_mm(model, data)
    along, aside = (offsets[:, :2] - ramp.at_mm) @ ahead, (offsets[:, :2] - ramp.at_mm) @ left
    found = {
        tuple(round(float(value), 3) + 0.0 for value in corner)
        for corner in zip(along, aside, offsets[:, 2], strict=True)
    }
    # The upper side, and the lower one at right angles to it, of a plate of 8 mm.
    slope = math.atan2(60.0, 400.0)
    below = (8.0 * math.sin(slope), -8.0 * math.cos(slope))
    wanted = {
        (round(end + shift[0], 3) + 0.0, side, round(height + shift[1], 3) + 0.0)
        for end, height in ((0.0, 0.0), (400.0, 60.0))
        for shift in ((0.0, 0.0), below)
        for side in (-150.0, 150.0)
    }
    assert found == wanted


def test_a_block_is_turned_clockwise_and_fixed_unless_it_has_a_mass() -> None:
    at_mm, size_mm = (300.0, -100.0), (80.0, 40.0, 60.0)
    model, data = model_of(
        Block(at_mm, size_mm, heading_deg=90.0),
        Block((900.0, 0.0), size_mm, "green", 30.0, mass_g=50.0),
        Block((0.0, 900.0), size_mm, round=True),
    )
    corners = corners_mm(model, data)
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert low == pytest.approx([280.0, -140.0, 0.0]) and high == pytest.approx(
        [320.0, -60.0, 60.0]
    )
    assert {model.geom(geom).name for geom in range(3)} == {"object_0", "object_1", "object_2"}
    # Only what can be pushed is a body with a joint of its name.
    assert model.njnt == 1 and model.joint(0).name == "object_1"
    assert model.body("object_1").mass[0] == pytest.approx(0.05)
    x_axis = data.geom("object_1").xmat.reshape(3, 3)[:, 0]
    assert x_axis[:2] == pytest.approx([math.cos(math.radians(30)), -math.sin(math.radians(30))])
    # A round one is a cylinder of its width and height.
    can = model.geom("object_2")
    assert can.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert can.size[:2] == pytest.approx([0.04, 0.03])
    assert data.geom("object_2").xpos == pytest.approx([0.0, 0.9, 0.03])


def test_what_can_be_pushed_collides_with_all_and_what_is_fixed_with_robots_alone() -> None:
    model, _ = model_of(Block((300.0, 0.0)), Block((600.0, 0.0), mass_g=50.0), Ball((900.0, 0.0)))

    def touch(one: int, other: int) -> bool:
        bits, answers = model.geom_contype, model.geom_conaffinity
        return bool(bits[one] & answers[other] or bits[other] & answers[one])

    fixed, block, ball = range(3)
    assert touch(fixed, block) and touch(fixed, ball) and touch(block, ball)
    assert not model.geom_contype[fixed]
    # Its own friction counts on the floor; that of a fixed one leaves a tyre its own.
    assert model.geom_priority.tolist() == [0, 1, 1]
    assert model.geom_friction[block][0] < model.geom_friction[fixed][0] == 1.0


def test_a_ball_lies_on_the_floor_and_comes_to_rest() -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], conaffinity=1)
    scenery.add_objects(spec, Scene(objects=(Ball((300.0, 200.0), 80.0, mass_g=60.0),)))
    model = spec.compile()
    data = mujoco.MjData(model)
    assert data.qpos[:3].tolist() == pytest.approx([0.3, 0.2, 0.04])
    assert model.body("object_0").mass[0] == pytest.approx(0.06)
    # It rolls at half a metre a second, and stops within half a metre or so.
    data.qvel[0], data.qvel[4] = 0.5, 0.5 / 0.04
    mujoco.mj_step(model, data, nstep=2000)
    assert abs(data.qvel[0]) < 0.02
    assert 0.3 < data.qpos[0] - 0.3 < 0.8


def heights_mm(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
    """Height of each layer."""
    return [1000 * float(data.geom_xpos[geom][2]) for geom in range(model.ngeom)]


def test_marks_lie_in_layers_the_last_on_top() -> None:
    red = Field((0.0, 0.0), (100.0, 60.0))
    black = Line(((0.0, 0.0), (200.0, 0.0)))
    # Neighbours of one color share a layer.
    model, data = model_of(red, red, black, Field((50.0, 0.0), (9.0, 9.0)))
    assert heights_mm(model, data) == pytest.approx([0.6, 0.8, 1.0], abs=0.01)
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()
    # Very many get closer to one another, so that the uppermost hides no wheel.
    many = heights_mm(*model_of(*[red, black] * 15))
    assert len(many) == 30 and many == sorted(many)
    assert many[-1] < 2.4 and min(np.diff(many)) > 0.05


def extent_mm(shape: Any) -> list[float]:
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    return [*low[:2].round(3).tolist(), *high[:2].round(3).tolist()]


def area_mm2(shape: Any) -> float:
    """Area seen from above."""
    a, b, c = (shape.points[shape.faces[:, corner]] for corner in range(3))
    doubled = np.cross(b - a, c - a)[:, 2]
    return float(doubled[doubled > 0].sum()) / 2


def test_marks_are_drawn_where_a_sensor_sees_them() -> None:
    turned = Field((300.0, 100.0), (80.0, 40.0), heading_deg=90.0)
    assert extent_mm(scenery._field(turned)) == [280.0, 60.0, 320.0, 140.0]
    assert area_mm2(scenery._field(turned)) == pytest.approx(3200.0)
    aslant = Field((0.0, 0.0), (80.0, 40.0), heading_deg=30.0)
    for x, y, _ in scenery._field(aslant).points:
        assert aslant.beyond_mm(x, y) == pytest.approx(0.0, abs=0.01)
    oval = scenery._field(Field((0.0, 0.0), (80.0, 40.0), round=True))
    assert extent_mm(oval) == [-40.0, -20.0, 40.0, 20.0]
    assert area_mm2(oval) == pytest.approx(math.pi * 40 * 20, rel=0.01)


def test_a_line_is_as_wide_as_its_tape_and_round_at_its_corners() -> None:
    line = Line(((0.0, 0.0), (300.0, 400.0), (300.0, 800.0)), width_mm=20.0)
    shape = scenery._line(line)
    # No point of it is beyond its edge, and it reaches all of that.
    beyond = [line.beyond_mm(x, y) for x, y, _ in shape.points]
    assert max(beyond) == pytest.approx(0.0, abs=0.01) and min(beyond) > -10.01
    assert extent_mm(shape) == pytest.approx([-10.0, -10.0, 310.0, 810.0], abs=0.2)
    disc = 24 / 2 * 100 * math.sin(math.tau / 24)
    assert area_mm2(shape) == pytest.approx(20 * 500 + 20 * 400 + 3 * disc, rel=1e-3)
    closed = scenery._line(Line(line.points_mm, 20.0, closed=True))
    assert area_mm2(closed) > area_mm2(shape) + 20 * 800
    twice = Line(((0.0, 0.0), (0.0, 0.0), (100.0, 0.0)), 20.0)
    assert np.isfinite(scenery._line(twice).points).all()


def test_a_picture_lies_turned_in_its_size() -> None:
    pixels = bytes(range(2 * 3 * 3))
    picture = Picture(pixels, 3, (300.0, 200.0), (50.0, -20.0), 90.0)
    spec = mujoco.MjSpec()
    scenery.add_objects(spec, Scene(objects=(picture,)))
    (texture,) = spec.textures
    assert (texture.width, texture.height, bytes(texture.data)) == (3, 2, pixels)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.geom_size[0][:2].tolist() == pytest.approx([0.15, 0.10])
    assert data.geom_xpos[0] == pytest.approx([0.05, -0.02, 0.0006])
    # Its right side looks where a robot of that heading does: to -y.
    assert data.geom_xmat[0].reshape(3, 3)[:, 0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert not model.geom_contype[0] and not model.geom_conaffinity[0]


@pytest.mark.parametrize("corners", [3, 4, 7])
def test_a_mark_has_an_upper_and_a_lower_side_and_no_edges(corners: int) -> None:
    angles = 2 * np.pi * np.arange(corners) / corners
    outline = np.stack([30.0 * np.cos(angles), 20.0 * np.sin(angles)], axis=1)
    shape = scenery._flat(outline)
    assert len(shape.points) == 2 * corners and len(shape.faces) == 2 * (corners - 2)
    assert shape.points[:corners, :2] == pytest.approx(outline)
    assert shape.points[corners:, :2] == pytest.approx(outline)
    # The upper one is seen from above, the lower one from below, and they lie close together.
    heights = shape.points[:, 2]
    assert (heights[:corners] == -heights[corners:]).all() and 0.0 < heights[0] < 0.5
    assert shape.normals.tolist() == [[0, 0, 1]] * corners + [[0, 0, -1]] * corners
    triangles = shape.points[shape.faces]
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    half = len(triangles) // 2
    assert (across[:half, 2] > 0).all() and (across[half:, 2] < 0).all()
    # Each covers all of the outline: by the shoelace formula.
    x, y = outline.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert across[:half, 2].sum() / 2 == pytest.approx(area)
    assert across[half:, 2].sum() / 2 == pytest.approx(-area)
