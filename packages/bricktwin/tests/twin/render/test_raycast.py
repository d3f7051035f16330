"""Raycast pictures against OpenGL."""

from __future__ import annotations

import numpy as np
import pytest

from brickhub.errors import RenderingUnavailableError, TwinError
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import Image, Renderer
from bricktwin.twin.render.raycast import RayCaster, _colours
from bricktwin.twin.scene import Scene

MOVES = (("B", 6000, 300), ("B", 6000, 900), ("A", 6000, 1300), ("D", -6000, 1700))


@pytest.fixture
def arm() -> MujocoBody:
    return MujocoBody(ROBO_ARM, Scene(ball=True), Physics(), 0)


def red(image: Image) -> tuple[float, float]:
    """Centre of the red pixels."""
    rows, columns = np.nonzero((image[..., 0] > 100) & (image[..., 1] < 60) & (image[..., 2] < 60))
    return float(rows.mean()), float(columns.mean())


def test_raycast_matches_opengl_without_lights(arm: MujocoBody) -> None:
    try:
        renderer = Renderer(arm, 320, 240, "webcam", smooth=False)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    caster = RayCaster(arm, 320, 240, "webcam", 4)
    for port, voltage_mv, time_ms in MOVES:
        arm.set_voltage(port, voltage_mv)
        arm.advance_to(time_ms)
        drawn, cast = renderer.render(), caster.render()
        assert cast.shape == drawn.shape
        assert red(cast) == pytest.approx(red(drawn), abs=2)
        assert np.median(np.abs(cast.astype(int) - drawn)) < 10
    renderer.close()


def test_static_rays_are_cached(arm: MujocoBody) -> None:
    caster = RayCaster(arm, 160, 120, "webcam", 4)
    for port, voltage_mv, time_ms in MOVES:
        arm.set_voltage(port, voltage_mv)
        arm.advance_to(time_ms)
        assert np.array_equal(caster.render(), RayCaster(arm, 160, 120, "webcam", 4).render())
        assert caster._stale.sum() < 600  # of 1,200 spots


def test_moving_camera_recasts_all() -> None:
    robot = MujocoBody(TWO_WHEELER, Scene(wall_distance_mm=(250.0, 250.0)), Physics(), 0)
    caster = RayCaster(robot, 64, 48, "chase", 4)
    before = caster.render()
    for port, voltage_mv in (("E", 5000), ("A", -5000)):
        robot.set_voltage(port, voltage_mv)
    robot.advance_to(1500)
    after = caster.render()
    assert np.array_equal(after, RayCaster(robot, 64, 48, "chase", 4).render())
    assert not np.array_equal(before, after)


def test_spot_lights_may_cover_part(arm: MujocoBody) -> None:
    fine, coarse = (RayCaster(arm, 101, 75, "webcam", spot_px).render() for spot_px in (1, 7))
    assert fine.shape == coarse.shape == (75, 101, 3)
    assert np.array_equal(coarse[3::7, 3::7][:10, :14], fine[3::7, 3::7][:10, :14])


def test_colours_are_those_of_materials_and_of_the_sky(arm: MujocoBody) -> None:
    colours, textures = _colours(arm.model)
    assert colours.shape == textures.shape == (arm.model.ngeom + 1, 3)
    floor, ball = (arm.model.geom(name).id for name in ("floor", "ball"))
    assert textures[floor].max() < 1.0, "it has a pattern"
    assert colours[ball, 0] > 2 * colours[ball, 1:].max(), "it is red"
    # What hits nothing reads the last row, which no light and no texture changes.
    assert colours[-1].tolist() == [0.50, 0.59, 0.69]
    assert textures[-1].tolist() == [1.0, 1.0, 1.0]


def test_mistakes_raise(arm: MujocoBody) -> None:
    with pytest.raises(TwinError, match="640 x 480 with spots of 0"):
        RayCaster(arm, 640, 480, "webcam", 0)
    with pytest.raises(TwinError, match="no camera 'selfie'"):
        RayCaster(arm, 640, 480, "selfie")
