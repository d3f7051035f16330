"""Robot's file for a tab: its description, its scene, and its model as MJCF text for MuJoCo's
JavaScript build.

That build is of another version than Python's, whose binary models it does not read. MuJoCo writes
six digits into a text, so that what is more exact in the compiled model is stored beside it.
"""

from dataclasses import replace
from pathlib import PurePath
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import Robot
from brickhub.robot.spec import with_end_stops
from bricktwin.site.tab.plain_values import plain
from bricktwin.site.tab.robot_file import (
    ANSWERED_MARK,
    GROUP_MARK,
    NAME_MARK,
    SECTIONS,
    TYPE_MARK,
)
from bricktwin.twin.arena import side_by_side
from bricktwin.twin.make_body import lies_on_bench
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.models.load import load_model
from bricktwin.twin.mujoco_arena import arena_model, arena_spec, world_spec
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
_OF_THE_WORLD = ("compiler", "option", "size", "statistic", "visual", "default")
"""Sections of a text that are the same for all robots, or say nothing of them."""
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


def sharing_file(robot: Robot) -> dict[str, Any]:
    """Values for JSON of a robot that shares a world, as ``tab/robot_file.py`` puts it there:
    ``robot`` as plain values, ``sections`` of its MJCF text with marks in them, its number of
    ``motors``, and ``fields``, ``lengths`` and ``heads`` of the compiled model's numbers. Raises
    TwinError if it has no model, does not move about, or its model has what is not put together."""
    arena = side_by_side([robot])
    spec = arena_spec(arena)
    # The parts of a model that is put together have their numbers only then.
    spec.compile()
    compiled = arena_model(arena)
    file = _model_file(compiled, spec)
    root = ElementTree.fromstring(file["mjcf"])  # noqa: S314  our own text
    name = arena.robots[0].name
    sections = {}
    for section in root:
        if section.tag in SECTIONS:
            sections[section.tag] = _marked(section, name)
        elif section.tag not in _OF_THE_WORLD:
            raise TwinError(
                f"the model of robot '{robot.name}' has a section {section.tag}, with which it "
                "shares no world in a tab; take it out"
            )
    return {
        "robot": plain(_without_folders(robot)),
        "sections": sections,
        "motors": len(robot.motors),
        **_numbers(file["mjcf"], file["fields"]),
    }


def _marked(section: ElementTree.Element, name: str) -> str:
    """Text of what is in a section of a robot of that name in an arena, with marks."""
    parts = []
    for number, element in enumerate(section):
        # The world's own geometries are in the world's file.
        if section.tag == "worldbody" and element.tag != "body":
            continue
        for part in element.iter():
            # All of a robot is of its class, which says nothing.
            part.attrib.pop("class", None)
            part.attrib.pop("childclass", None)
            if part.tag == "geom" and part.get("contype", "1") != "0":
                part.set("contype", TYPE_MARK)
                part.set("conaffinity", ANSWERED_MARK)
        if section.tag == "actuator":
            element.set("group", f"{GROUP_MARK}{number}:")
        parts.append(ElementTree.tostring(element, "unicode").strip())
    return "".join(parts).replace(f"{name}/", NAME_MARK)


def world_file(scene: Scene) -> dict[str, Any]:
    """Values for JSON of a scene that robots share, as ``tab/robot_file.py`` puts them there:
    ``scene`` as plain values, ``head`` of the MJCF text, ``sections``, each with what comes before
    the robots and after them, and numbers as of :func:`sharing_file`."""
    spec = world_spec(scene)
    compiled = spec.compile()
    file = _model_file(compiled, spec)
    root = ElementTree.fromstring(file["mjcf"])  # noqa: S314  our own text
    head = ""
    sections = {}
    for section in root:
        if section.tag in SECTIONS:
            before = ""
            after = ""
            for element in section:
                text = ElementTree.tostring(element, "unicode").strip()
                if element.tag == "body":
                    after += text
                else:
                    before += text
            sections[section.tag] = (before, after)
        else:
            head += ElementTree.tostring(section, "unicode").strip()
    return {
        "scene": plain(scene),
        "head": head,
        "sections": sections,
        **_numbers(file["mjcf"], file["fields"]),
    }


def _numbers(mjcf: str, fields: dict[str, list[float]]) -> dict[str, Any]:
    """``fields``, and of all fields in which digits may be lost ``lengths``; ``heads`` says of
    kinds of parts how many are of the world's body, of how many."""
    written = mujoco.MjModel.from_xml_string(mjcf)
    lengths = {}
    for name in dir(written):
        if name.startswith(_FIELDS):
            values = getattr(written, name)
            if values.dtype.kind == "f":
                lengths[name] = values.size
    lengths["eq_data"] = _EQUALITY_NUMBERS * written.neq
    of_world = int((written.geom_bodyid == 0).sum())
    return {
        "fields": fields,
        "lengths": {name: length for name, length in lengths.items() if length},
        "heads": {"body": (1, written.nbody), "geom": (of_world, written.ngeom)},
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
