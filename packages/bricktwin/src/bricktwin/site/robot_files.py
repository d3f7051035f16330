"""Robot's file for a tab: its description, its scene, and its model as MJCF text for MuJoCo's
JavaScript build.

That build is of another version than Python's, whose binary models it does not read. MuJoCo writes
six digits into a text, so that what is more exact in the compiled model is stored beside it.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import Robot
from brickhub.robot.spec import with_end_stops
from bricktwin.site.tab.plain_values import plain
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.make_body import lies_on_bench
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.models.load import load_model
from bricktwin.twin.mujoco_arena import arena_model, arena_spec
from bricktwin.twin.scene import OPEN_FLOOR, Scene

_FIELDS = (
    "body_",
    "jnt_",
    "dof_",
    "geom_",
    "site_",
    "mesh_",
    "pair_",
    "eq_",
    "tendon_",
    "wrap_",
    "actuator_",
    "qpos",
)
"""First letters of the names of the model's fields that a text loses digits of."""
_EQUALITY_NUMBERS = 11
"""Numbers of an equality, ``eq_data``, in the JavaScript build; the Python build has one more, at
the end."""


def robot_file(robot: Robot, scene: Scene = OPEN_FLOOR) -> dict[str, Any]:
    """Values for JSON of a robot in its scene: ``robot`` and ``scene`` as plain values, ``mjcf``,
    and ``fields``, numbers of the compiled model by MuJoCo's names.

    The bodies of its model have the same numbers as those of the robot's model here. Of a model or
    plan that is a file, the description keeps the name, as a path is of no use in a tab.

    Raises:
        TwinError: the robot has no model, or it does not compile.
    """
    robot.check_complete()
    # As in `make_body`: end stops are the robot's alone, whoever gave them.
    robot = with_end_stops(robot, scene.end_stops)
    scene = replace(scene, end_stops={})
    if lies_on_bench(robot, scene):
        raise TwinError(
            f"robot '{robot.name}' lies on the bench and has no model; give it a drive base or a "
            "model, and no readings"
        )
    return {
        "robot": plain(_without_folders(robot)),
        "scene": plain(scene),
        **_model_file(robot_model(robot, scene), load_model(robot, scene)),
    }


def together_file(robots: Sequence[Robot]) -> dict[str, Any]:
    """The same of robots that share a world, side by side: ``robots`` as plain values, ``mjcf`` and
    ``fields``. Raises TwinError if one has no model, or does not move about."""
    arena = side_by_side(robots)
    spec = arena_spec(arena)
    # The parts of a model that is put together have their numbers only then.
    spec.compile()
    return {
        "robots": [plain(_without_folders(robot)) for robot in robots],
        **_model_file(arena_model(arena), spec),
    }


def _model_file(compiled: mujoco.MjModel, spec: mujoco.MjSpec) -> dict[str, Any]:
    """``mjcf`` and ``fields`` of a compiled model and its specification, which is changed."""
    _leave_out_looks(spec)
    _state_inertias(spec, compiled)
    spec.option.jacobian = compiled.opt.jacobian
    slim = spec.compile()
    text = spec.to_xml()
    written = mujoco.MjModel.from_xml_string(text)
    return {"mjcf": text, "fields": _lost_digits(compiled, slim, written)}


def _leave_out_looks(spec: mujoco.MjSpec) -> None:
    """Take out of a model what is only to be seen: a tab draws robots from another file."""
    for geom in list(spec.geoms):
        geom.material = ""
        is_mesh = geom.type == mujoco.mjtGeom.mjGEOM_MESH
        if is_mesh and not _is_touched(spec, geom):
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    unused = [mesh for mesh in spec.meshes if mesh.name not in used]
    for element in (*unused, *spec.materials, *spec.textures, *spec.cameras, *spec.lights):
        spec.delete(element)


def _is_touched(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    """Whether a geometry may touch anything."""
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    return bool(geom.contype or geom.conaffinity) or geom.name in paired


def _state_inertias(spec: mujoco.MjSpec, compiled: mujoco.MjModel) -> None:
    """State the masses and inertias of all bodies as they were compiled: the text would lose those
    of what was left out, and those that MuJoCo derives."""
    for body in spec.bodies:
        number = body.id
        if number == 0:
            # The world, which has none.
            continue
        body.explicitinertial = True
        # Not a number: the inertia is given by its principal moments alone.
        body.fullinertia = [np.nan] * 6
        body.mass = compiled.body_mass[number]
        body.inertia = compiled.body_inertia[number]
        body.ipos = compiled.body_ipos[number]
        body.iquat = compiled.body_iquat[number]


def _lost_digits(
    compiled: mujoco.MjModel,
    slim: mujoco.MjModel,
    written: mujoco.MjModel,
) -> dict[str, list[float]]:
    """Fields of the model that its text does not give to the last digit.

    Args:
        compiled: the robot's model.
        slim: the same without looks, which has the geometries of the text.
        written: what MuJoCo reads in the text.
    """
    lost = {}
    for name in dir(compiled):
        if not name.startswith(_FIELDS):
            continue
        # What MuJoCo derives of a body depends on its looks too.
        model = slim if name.startswith(("geom_", "mesh_")) else compiled
        values = getattr(model, name)
        if values.dtype.kind != "f":
            continue
        if not np.array_equal(values, getattr(written, name), equal_nan=True):
            if name == "eq_data":
                values = values[:, :_EQUALITY_NUMBERS]
            lost[name] = values.ravel().tolist()
    return lost


def _without_folders(robot: Robot) -> Robot:
    """A robot whose files are known by their names."""
    model = None if robot.model is None else PurePath(robot.model).name
    plan = None if robot.plan is None else PurePath(robot.plan).name
    return replace(robot, model=model, plan=plan)
