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
from bricktwin.twin.engines.conventions import OBSTACLE_GROUP, object_name
from bricktwin.twin.engines.rotations import about, product, yaw_quaternion
from bricktwin.twin.models.mjcf import LOOKS, draw
from bricktwin.twin.objects import (
    COLORS,
    Ball,
    Block,
    Field,
    Line,
    Mark,
    Picture,
    Point,
    Ramp,
    Wall,
)
from bricktwin.twin.scene import Scene

LOWEST_MM = 0.6
"""Height above the floor of the lowest layer of marks."""
_LAYER_MM = 0.2
"""Height of each further layer above the one that it covers."""
_HIGHEST_MM = 2.4
"""Height above the floor of the uppermost layer at most."""
_RAMP_MM = 8.0
"""Thickness of a ramp's plate."""
_CORNERS = 64
"""Number of corners of a shape that is drawn as round."""
_FLAT_MM = 0.01
"""Thickness of a mark: a mesh needs a volume."""
_FRICTION = 0.4
"""Friction of a pushed block, on the floor and against a robot; an estimate for plastic on wood."""
_ROLLING_M = 0.001
"""Rolling friction of a ball (its lever, m): 60 g at 0.5 m/s stop within half a metre, as on short
carpet; an estimate."""


def add_objects(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Add the scene's objects to a model, after the robot."""
    _draw_marks(spec, scene.marks)
    world = spec.worldbody
    for number, solid in enumerate(scene.solids):
        name = object_name(number)
        if isinstance(solid, Wall):
            _add_wall(world, name, solid)
        elif isinstance(solid, Ramp):
            _add_ramp(world, name, solid)
        elif isinstance(solid, Ball):
            _add_ball(world, name, solid)
        else:
            _add_block(world, name, solid)


def _add_wall(
    world: mujoco.MjsBody,
    name: str,
    wall: Wall,
) -> None:
    start_m = np.array(wall.from_mm) / 1000
    end_m = np.array(wall.to_mm) / 1000
    x, y = ((start_m + end_m) / 2).tolist()
    along_x, along_y = end_m - start_m
    length_m = float(np.hypot(along_x, along_y))
    half_height_m = wall.height_mm / 2000
    add_geom(
        world,
        name,
        position=[x, y, half_height_m],
        half=[length_m / 2, wall.thickness_mm / 2000, half_height_m],
        rgb=COLORS[wall.color],
        turn=yaw_quaternion(math.atan2(along_y, along_x)),
    )


def _add_ramp(
    world: mujoco.MjsBody,
    name: str,
    ramp: Ramp,
) -> None:
    """Add a plate whose upper side rises from the floor to the ramp's height."""
    x, y = (value / 1000 for value in ramp.at_mm)
    yaw = -math.radians(ramp.heading_deg)
    rise = math.atan2(ramp.height_mm, ramp.length_mm)
    half_length = math.hypot(ramp.length_mm, ramp.height_mm) / 2000
    half_thickness = _RAMP_MM / 2000
    # The middle of the plate lies below the middle of its upper side, at right angles to it.
    cosine = math.cos(rise)
    sine = math.sin(rise)
    ahead = half_length * cosine + half_thickness * sine
    height = half_length * sine - half_thickness * cosine
    x += ahead * math.cos(yaw)
    y += ahead * math.sin(yaw)
    tilt = about((0.0, -1.0, 0.0), rise)
    add_geom(
        world,
        name,
        position=[x, y, height],
        half=[half_length, ramp.width_mm / 2000, half_thickness],
        rgb=COLORS[ramp.color],
        turn=product(yaw_quaternion(yaw), tilt),
    )


def _add_block(
    world: mujoco.MjsBody,
    name: str,
    block: Block,
) -> None:
    x, y = (value / 1000 for value in block.at_mm)
    half = [side / 2000 for side in block.size_mm]
    position = [x, y, half[2]]
    turn = yaw_quaternion(-math.radians(block.heading_deg))
    rgb = COLORS[block.color]
    if block.mass_g is None:
        add_geom(
            world,
            name,
            position,
            half,
            rgb,
            turn,
            is_round=block.round,
        )
        return
    # A reset has to find what can be pushed, so that is a body with a joint whose name says so.
    body = world.add_body(
        name=name,
        pos=position,
        quat=turn,
    )
    body.add_freejoint(name=name)
    add_geom(
        body,
        name,
        [0.0] * 3,
        half,
        rgb,
        is_round=block.round,
        mass_kg=block.mass_g / 1000,
    )


def _add_ball(
    world: mujoco.MjsBody,
    name: str,
    ball: Ball,
) -> None:
    x, y = (value / 1000 for value in ball.at_mm)
    radius_m = ball.diameter_mm / 2000
    body = world.add_body(name=name, pos=[x, y, radius_m])
    # As of a block, by whose name a reset finds it.
    body.add_freejoint(name=name)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius_m, 0.0, 0.0],
        rgba=[*COLORS[ball.color], 1.0],
        mass=ball.mass_g / 1000,
        # Six dimensions: a contact of three has no friction of rolling, and the ball rolls on.
        condim=6,
        friction=[_FRICTION, 0.005, _ROLLING_M],
        priority=1,
        group=OBSTACLE_GROUP,
        contype=1,
        conaffinity=1,
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
    if is_round:
        # MuJoCo takes a cylinder's radius and half of its height.
        shape = mujoco.mjtGeom.mjGEOM_CYLINDER
        size = [half[0], half[2], 0.0]
    else:
        shape = mujoco.mjtGeom.mjGEOM_BOX
        size = half
    # Where two shapes touch, the friction of the higher priority counts: a block's on the floor, a
    # tyre's on a wall. Fixed things collide with robots only, and movable ones with everything.
    sliding = friction if mass_kg else 1.0
    body.add_geom(
        name=name,
        type=shape,
        pos=position,
        size=size,
        quat=list(turn),
        rgba=[*rgb, 1.0],
        mass=mass_kg,
        friction=[sliding, 0.005, 0.0001],
        priority=priority if mass_kg else 0,
        group=OBSTACLE_GROUP,
        contype=int(mass_kg > 0),
        conaffinity=1,
    )


def _draw_marks(spec: mujoco.MjSpec, marks: Sequence[Mark]) -> None:
    """Draw marks, the lowest first, in layers, as a renderer may paint these in the order of their
    heights. Marks of one color that follow one another share a layer, and a mesh."""
    layers = [list(members) for _, members in itertools.groupby(marks, _layer_key)]
    # The more layers there are, the closer they get, because the uppermost must not hide the
    # wheels.
    room_mm = _HIGHEST_MM - LOWEST_MM
    rise_mm = min(_LAYER_MM, room_mm / max(1, len(layers)))
    for number, members in enumerate(layers):
        name = f"layer_{number}"
        height_mm = LOWEST_MM + number * rise_mm
        shapes = []
        color = ""
        for mark in members:
            if isinstance(mark, Picture):
                _draw_picture(spec, name, mark, height_mm)
            else:
                color = mark.color
                shapes.append(_field(mark) if isinstance(mark, Field) else _line(mark))
        if not shapes:
            continue
        shape = merge(shapes).at(0.0, 0.0, height_mm)
        piece = Piece(((colour_name(COLORS[color]), shape),))
        draw(
            spec,
            spec.worldbody,
            [piece],
            name,
        )


def _layer_key(mark: Mark) -> object:
    """What marks of one layer share."""
    return id(mark) if isinstance(mark, Picture) else mark.color


def _draw_picture(
    spec: mujoco.MjSpec,
    name: str,
    picture: Picture,
    height_mm: float,
) -> None:
    """Draw a picture on a plane of its size."""
    texture = spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=picture.columns,
        height=picture.rows,
        nchannel=3,
    )
    texture.data = picture.pixels
    material = spec.add_material(
        name=name,
        specular=0.1,
        shininess=0.1,
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    x, y = (value / 1000 for value in picture.at_mm)
    width_mm, height_of_picture_mm = picture.size_mm
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[x, y, height_mm / 1000],
        quat=yaw_quaternion(-math.radians(picture.heading_deg)),
        size=[width_mm / 2000, height_of_picture_mm / 2000, 0.1],
        material=name,
        mass=0.0,
        **LOOKS,
    )


def _field(field: Field) -> Shape:
    corners: list[Point] = [
        (1.0, 1.0),
        (-1.0, 1.0),
        (-1.0, -1.0),
        (1.0, -1.0),
    ]
    if field.round:
        angles = [math.tau * step / _CORNERS for step in range(_CORNERS)]
        corners = [(math.cos(angle), math.sin(angle)) for angle in angles]
    outline = np.array(corners) * np.array(field.size_mm) / 2
    shape = _flat(outline).turned((0.0, 0.0, 1.0), -field.heading_deg)
    return shape.at(*field.at_mm, 0.0)


def _line(line: Line) -> Shape:
    """Shape of a line: a rectangle per segment, and a disc at each corner."""
    half_width = line.width_mm / 2
    pieces = []
    for x, y in line.points_mm:
        disc = discs(half_width, _FLAT_MM, 24)
        pieces.append(disc.at(x, y, 0.0))
    for start, end in map(np.array, line.segments_mm):
        along = end - start
        # Two equal points make a segment without a direction; the limit avoids dividing by 0.
        length = max(float(np.linalg.norm(along)), 1e-9)
        along_x, along_y = along / length
        side = np.array([-along_y, along_x]) * line.width_mm / 2
        corners = [
            end + side,
            start + side,
            start - side,
            end - side,
        ]
        pieces.append(_flat(np.array(corners)))
    return merge(pieces)


def _flat(outline: Floats) -> Shape:
    """Flat mesh of a convex outline ``[n, 2]``, counter-clockwise, of two sides without edges."""
    count = len(outline)
    heights = np.full(count, _FLAT_MM / 2)
    upper = np.column_stack([outline, heights])
    lower = np.column_stack([outline, -heights])
    points = np.concatenate([upper, lower])  # [2 n, 3]
    up = (0.0, 0.0, 1.0)
    down = (0.0, 0.0, -1.0)
    normals = np.repeat([up, down], count, axis=0)
    # The outline is a fan of triangles around its first corner; seen from below, it goes the other
    # way round.
    first = np.zeros(count - 2, int)
    second = np.arange(1, count - 1)
    third = np.arange(2, count)
    top = np.stack([first, second, third], -1)  # [n - 2, 3]
    bottom = top[:, ::-1] + count
    faces = np.concatenate([top, bottom])
    return Shape(points, normals, faces.astype(np.int32))
