"""Looks of a plan's parts: our meshes or those of an installed LDraw library, and shafts that turn visually only."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import TwinError
from bricksrl.plans.colours import colour_of
from bricksrl.plans.mechanism.kinematics import TO_TWIN
from bricksrl.plans.part import DeviceKind, Part
from bricksrl.plans.plan import Placed, Plan
from bricksrl.plans.planned_robot import PlannedRobot
from bricksrl.plans.shapes import COARSE, Tint, surface_of
from bricksrl.twin import ldraw
from bricksrl.twin.models import meshes
from bricksrl.twin.models.looks import shape_of
from bricksrl.twin.models.meshes import Shape

Floats = NDArray[np.float64]
_MM = 0.4
_TINTS = {Tint.DARK: "#292b30ff", Tint.TURNING: "#737880ff", Tint.FACE: "#1a1c21ff"}
_PREFIX = "spin_"


def draw_parts(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    plan: Plan,
    parts: Iterable[int],
    origin_m: Floats,
    *,
    axes: Floats | None = None,
    shafts: Iterable[int] = (),
) -> None:
    """Draw parts of a plan on a body, without mass or contact.

    Args:
        parts: indices of the parts.
        origin_m: the body's origin [3] in the twin's axes.
        axes: the body's axes as rows [3, 3]; by default the twin's.
        shafts: indices of motors of which only the turning output is drawn; it is left out otherwise.
    """
    frame = (np.eye(3) if axes is None else axes) @ TO_TWIN
    shift = (np.eye(3) if axes is None else axes) @ origin_m * 1000
    drawn: list[tuple[str, Shape]] = []
    for index, is_shaft in [*((part, False) for part in parts), *((motor, True) for motor in shafts)]:
        placed = plan.parts[index]
        turn = frame @ placed.rotation
        for colour, shape in _shapes(placed, only_turning=is_shaft):
            points = (shape.points @ turn.T + frame @ placed.position) * _MM - shift
            drawn.append((colour, Shape(points, shape.normals @ turn.T, shape.faces)))
    if drawn:
        meshes.draw(spec, body, [meshes.Part(tuple(drawn))])


def _shapes(placed: Placed, *, only_turning: bool) -> list[tuple[str, Shape]]:
    """Coloured shapes of a part in its frame, in LDraw units."""
    main = "#" + "".join(f"{round(255 * value):02x}" for value in colour_of(placed.colour).rgb) + "ff"
    if not only_turning and (root := ldraw.folder()) is not None and (theirs := _of_library(placed.part.number, root)):
        return [(colour or main, shape) for colour, shape in theirs]
    device = placed.part.device
    is_motor = device is not None and device.kind is DeviceKind.MOTOR
    ours = _of_catalogue(placed.part).items()
    return [(_TINTS.get(tint, main), one) for tint, one in ours if not is_motor or only_turning is (tint is Tint.TURNING)]


@functools.lru_cache(maxsize=512)
def _of_catalogue(part: Part) -> dict[Tint, Shape]:
    """Our shapes of a part."""
    surface = surface_of(part, COARSE)
    found = {tint: shape_of(surface.triangles[surface.tints == int(tint)]) for tint in Tint}
    return {tint: shape for tint, shape in found.items() if shape is not None}


@functools.lru_cache(maxsize=256)
def _of_library(number: str, root: Path) -> list[tuple[str, Shape]]:
    """Shapes of a part in an LDraw library by colour, "" for its main colour; empty if it has none."""
    library = ldraw.library(root)
    try:
        triangles = library.part(f"{number}.dat")
    except TwinError:
        return []
    hexed = {code: "#" + "".join(f"{round(255 * value):02x}" for value in library.rgba(code)) for code in triangles}
    shapes = {code: shape_of(faces) for code, faces in triangles.items()}
    return [("" if code == ldraw.MAIN_COLOUR else hexed[code], shape) for code, shape in shapes.items() if shape is not None]


def draw_spinners(
    spec: mujoco.MjSpec, planned: PlannedRobot, bodies: dict[int, mujoco.MjsBody], origins: dict[int, Floats]
) -> None:
    """Draw shafts and gears that turn visually only: massless bodies, and their ratio and axis as numerics of the model."""
    for number, one in enumerate(planned.articulation.followers):
        if one.body not in bodies:
            continue
        name = f"{_PREFIX}{one.port}_{number}"
        body = bodies[one.body].add_body(name=name, pos=(one.point_m - origins[one.body]).tolist())
        draw_parts(spec, body, planned.plan, one.parts, one.point_m)
        spec.add_numeric(name=name, size=4, data=[one.ratio, *(-one.axis).tolist()])


class Spinners:
    """Shafts and gears of a model that turn visually only."""

    def __init__(self, model: mujoco.MjModel) -> None:
        names = {body: str(model.body(body).name) for body in range(model.nbody)}
        self._spun = [(body, name, model.numeric(name).data.copy()) for body, name in names.items() if name.startswith(_PREFIX)]

    def turn(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Turn each with its motor's joint; positions must be up to date, and are so afterwards."""
        if not self._spun:
            return
        for body, name, (ratio, *axis) in self._spun:
            joint = model.joint(f"motor_{name.split('_')[1]}")
            address = int(joint.qposadr[0])
            angle = float(ratio * (data.qpos[address] - model.qpos0[address]))
            mujoco.mju_axisAngle2Quat(model.body_quat[body], np.array(axis), angle)
        mujoco.mj_kinematics(model, data)
