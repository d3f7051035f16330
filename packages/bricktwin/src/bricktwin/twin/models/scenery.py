"""Scenery: the objects of a scene in MuJoCo. Marks on the floor are drawn only; robots and ultrasound hit the others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats, Triple
from bricktwin.twin.models.lego import Piece, Shape, colour_name, discs, draw, merge
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP, yaw_quaternion
from bricktwin.twin.objects import COLORS, Block, Field, Line, Mark, Point, Ramp, Wall
from bricktwin.twin.scene import Scene

_LAYER_MM = 0.2
"""Height of each mark on the floor above the previous one, which it covers."""
_RAMP_MM = 8.0
_FRICTION = 0.4
"""Friction of a pushed block, on the floor and against a robot; an estimate for plastic on wood."""


def add_objects(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Add the scene's objects to a model, after the robot."""
    solids = [item for item in scene.objects if isinstance(item, (Wall, Block, Ramp))]
    world = spec.worldbody
    marks = [item for item in scene.objects if isinstance(item, (Line, Field))]
    if marks:
        draw(spec, world, [_mark_part(mark, (number + 1) * _LAYER_MM) for number, mark in enumerate(marks)])
    for number, solid in enumerate(solids):
        name = f"object_{number}"
        if isinstance(solid, Wall):
            _add_wall(world, name, solid)
        elif isinstance(solid, Ramp):
            _add_ramp(world, name, solid)
        else:
            _add_block(world, name, solid)


def _add_wall(world: mujoco.MjsBody, name: str, wall: Wall) -> None:
    start, end = np.array(wall.from_mm) / 1000, np.array(wall.to_mm) / 1000
    (x, y), (along_x, along_y) = (start + end) / 2, end - start
    half = [float(np.hypot(along_x, along_y)) / 2, wall.thickness_mm / 2000, wall.height_mm / 2000]
    add_geom(world, name, [float(x), float(y), half[2]], half, COLORS[wall.color], yaw_quaternion(math.atan2(along_y, along_x)))


def _add_ramp(world: mujoco.MjsBody, name: str, ramp: Ramp) -> None:
    """Add a plate whose upper side rises from the floor to the ramp's height."""
    rise, yaw = math.atan2(ramp.height_mm, ramp.length_mm), -math.radians(ramp.heading_deg)
    half_length, half_thickness = math.hypot(ramp.length_mm, ramp.height_mm) / 2000, _RAMP_MM / 2000
    ahead = half_length * math.cos(rise) + half_thickness * math.sin(rise)
    up = half_length * math.sin(rise) - half_thickness * math.cos(rise)
    x, y = ramp.at_mm[0] / 1000 + ahead * math.cos(yaw), ramp.at_mm[1] / 1000 + ahead * math.sin(yaw)
    tilt, quaternion = np.array([math.cos(rise / 2), 0.0, -math.sin(rise / 2), 0.0]), np.empty(4)
    mujoco.mju_mulQuat(quaternion, np.array(yaw_quaternion(yaw)), tilt)
    add_geom(
        world, name, [x, y, up], [half_length, ramp.width_mm / 2000, half_thickness], COLORS[ramp.color], quaternion.tolist()
    )


def _add_block(world: mujoco.MjsBody, name: str, block: Block) -> None:
    half = [side / 2000 for side in block.size_mm]
    position = [block.at_mm[0] / 1000, block.at_mm[1] / 1000, half[2]]
    quaternion = yaw_quaternion(-math.radians(block.heading_deg))
    if block.mass_g is None:
        add_geom(world, name, position, half, COLORS[block.color], quaternion, is_round=block.round)
        return
    body = world.add_body(name=name, pos=position, quat=quaternion)
    body.add_freejoint(name=name)
    add_geom(body, name, [0.0] * 3, half, COLORS[block.color], is_round=block.round, mass_kg=block.mass_g / 1000)


def add_geom(
    body: mujoco.MjsBody,
    name: str,
    position: list[float],
    half: list[float],
    rgb: Triple,
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
    *,
    is_round: bool = False,
    mass_kg: float = 0.0,
    friction: float = _FRICTION,
    priority: int = 1,
) -> None:
    """Add an obstacle with half sizes ``half`` (m): a box, or an upright cylinder; one with a mass can be pushed."""
    shape = mujoco.mjtGeom.mjGEOM_CYLINDER if is_round else mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(
        name=name,
        type=shape,
        pos=position,
        size=[half[0], half[2], 0.0] if is_round else half,
        quat=list(quaternion),
        rgba=[*rgb, 1.0],
        mass=mass_kg,
        friction=[friction if mass_kg else 1.0, 0.005, 0.0001],
        priority=priority if mass_kg else 0,
        group=OBSTACLE_GROUP,
        contype=int(mass_kg > 0),
        conaffinity=1,
    )


# ---------------------------------------------------------------- on the floor


def _mark_part(mark: Mark, height_mm: float) -> Piece:
    shape = _field(mark) if isinstance(mark, Field) else _line(mark)
    return Piece(((colour_name(COLORS[mark.color]), shape.at(0.0, 0.0, height_mm)),))


def _field(field: Field) -> Shape:
    corners: list[Point] = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
    if field.round:
        corners = [(math.cos(math.tau * step / 64), math.sin(math.tau * step / 64)) for step in range(64)]
    outline = np.array(corners) * np.array(field.size_mm) / 2
    return _flat(outline).turned((0.0, 0.0, 1.0), -field.heading_deg).at(*field.at_mm, 0.0)


def _line(line: Line) -> Shape:
    """Shape of a line: a rectangle per segment, and a disc at each corner."""
    pieces = [discs(line.width_mm / 2, 0.01, 24).at(x, y, 0.0) for x, y in line.points_mm]
    for start, end in zip(*line.ends_mm, strict=True):
        direction = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        side = np.array([-direction[1], direction[0]]) * line.width_mm / 2
        pieces.append(_flat(np.array([end + side, start + side, start - side, end - side])))
    return merge(pieces)


def _flat(outline: Floats) -> Shape:
    """Flat mesh of a convex outline ``[n, 2]``, counter-clockwise, with 0.01 mm thickness, as a mesh needs a volume."""
    count = len(outline)
    points = np.concatenate([np.column_stack([outline, np.full(count, height)]) for height in (0.005, -0.005)])
    normals = np.repeat([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)], count, axis=0)
    top = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], -1)
    return Shape(points, normals, np.concatenate([top, top[:, ::-1] + count]).astype(np.int32))
