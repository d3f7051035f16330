from __future__ import annotations

import dataclasses
from functools import cache

import mujoco
import numpy as np
import pytest

from brickhub.errors import DescriptionError
from brickhub.robot import BENCH, DriveBase
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.engines.conventions import LOOKS_GROUP
from bricktwin.twin.models.load import load_model
from bricktwin.twin.scene import OPEN_FLOOR, Scene

WALL = Scene(wall_distance_mm=(250.0, 250.0))


@cache
def model() -> mujoco.MjModel:
    return load_model(TWO_WHEELER, WALL).compile()


def test_masses_and_dimensions_match_robot() -> None:
    assert model().body_mass.sum() == pytest.approx(0.428, abs=0.001)
    data = mujoco.MjData(model())
    mujoco.mj_forward(model(), data)
    left, right = data.geom("tyre_E").xpos, data.geom("tyre_A").xpos
    assert left - right == pytest.approx([0, 0.130, 0], abs=1e-6)
    for port in "EA":
        assert model().geom(f"tyre_{port}").size[0] == pytest.approx(0.028)


def test_dimensions_of_another_robot_raise() -> None:
    wide = dataclasses.replace(
        TWO_WHEELER, drive_base=DriveBase("left", "right", wheel_diameter_mm=62, axle_track_mm=150)
    )
    with pytest.raises(DescriptionError, match="wheel of 62 mm"):
        load_model(wide, OPEN_FLOOR)


def test_robot_rests_on_caster() -> None:
    data = mujoco.MjData(model())
    mujoco.mj_forward(model(), data)
    centre = data.subtree_com[model().body("chassis").id] - data.qpos[:3]
    assert model().geom("caster").pos[0] < centre[0] < -0.005
    assert centre[1] == pytest.approx(0.0, abs=1e-6)


def test_motors_are_mirrored() -> None:
    np.testing.assert_allclose(model().joint("motor_A").axis, [0, 1, 0])
    np.testing.assert_allclose(model().joint("motor_E").axis, [0, -1, 0])


def test_solver_options() -> None:
    assert model().opt.timestep == 0.0025
    assert model().opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model().opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC


def test_visuals_have_no_mass_or_contacts() -> None:
    looks = model().geom_group == LOOKS_GROUP
    assert looks.sum() > 10
    assert not model().geom_contype[looks].any()
    assert not model().geom_conaffinity[looks].any()


def test_mesh_normals_point_outwards() -> None:
    # Faces wound the other way round would be culled: the part would look hollow.
    built = model()
    for index in set(built.geom_dataid[built.geom_group == LOOKS_GROUP]) - {-1}:
        first, count = built.mesh_vertadr[index], built.mesh_vertnum[index]
        points = built.mesh_vert[first : first + count]
        faces = built.mesh_face[built.mesh_faceadr[index] :][: built.mesh_facenum[index]]
        normals = built.mesh_normal[built.mesh_normaladr[index] :][: built.mesh_normalnum[index]]
        corners = points[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        shade = normals[
            built.mesh_facenormal[built.mesh_faceadr[index] :][: built.mesh_facenum[index]]
        ].mean(axis=1)
        area = np.linalg.norm(across, axis=1)
        seen = area > 1e-7  # slivers have no side
        assert (np.einsum("ij,ij->i", across, shade)[seen] > 0).all(), built.mesh(index).name


def test_wall_only_in_scene_with_wall() -> None:
    assert model().body("wall").pos[0] > 0
    with pytest.raises(KeyError):
        load_model(TWO_WHEELER, OPEN_FLOOR).compile().geom("wall")


def test_other_robot_raises() -> None:
    with pytest.raises(DescriptionError, match="but the robot bench calls it"):
        load_model(dataclasses.replace(BENCH, model=TWO_WHEELER.model), OPEN_FLOOR)
