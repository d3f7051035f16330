"""Scene of a virtual robot: MuJoCo's visible geometry as bodies with meshes, and their poses."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from bricksrl.page.scene import (
    Colour,
    Floats,
    Mesh,
    Scene,
    SceneBody,
    Shape,
    View,
    box,
    capsule,
    cylinder,
    ellipsoid,
    poses,
)
from bricktwin.twin.models.mjcf import SHAPE_GROUP
from bricktwin.twin.mujoco_body import MujocoBody

_GEOM = mujoco.mjtGeom


@dataclass(frozen=True)
class TwinScene:
    """A scene, and the model's body number of each of its bodies."""

    scene: Scene
    bodies: tuple[int, ...]

    def poses(self, data: mujoco.MjData) -> Floats:
        """Poses ``[bodies, 7]`` from ``data``; to be called in the thread that steps it, after ``update_visuals``."""
        indices = list(self.bodies)
        return poses(data.xpos[indices], data.xquat[indices])


def twin_scene(body: MujocoBody) -> TwinScene:
    """Scene of all visible geometry of a twin and its surroundings, except the floor."""
    model = body.model
    shapes: dict[int, list[Shape]] = {}
    meshes: dict[int, Mesh] = {}
    for geom in range(model.ngeom):
        if model.geom_group[geom] == SHAPE_GROUP or model.geom_type[geom] == _GEOM.mjGEOM_PLANE:
            continue
        mesh = _mesh(model, geom, meshes)
        if mesh is not None:
            px, py, pz = model.geom_pos[geom].tolist()
            w, qx, qy, qz = model.geom_quat[geom].tolist()
            pattern = "bricks" if model.geom(geom).name == "wall" else ""
            shape = Shape(mesh, _colour(model, geom), (px, py, pz), (w, qx, qy, qz), pattern)
            shapes.setdefault(int(model.geom_bodyid[geom]), []).append(shape)
    numbers = tuple(sorted(shapes))
    bodies = tuple(SceneBody(model.body(number).name, tuple(shapes[number])) for number in numbers)
    return TwinScene(Scene(bodies, view=_view(model, numbers)), numbers)


def _view(model: mujoco.MjModel, numbers: tuple[int, ...]) -> View:
    if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        chassis = int(model.jnt_bodyid[0])
        return View(follow=numbers.index(chassis) if chassis in numbers else None)
    return View(target=(0.06, 0.0, 0.14), distance_m=0.95, yaw_deg=-50.0)


def _colour(model: mujoco.MjModel, geom: int) -> Colour:
    material = int(model.geom_matid[geom])
    red, green, blue, opacity = (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).tolist()
    return red, green, blue, opacity


def _mesh(model: mujoco.MjModel, geom: int, meshes: dict[int, Mesh]) -> Mesh | None:
    x, y, z = model.geom_size[geom].tolist()
    match model.geom_type[geom]:
        case _GEOM.mjGEOM_MESH:
            number = int(model.geom_dataid[geom])
            if number not in meshes:
                meshes[number] = _triangles(model, number)
            return meshes[number]
        case _GEOM.mjGEOM_BOX:
            return box((x, y, z))
        case _GEOM.mjGEOM_SPHERE:
            return ellipsoid((x, x, x))
        case _GEOM.mjGEOM_ELLIPSOID:
            return ellipsoid((x, y, z))
        case _GEOM.mjGEOM_CAPSULE:
            return capsule(x, y)
        case _GEOM.mjGEOM_CYLINDER:
            return cylinder(x, y)
    return None


def _triangles(model: mujoco.MjModel, mesh: int) -> Mesh:
    """A mesh of the model; a point is repeated for each of its normals, so that sharp edges stay sharp."""
    first = int(model.mesh_faceadr[mesh])
    faces = slice(first, first + int(model.mesh_facenum[mesh]))
    corners = np.stack([model.mesh_face[faces].ravel(), model.mesh_facenormal[faces].ravel()], axis=1)
    corners, index = np.unique(corners, axis=0, return_inverse=True)
    points = model.mesh_vert[int(model.mesh_vertadr[mesh]) + corners[:, 0]]
    normals = model.mesh_normal[int(model.mesh_normaladr[mesh]) + corners[:, 1]]
    return Mesh(points.astype(np.float32), normals.astype(np.float32), index.reshape(-1, 3))
