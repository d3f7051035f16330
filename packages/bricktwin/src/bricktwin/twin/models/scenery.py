"""Scenery: the objects of a scene in MuJoCo. Marks on the floor are drawn only; robots and
ultrasound hit the others."""

import itertools
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from bricktwin.plans.drawing.pieces import Piece, colour_name
from bricktwin.plans.drawing.shapes import Shape, discs, merge
from bricktwin.plans.geometry import Floats, Triple
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP, draw, yaw_quaternion
from bricktwin.twin.objects import COLORS, Field, Line, Mark, Point, Ramp, Wall
from bricktwin.twin.scene import Scene

LOWEST_MM = 0.6
_LAYER_MM = 0.2
_HIGHEST_MM = 2.4
"""Heights above the floor of the lowest layer of marks, of each further one above the one that it
covers, and of the uppermost at most."""
_RAMP_MM = 8.0
_FRICTION = 0.4
"""Friction of a pushed block, on the floor and against a robot; an estimate for plastic on wood."""


def add_objects(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Add the scene's objects to a model, after the robot."""
    world = spec.worldbody
    _draw_marks(spec, scene.marks)
    for number, solid in enumerate(scene.solids):
        name = f"object_{number}"
        rgb = COLORS[solid.color]
        if isinstance(solid, Wall):
            start = np.array(solid.from_mm) / 1000
            end = np.array(solid.to_mm) / 1000
            (x, y) = ((start + end) / 2).tolist()
            (along_x, along_y) = end - start
            half = [
                float(np.hypot(along_x, along_y)) / 2,
                solid.thickness_mm / 2000,
                solid.height_mm / 2000,
            ]
            add_geom(
                world,
                name,
                [x, y, half[2]],
                half,
                rgb,
                yaw_quaternion(math.atan2(along_y, along_x)),
            )
            continue
        (x, y) = (value / 1000 for value in solid.at_mm)
        yaw = -math.radians(solid.heading_deg)
        # a plate whose upper side rises from the floor to the ramp's height
        if isinstance(solid, Ramp):
            rise = math.atan2(solid.height_mm, solid.length_mm)
            half = [
                math.hypot(solid.length_mm, solid.height_mm) / 2000,
                solid.width_mm / 2000,
                _RAMP_MM / 2000,
            ]
            ahead = half[0] * math.cos(rise) + half[2] * math.sin(rise)
            position = [
                x + ahead * math.cos(yaw),
                y + ahead * math.sin(yaw),
                half[0] * math.sin(rise) - half[2] * math.cos(rise),
            ]
            turn = np.empty(4)
            tilt = np.array([math.cos(rise / 2), 0.0, -math.sin(rise / 2), 0.0])
            mujoco.mju_mulQuat(turn, np.array(yaw_quaternion(yaw)), tilt)
            add_geom(world, name, position, half, rgb, turn.tolist())
            continue
        half = [side / 2000 for side in solid.size_mm]
        position = [x, y, half[2]]
        if solid.mass_g is None:
            add_geom(world, name, position, half, rgb, yaw_quaternion(yaw), is_round=solid.round)
        else:
            body = world.add_body(name=name, pos=position, quat=yaw_quaternion(yaw))
            body.add_freejoint(name=name)
            add_geom(
                body, name, [0.0] * 3, half, rgb, is_round=solid.round, mass_kg=solid.mass_g / 1000
            )


def add_geom(
    body: mujoco.MjsBody,
    name: str,
    position: list[float],
    half: list[float],
    rgb: Triple,
    turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
    *,
    is_round: bool = False,
    mass_kg: float = 0.0,
    friction: float = _FRICTION,
    priority: int = 1,
) -> None:
    """Add an obstacle with half sizes ``half`` (m): a box, or an upright cylinder; one with a mass
    can be pushed."""
    shape = mujoco.mjtGeom.mjGEOM_CYLINDER if is_round else mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(
        name=name,
        type=shape,
        pos=position,
        size=[half[0], half[2], 0.0] if is_round else half,
        quat=list(turn),
        rgba=[*rgb, 1.0],
        mass=mass_kg,
        friction=[friction if mass_kg else 1.0, 0.005, 0.0001],
        priority=priority if mass_kg else 0,
        group=OBSTACLE_GROUP,
        contype=int(mass_kg > 0),
        conaffinity=1,
    )


# ---------------------------------------------------------------- on the floor


def _draw_marks(spec: mujoco.MjSpec, marks: Sequence[Mark]) -> None:
    """Draw marks, the lowest first: a mesh per layer, as a renderer may paint layers in the order
    of their heights. Marks of one color that follow one another share a layer."""
    layers = [
        (color, list(members))
        for color, members in itertools.groupby(marks, lambda mark: mark.color)
    ]
    rise_mm = min(_LAYER_MM, (_HIGHEST_MM - LOWEST_MM) / max(1, len(layers)))
    for number, (color, members) in enumerate(layers):
        shape = merge(
            [_field(mark) if isinstance(mark, Field) else _line(mark) for mark in members]
        )
        piece = Piece(
            ((colour_name(COLORS[color]), shape.at(0.0, 0.0, LOWEST_MM + number * rise_mm)),)
        )
        draw(spec, spec.worldbody, [piece], f"layer_{number}")


def _field(field: Field) -> Shape:
    corners: list[Point] = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
    if field.round:
        corners = [
            (math.cos(math.tau * step / 64), math.sin(math.tau * step / 64)) for step in range(64)
        ]
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
    """Flat mesh of a convex outline ``[n, 2]``, counter-clockwise, with 0.01 mm thickness, as a
    mesh needs a volume."""
    count = len(outline)
    points = np.concatenate(
        [np.column_stack([outline, np.full(count, height)]) for height in (0.005, -0.005)]
    )
    normals = np.repeat([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)], count, axis=0)
    top = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], -1)
    return Shape(points, normals, np.concatenate([top, top[:, ::-1] + count]).astype(np.int32))
