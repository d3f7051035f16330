"""What is drawn of a model: each kind of geometry at its size and place, its colours and pictures,
and what turns for the eye only."""

from __future__ import annotations

import base64
import io
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image

from brickhub.errors import TwinError
from bricktwin.plans.drawing import shapes
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.view.body_drawing import PRIMITIVES, drawing_of_model
from bricktwin.view.drawing_of_body import (
    Drawing,
    DrawnBody,
    Mesh,
    Shape,
    View,
    box,
    mesh_of,
    poses,
    rectangle,
)

KIND = mujoco.mjtGeom


@pytest.mark.parametrize(
    ("kind", "size", "half"),
    [
        (KIND.mjGEOM_BOX, (0.01, 0.02, 0.03), (0.01, 0.02, 0.03)),
        (KIND.mjGEOM_SPHERE, (0.02, 0.0, 0.0), (0.02, 0.02, 0.02)),
        (KIND.mjGEOM_ELLIPSOID, (0.03, 0.01, 0.02), (0.03, 0.01, 0.02)),
        # Half of the length of a capsule is that of its straight part.
        (KIND.mjGEOM_CAPSULE, (0.01, 0.03, 0.0), (0.01, 0.01, 0.04)),
        (KIND.mjGEOM_CYLINDER, (0.02, 0.05, 0.0), (0.02, 0.02, 0.05)),
    ],
)
def test_geometry_is_drawn_at_its_size(kind: Any, size: Any, half: Any) -> None:
    mesh = PRIMITIVES[kind](*size)
    assert np.abs(mesh.points).max(axis=0) == pytest.approx(half, rel=0.02)
    assert mesh.points.max(axis=0) == pytest.approx(-mesh.points.min(axis=0), rel=0.02)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(len(mesh.normals)))
    # Each face looks outwards, as its normals do.
    corners = mesh.points[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = mesh.normals[mesh.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", across, normals) > -1e-12).all()
    assert (np.einsum("ij,ij->i", mesh.points, mesh.normals) > 0).all()


def test_normals_of_a_stretched_sphere_are_those_of_its_surface() -> None:
    half = np.array([0.03, 0.01, 0.02])
    mesh = PRIMITIVES[KIND.mjGEOM_ELLIPSOID](*half)
    slopes = mesh.points / half**2
    slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", slopes, mesh.normals).min() > 0.98
    # A shape that is as much larger in all directions keeps its normals.
    shape = shapes.block(1.0, 2.0, 3.0)
    assert mesh_of(shape, 0.5).normals == pytest.approx(shape.normals)
    assert mesh_of(shape).points == pytest.approx(shape.points)


def test_a_rectangle_is_seen_from_its_z_axis() -> None:
    mesh = rectangle(0.3, 0.2)
    assert mesh.points.tolist() == pytest.approx(
        np.array([[-0.3, -0.2, 0], [0.3, -0.2, 0], [0.3, 0.2, 0], [-0.3, 0.2, 0]])
    )
    corners = mesh.points[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Two halves, both of which face upwards.
    assert across[:, 2] == pytest.approx([0.24, 0.24])
    assert mesh.normals.tolist() == [[0.0, 0.0, 1.0]] * 4
    assert np.ptp(box((0.1, 0.2, 0.3)).points, axis=0) == pytest.approx([0.2, 0.4, 0.6])


POINTS = np.zeros((3, 3), np.float32)
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("points", "normals", "faces"),
    [
        (POINTS[:, :2], POINTS, FACE),
        (POINTS, POINTS[:2], FACE),
        (POINTS, POINTS[:, :2], FACE),
        (POINTS, POINTS, FACE[:, :2]),
        (POINTS, POINTS, FACE[0]),
    ],
)
def test_arrays_of_a_mesh_have_their_shapes(points: Any, normals: Any, faces: Any) -> None:
    with pytest.raises(TwinError, match=r"points and normals \[n, 3\] and faces \[m, 3\]; give"):
        Mesh(points, normals, faces)


@pytest.mark.parametrize(
    ("faces", "is_right"),
    [([[0, 1, 2]], True), ([[0, 1, 3]], False), ([[-1, 1, 2]], False), ([[0, 2, 2]], True)],
)
def test_faces_are_of_the_meshs_own_points(faces: Any, is_right: bool) -> None:
    if is_right:
        Mesh(POINTS, POINTS, np.array(faces))
        return
    with pytest.raises(TwinError, match="a mesh of 3 points has a face with another one; give num"):
        Mesh(POINTS, POINTS, np.array(faces))


def test_a_mesh_without_faces_is_one() -> None:
    assert len(Mesh(POINTS[:0], POINTS[:0], np.zeros((0, 3), int)).faces) == 0


def test_numbers_of_a_mesh_are_packed_as_the_page_reads_them() -> None:
    points = np.array([[0.5, -1.0, 2.0], [0.0, 0.25, 0.0], [1.0, 1.0, 1.0]], np.float32)
    normals = np.array([[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [0.0, -1.5, 0.0]], np.float32)
    packed = Mesh(points, normals, FACE).described()
    data = {name: base64.b64decode(text) for name, text in packed.items()}
    assert np.frombuffer(data["points"], "<f4").reshape(3, 3).tolist() == points.tolist()
    # Four bytes for each normal, of which the last one is nothing; none is longer than 1.
    read = np.frombuffer(data["normals"], np.int8).reshape(3, 4)
    assert read.tolist() == [[0, 0, 127, 0], [76, -102, 0, 0], [0, -127, 0, 0]]
    assert np.frombuffer(data["faces"], "<u4").tolist() == [0, 1, 2]


def test_equal_meshes_and_pictures_are_sent_once() -> None:
    one, other = box((1.0, 1.0, 1.0)), box((1.0, 1.0, 1.0))
    red = (1.0, 0.0, 0.0, 1.0)
    drawn = (
        DrawnBody("first", (Shape(one, red), Shape(other, red, picture=b"png"))),
        DrawnBody("second", (Shape(one, red, picture=b"png"), Shape(one, red)), 7),
    )
    plain = Drawing(drawn).described()
    assert [shape["mesh"] for body in plain["bodies"] for shape in body["shapes"]] == [0, 1, 0, 0]
    pictures = [shape["picture"] for body in plain["bodies"] for shape in body["shapes"]]
    assert pictures == [None, 0, 0, None]
    assert plain["pictures"] == [base64.b64encode(b"png").decode()] and len(plain["meshes"]) == 2
    assert [body["model_body"] for body in plain["bodies"]] == [None, 7]
    assert plain["floor"] == 0.0 and plain["spinners"] == plain["rods"] == []


MODEL = """
<mujoco>
  <asset>
    <texture name="map" type="2d" builtin="flat" rgb1="1 0 0" width="4" height="2"/>
    <texture name="tile" type="2d" builtin="checker" width="8" height="8"/>
    <material name="map" texture="map" rgba="1 1 1 0.5"/>
    <material name="tile" texture="tile" texuniform="true"/>
    <material name="plain" rgba="0 0 1 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" material="tile"/>
    <geom name="mat" type="plane" size="0.3 0.2 0.1" material="map" pos="0 0 0.001"/>
    <geom name="bare" type="plane" size="0.3 0.2 0.1"/>
    <geom name="plain" type="plane" size="0.3 0.2 0.1" material="plain"/>
    <body name="wall" pos="1 0 0">
      <geom name="wall" type="box" size="0.01 0.5 0.1" rgba="0.5 0.25 0 1"/>
    </body>
    <body name="hidden"><geom type="sphere" size="0.01" group="3"/></body>
    <body name="{name}" pos="0 0 0.1">
      {joint}
      <geom type="box" size="0.1 0.1 0.1" group="3"/>
      <geom type="box" size="0.1 0.05 0.02" material="plain" pos="0.1 0.2 0.3" quat="0 1 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def drawn(joint: str = "<freejoint/>", name: str = "chassis") -> Drawing:
    text = MODEL.format(joint=joint, name=name)
    return drawing_of_model(MujocoEngine(mujoco.MjModel.from_xml_string(text)))


def test_what_is_seen_of_a_model_is_drawn_with_its_colours() -> None:
    drawing = drawn()
    assert [body.name for body in drawing.bodies] == ["world", "wall", "chassis"]
    assert [body.model_body for body in drawing.bodies] == [0, 1, 3]
    # Of planes, only the picture; shapes for contacts alone are hidden.
    (mat,) = drawing.bodies[0].shapes
    assert np.ptp(mat.mesh.points, axis=0)[:2] == pytest.approx([0.6, 0.4])
    assert mat.colour == (1.0, 1.0, 1.0, 0.5) and mat.position == (0.0, 0.0, 0.001)
    assert mat.picture is not None
    image = Image.open(io.BytesIO(mat.picture))
    assert image.size == (4, 2) and image.getpixel((3, 1)) == (255, 0, 0)
    (wall,) = drawing.bodies[1].shapes
    assert wall.colour == (0.5, 0.25, 0.0, 1.0) and wall.pattern == "bricks"
    assert wall.picture is None
    (case,) = drawing.bodies[2].shapes
    assert case.colour == (0.0, 0.0, 1.0, 1.0) and case.pattern == ""
    assert case.position == pytest.approx((0.1, 0.2, 0.3))
    assert case.wxyz == pytest.approx((0.0, 1.0, 0.0, 0.0))


def test_the_camera_follows_a_robot_that_moves_about() -> None:
    # The third of the bodies that are drawn.
    assert drawn().view == View(follow=2)
    # A robot on a table is seen from nearby, and so is a world without one.
    still = View(target=(0.06, 0.0, 0.13), distance_m=0.8, yaw_deg=-50.0)
    assert drawn('<joint axis="0 0 1"/>').view == still and drawn("").view == still


def test_corners_of_a_mesh_have_a_point_for_each_of_their_normals() -> None:
    """A cube of eight corners, with sharp edges: three normals at each."""
    spec = mujoco.MjSpec()
    corners = np.stack(np.meshgrid(*[(-0.1, 0.1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for number in range(2):
        name = f"cube_{number}"
        spec.add_mesh(name=name, uservert=((1 + number) * corners).ravel().tolist())
    body = spec.worldbody.add_body(name="cubes")
    for number in (1, 0, 1):
        body.add_geom(type=KIND.mjGEOM_MESH, meshname=f"cube_{number}")
    drawing = drawing_of_model(MujocoEngine(spec.compile()))
    large, small, again = drawing.bodies[0].shapes
    assert large.mesh is again.mesh and large.mesh is not small.mesh
    for mesh, side_m in ((large.mesh, 0.4), (small.mesh, 0.2)):
        assert np.ptp(mesh.points, axis=0) == pytest.approx([side_m] * 3, abs=1e-6)
        assert len(mesh.faces) == 12 and len(np.unique(mesh.points.round(4), axis=0)) == 8
        pairs = np.concatenate([mesh.points, mesh.normals], axis=1).round(4)
        assert len(np.unique(pairs, axis=0)) == len(pairs)
        across = np.cross(
            mesh.points[mesh.faces[:, 1]] - mesh.points[mesh.faces[:, 0]],
            mesh.points[mesh.faces[:, 2]] - mesh.points[mesh.faces[:, 0]],
        )
        assert (np.einsum("ij,ij->i", across, mesh.points[mesh.faces[:, 0]]) > 0).all()


def test_poses_are_rows_of_seven() -> None:
    assert poses([(1.0, 2.0, 3.0)]).tolist() == [[1, 2, 3, 1, 0, 0, 0]]
    both = poses([(1, 2, 3), (4, 5, 6)], [(0, 1, 0, 0), (0, 0, 1, 0)])
    assert both.tolist() == [[1, 2, 3, 0, 1, 0, 0], [4, 5, 6, 0, 0, 1, 0]]
    assert both.dtype == np.float32 and poses([]).shape == (0, 7)
