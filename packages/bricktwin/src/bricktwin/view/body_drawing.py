"""Drawing of a body in MuJoCo and of its surroundings."""

import io
from collections.abc import Callable

import mujoco
import numpy as np
from PIL import Image

from bricktwin.plans.drawing import shapes
from bricktwin.twin.engines.conventions import SHAPE_GROUP
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.turning_parts import TurningParts
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.view.drawing_of_body import (
    Drawing,
    DrawnBody,
    Mesh,
    Rod,
    Shape,
    Spinner,
    View,
    box,
    mesh_of,
    rectangle,
)

_GEOM = mujoco.mjtGeom
_ARC = 6  # segments of a quarter of a circle
_SPHERE = shapes.box(
    2.0,
    2.0,
    2.0,
    1.0,
    _ARC,
)
PRIMITIVES: dict[int, Callable[[float, float, float], Mesh]] = {
    _GEOM.mjGEOM_BOX: lambda x, y, z: box((x, y, z)),
    _GEOM.mjGEOM_SPHERE: lambda x, _y, _z: mesh_of(_SPHERE, x),
    _GEOM.mjGEOM_ELLIPSOID: lambda x, y, z: mesh_of(_SPHERE, (x, y, z)),
    _GEOM.mjGEOM_CAPSULE: lambda x, y, _z: mesh_of(
        shapes.box(
            2 * x,
            2 * x,
            2 * (x + y),
            x,
            _ARC,
        )
    ),
    _GEOM.mjGEOM_CYLINDER: lambda x, y, _z: mesh_of(shapes.cylinder(1000 * x, 2000 * y), 0.001),
}
"""Meshes of MuJoCo's geometry by kind, from its size."""


def drawing_of(body: MujocoBody) -> Drawing:
    """Drawing of all visible geometry of a body and its surroundings, except the floor.

    Its bodies are those of the model that have any, by their numbers there.
    """
    return drawing_of_model(body.engine)


def drawing_of_model(engine: MujocoEngine) -> Drawing:
    """The same of a model, which may have no robot."""
    model = engine.model
    shapes_of: dict[int, list[Shape]] = {}
    meshes: dict[int, Mesh] = {}
    for geom in range(model.ngeom):
        # Shapes that are for contacts alone are hidden behind what is drawn.
        if model.geom_group[geom] == SHAPE_GROUP:
            continue
        shape = _shape_of(model, geom, meshes)
        if shape is not None:
            shapes_of.setdefault(int(model.geom_bodyid[geom]), []).append(shape)
    numbers = sorted(shapes_of)
    view = View(
        target=(0.06, 0.0, 0.13),
        distance_m=0.8,
        yaw_deg=-50.0,
    )
    # A robot with a free joint moves about, and the camera with it.
    if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        chassis = int(model.jnt_bodyid[0])
        followed = None
        if chassis in numbers:
            followed = numbers.index(chassis)
        view = View(follow=followed)
    bodies = []
    for number in numbers:
        drawn = DrawnBody(model.body(number).name, tuple(shapes_of[number]), number)
        bodies.append(drawn)
    spinners, rods = _turning(engine)
    return Drawing(
        tuple(bodies),
        view=view,
        spinners=spinners,
        rods=rods,
    )


def _shape_of(
    model: mujoco.MjModel,
    geom: int,
    meshes: dict[int, Mesh],
) -> Shape | None:
    """Shape of a geometry, ``None`` if it is not drawn; ``meshes``: those of the model so far, by
    number."""
    kind = int(model.geom_type[geom])
    material = int(model.geom_matid[geom])
    picture = None
    if kind == _GEOM.mjGEOM_MESH:
        number = int(model.geom_dataid[geom])
        if number not in meshes:
            meshes[number] = _triangles(model, number)
        mesh = meshes[number]
    elif kind in PRIMITIVES:
        mesh = PRIMITIVES[kind](*model.geom_size[geom].tolist())
    elif kind == _GEOM.mjGEOM_PLANE and (picture := _picture(model, material)) is not None:
        half_x_m, half_y_m, _ = model.geom_size[geom].tolist()
        mesh = rectangle(half_x_m, half_y_m)
    else:
        return None
    color = model.geom_rgba[geom]
    # Without a material MuJoCo writes -1, and the geom has the colour itself.
    if material >= 0:
        color = model.mat_rgba[material]
    red, green, blue, opacity = color.tolist()
    px, py, pz = model.geom_pos[geom].tolist()
    w, qx, qy, qz = model.geom_quat[geom].tolist()
    pattern = "bricks" if model.geom(geom).name == "wall" else ""
    return Shape(
        mesh,
        (red, green, blue, opacity),
        (px, py, pz),
        (w, qx, qy, qz),
        pattern,
        picture,
    )


def _triangles(model: mujoco.MjModel, mesh: int) -> Mesh:
    """A mesh of the model; a point is repeated for each of its normals, so that sharp edges stay
    sharp."""
    first = int(model.mesh_faceadr[mesh])
    count = int(model.mesh_facenum[mesh])
    faces = slice(first, first + count)
    # A corner is a point and a normal, by their numbers in the mesh: [3 * faces, 2].
    point_numbers = model.mesh_face[faces].ravel()
    normal_numbers = model.mesh_facenormal[faces].ravel()
    corners = np.stack([point_numbers, normal_numbers], axis=1)
    corners, index = np.unique(corners, axis=0, return_inverse=True)
    first_point = int(model.mesh_vertadr[mesh])
    first_normal = int(model.mesh_normaladr[mesh])
    points = model.mesh_vert[first_point + corners[:, 0]]
    normals = model.mesh_normal[first_normal + corners[:, 1]]
    triangles = index.reshape(-1, 3)
    return Mesh(points.astype(np.float32), normals.astype(np.float32), triangles)


def _picture(model: mujoco.MjModel, material: int) -> bytes | None:
    """PNG file of a material's texture that is stretched over its plane; ``None`` without one, and
    for tiles, which repeat."""
    if material < 0 or model.mat_texuniform[material]:
        return None
    # A material has a slot for each role of a texture; ours use one, and -1 is none.
    texture = int(model.mat_texid[material].max())
    if texture < 0:
        return None
    height = int(model.tex_height[texture])
    width = int(model.tex_width[texture])
    channels = int(model.tex_nchannel[texture])
    first = int(model.tex_adr[texture])
    last = first + height * width * channels
    pixels = model.tex_data[first:last]
    image = pixels.reshape(height, width, channels)
    rgb = np.ascontiguousarray(image[:, :, :3])
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "PNG")
    return file.getvalue()


def _turning(engine: MujocoEngine) -> tuple[tuple[Spinner, ...], tuple[Rod, ...]]:
    """What a model does not turn itself."""
    model = engine.model
    parts = TurningParts(engine)
    spinners = []
    for part in parts.spinners:
        spinner = Spinner(
            part.body,
            parent=int(model.body_parentid[part.body]),
            address=part.address,
            start_rad=float(model.qpos0[part.address]),
            ratio=part.ratio,
            axis=part.axis,
        )
        spinners.append(spinner)
    rods = []
    for part_of_rod in parts.rods:
        parent = int(model.body_parentid[part_of_rod.body])
        rods.append(Rod(part_of_rod.body, parent, part_of_rod.far_site))
    return tuple(spinners), tuple(rods)
