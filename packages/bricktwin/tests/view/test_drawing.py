"""Drawings in plain values, primitives, drawings of bodies, frames."""

from __future__ import annotations

import base64
import json

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.view.body_drawing import PRIMITIVES, drawing_of
from bricktwin.view.drawing_of_body import HIDDEN, Drawing, DrawnBody, Mesh, Shape, box, poses
from bricktwin.view.mirror import Mirror


def volume(mesh: Mesh) -> float:
    """Volume of a closed mesh with outward faces."""
    a, b, c = (mesh.points[mesh.faces[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(
    ("kind", "size", "expected"),
    [
        (mujoco.mjtGeom.mjGEOM_BOX, (1.0, 2.0, 3.0), 48.0),
        (mujoco.mjtGeom.mjGEOM_SPHERE, (1.0, 0.0, 0.0), 4 / 3 * np.pi),
        (mujoco.mjtGeom.mjGEOM_ELLIPSOID, (1.0, 2.0, 0.5), 4 / 3 * np.pi),
        (mujoco.mjtGeom.mjGEOM_CYLINDER, (1.0, 2.0, 0.0), 4 * np.pi),
        (mujoco.mjtGeom.mjGEOM_CAPSULE, (1.0, 2.0, 0.0), 4 * np.pi + 4 / 3 * np.pi),
    ],
)
def test_primitives_are_closed_and_face_outwards(
    kind: int, size: tuple[float, float, float], expected: float
) -> None:
    mesh = PRIMITIVES[kind](*size)
    assert 0.95 * expected < volume(mesh) < 1.0001 * expected
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    a, b, c = (mesh.points[mesh.faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    flat = np.linalg.norm(across, axis=1) > 1e-7
    assert (np.einsum("ij,ij->i", across, mesh.normals[mesh.faces[:, 0]])[flat] > 0).all()


def test_too_large_mesh_raises() -> None:
    good = box((1.0, 1.0, 1.0))
    with pytest.raises(TwinError, match="numbers below 24"):
        Mesh(good.points, good.normals, good.faces + 1)
    with pytest.raises(TwinError, match=r"\[n, 3\]"):
        Mesh(good.points, good.normals[:-1], good.faces)


def test_drawing_in_plain_values() -> None:
    cube = box((1.0, 1.0, 1.0))
    red, blue = (
        Shape(cube, colour, (0.0, 0.0, z), picture=b"PNG")
        for colour, z in (((1.0, 0, 0, 1.0), 0.0), ((0, 0, 1.0, 0.5), 2.0))
    )
    drawing = Drawing((DrawnBody("both", (red, blue)), DrawnBody("one", (red,), 3)), floor_m=None)
    plain = json.loads(json.dumps(drawing.described()))
    (mesh,) = plain["meshes"]  # which is used three times
    assert [base64.b64decode(picture) for picture in plain["pictures"]] == [b"PNG"]
    points = np.frombuffer(base64.b64decode(mesh["points"]), "<f4").reshape(-1, 3)
    normals = np.frombuffer(base64.b64decode(mesh["normals"]), np.int8).reshape(-1, 4)
    faces = np.frombuffer(base64.b64decode(mesh["faces"]), "<u4").reshape(-1, 3)
    assert np.array_equal(points, cube.points) and np.array_equal(faces, cube.faces)
    assert np.array_equal(normals[:, :3], cube.normals * 127)
    both, one = plain["bodies"]
    assert [shape["colour"][3] for shape in both["shapes"]] == [1.0, 0.5]
    assert both["model_body"] is None and one["model_body"] == 3 and plain["floor"] is None


def test_poses() -> None:
    both = poses([[1, 2, 3], [HIDDEN, 0, 0]])
    assert both.shape == (2, 7) and both.dtype == np.float32
    assert both[0].tolist() == [1, 2, 3, 1, 0, 0, 0] and np.isnan(both[1, 0])


@pytest.mark.parametrize(
    ("robot", "surroundings"),
    [
        (WALKER, Scene(wall_distance_mm=(300, 300))),
        (TWO_WHEELER, OPEN_FLOOR),
        (ROBO_ARM, Scene(ball=True)),
    ],
)
def test_drawing_of_a_body(robot, surroundings) -> None:
    body = make_body(robot, scene=surroundings)
    drawing = drawing_of(body)
    numbers = [one.model_body for one in drawing.bodies]
    names = [one.name for one in drawing.bodies]
    assert ("wall" in names) == (surroundings.wall_distance_mm is not None)
    assert all(one.shapes for one in drawing.bodies)
    walls = [shape for one in drawing.bodies for shape in one.shapes if shape.pattern == "bricks"]
    assert len(walls) == (surroundings.wall_distance_mm is not None)
    assert len(json.dumps(drawing.described())) < 2_500_000
    mirror = Mirror(make_body(robot, scene=surroundings))
    body.data.qpos[-1] += 0.1
    body.update_visuals()
    seen = mirror.poses(body.data.qpos)
    assert np.allclose(
        seen[: len(numbers)], poses(body.data.xpos[numbers], body.data.xquat[numbers])
    )
    assert np.isnan(seen[len(numbers) :, 0]).all(), "a ghost without a goal is hidden"
