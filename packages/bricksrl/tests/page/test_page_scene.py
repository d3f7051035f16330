"""Scenes as bytes, primitives, twin scenes."""

from __future__ import annotations

import json
import struct
import threading
from pathlib import Path

import mujoco
import numpy as np
import pytest

from brickhub.robot import DriveBase, HubKind, Motor, Robot
from bricksrl.envs.registry import get_task
from bricksrl.errors import PageError
from bricksrl.page.board import Board
from bricksrl.page.robot_view import PRIMITIVES, Mirror, RobotView, twin_scene
from bricksrl.page.scene import HIDDEN, Mesh, Scene, SceneBody, Shape, box, poses
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.linkage import pose_at, sensed_qpos
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import OPEN_FLOOR
from bricktwin.twin.scene import Scene as Surroundings


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
    with pytest.raises(PageError, match="numbers below 24"):
        Mesh(good.points, good.normals, good.faces + 1)
    with pytest.raises(PageError, match=r"\[n, 3\]"):
        Mesh(good.points, good.normals[:-1], good.faces)


def test_scene_bytes() -> None:
    cube = box((1.0, 1.0, 1.0))
    red, blue = (
        Shape(cube, colour, (0.0, 0.0, z))
        for colour, z in (((1.0, 0, 0, 1.0), 0.0), ((0, 0, 1.0, 0.5), 2.0))
    )
    data = Scene(
        (SceneBody("both", (red, blue)), SceneBody("one", (red,))), floor_m=None
    ).to_bytes()
    (length,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + length])
    assert (4 + length) % 4 == 0 and len(header["meshes"]) == 1, (
        "a mesh that is used three times is sent once"
    )
    mesh = header["meshes"][0]
    points = np.frombuffer(data, "<f4", 3 * mesh["vertices"], 4 + length + mesh["points"]).reshape(
        -1, 3
    )
    faces = np.frombuffer(data, "<u4", 3 * mesh["triangles"], 4 + length + mesh["faces"])
    assert np.array_equal(points, cube.points) and faces.max() == mesh["vertices"] - 1
    assert len(data) == 4 + length + mesh["faces"] + 12 * mesh["triangles"]
    assert [shape["colour"][3] for shape in header["bodies"][0]["shapes"]] == [1.0, 0.5] and header[
        "floor"
    ] is None


def test_poses() -> None:
    both = poses([[1, 2, 3], [HIDDEN, 0, 0]])
    assert both.shape == (2, 7) and both.dtype == np.float32
    assert both[0].tolist() == [1, 2, 3, 1, 0, 0, 0] and np.isnan(both[1, 0])


@pytest.mark.parametrize(
    ("robot", "surroundings"),
    [
        (WALKER, Surroundings(wall_distance_mm=(300, 300))),
        (TWO_WHEELER, OPEN_FLOOR),
        (ROBO_ARM, Surroundings(ball=True)),
    ],
)
def test_twin_scene(robot, surroundings) -> None:
    body = make_body(robot, scene=surroundings)
    scene, numbers = twin_scene(body)
    names = [one.name for one in scene.bodies]
    assert ("wall" in names) == (surroundings.wall_distance_mm is not None)
    assert all(one.shapes for one in scene.bodies)
    walls = [shape for one in scene.bodies for shape in one.shapes if shape.pattern == "bricks"]
    assert len(walls) == (surroundings.wall_distance_mm is not None)
    assert len(scene.to_bytes()) < 2_000_000
    mirror = Mirror(make_body(robot, scene=surroundings))
    body.data.qpos[-1] += 0.1
    body.update_visuals()
    seen = mirror.poses(body.data.qpos)
    assert np.allclose(
        seen[: len(numbers)], poses(body.data.xpos[numbers], body.data.xquat[numbers])
    )
    assert np.isnan(seen[len(numbers) :, 0]).all(), "a ghost without a goal is hidden"


@pytest.mark.parametrize("env_id", ["RoboArm-v0", "Park-v0", "Walker-v1"])
def test_goal_is_drawn_as_a_ghost_of_the_robot(env_id: str) -> None:
    """One that has reached its goal is where its ghost is."""
    task = get_task(env_id)
    observation = [0.5 * (entry.low + entry.high) for entry in task.entries]
    goal = task.goal(observation)
    assert (goal is None) == (env_id == "Walker-v1")
    if goal is None:
        return
    mirror, body = (
        Mirror(make_body(task.robot, scene=task.scene)),
        make_body(task.robot, scene=task.scene),
    )
    pose_at(body, goal)
    names = [one.name for one in mirror.scene.bodies]
    seen = dict(zip(names, mirror.poses(body.data.qpos, goal), strict=True))
    ghosts = [name for name in names if name.startswith("goal ")]
    assert len(ghosts) > 1 and {
        s.colour[3] for one in mirror.scene.bodies if one.name in ghosts for s in one.shapes
    } == {0.45}
    for name in ghosts:
        assert np.allclose(seen[name], seen[name.removeprefix("goal ")], atol=1e-5)
    away = mirror.poses(make_body(task.robot, scene=task.scene).data.qpos, goal)
    assert np.array_equal(away[-1], seen[names[-1]]), "it stays while the robot moves"


@pytest.mark.parametrize("robot", [WALKER, TWO_WHEELER, ROBO_ARM])
def test_pose_follows_sensors(robot) -> None:
    """Sensor values of one twin give another the same pose."""
    body, mirror = make_body(robot), Mirror(make_body(robot))
    for port, voltage in zip(
        (motor.port for motor in robot.motors), (3000, -2500, 2000, -3500), strict=False
    ):
        body.set_voltage(port, voltage)
    for time_ms in range(10, 600, 10):
        body.advance_to(time_ms)
    body.update_visuals()
    angles = {
        m.name: body.angle_mdeg(m.port) / 1000 * m.direction.value * m.turn_deg / 360
        for m in robot.motors
    }
    seen = sensed_qpos(mirror.body, angles, body.tilt_deg())
    for joint in range(body.model.njnt):
        if body.model.jnt_type[joint] == 3 and "backlash" not in body.model.joint(joint).name:
            address = int(body.model.jnt_qposadr[joint])
            # a rotation sensor tells whole degrees, a crank has some play
            apart = (seen[address] - body.data.qpos[address] + np.pi) % (2 * np.pi) - np.pi
            assert abs(apart) < np.radians(7.0), body.model.joint(joint).name
    lowest = min(mirror.poses(seen)[:, 2])
    assert -0.01 < lowest < 0.2


MOTORS = (Motor("left", "A"), Motor("right", "B"))


def shown(robot: Robot) -> Board:
    """A board with a real robot's pose."""
    board = Board()
    RobotView(board, threading.Event(), lambda: 1.0).show_sensed(
        robot, OPEN_FLOOR, {"left": 10.0, "right": 20.0}, (0.0, 0.0)
    )
    return board


@pytest.mark.parametrize(
    "robot",
    [
        robot_of_plan(Path(plans.__path__[0]) / "two_wheeler.ldr"),
        Robot("driving", HubKind.PRIME, MOTORS, drive_base=DriveBase("left", "right", 56, 130)),
    ],
)
def test_real_robot_is_drawn_from_plan_or_drive_base(robot: Robot) -> None:
    board = shown(robot)
    assert "no_scene" not in board.status[1]
    assert callable(board.poses[1]) and np.isfinite(board.poses[1]()[0]).all()


@pytest.mark.parametrize(
    ("robot", "says"),
    [
        (Robot("bench", HubKind.PRIME, MOTORS), "no model to draw"),
        (
            Robot("narrow", HubKind.PRIME, MOTORS, drive_base=DriveBase("left", "right", 8, 130)),
            "leave no room for its motors",
        ),
    ],
)
def test_page_says_why_real_robot_is_not_drawn(robot: Robot, says: str) -> None:
    board = shown(robot)
    assert says in board.status[1]["no_scene"] and board.poses[1] is None
