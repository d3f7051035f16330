"""MJCF elements shared by the models: physics options, LEGO's motors as actuators, floor and wall,
cameras. Their names and groups: ``bricktwin.twin.engines.conventions``."""

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.robot import Motor, MotorKind
from bricktwin.plans.drawing.pieces import COLOURS, GLOWING, Piece
from bricktwin.plans.drawing.shapes import Shape, merge
from bricktwin.plans.geometry import Floats, Triple
from bricktwin.twin.engines.conventions import (
    BACKLASH,
    FLOOR_GROUP,
    LOOKS_GROUP,
    OBSTACLE_GROUP,
    SHAPE_GROUP,
    TIMESTEP_S,
    motor_name,
)
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.objects import Ball, Beacon, Block, Field, Lamp, Line, Picture, Ramp, Wall
from bricktwin.twin.scene import Scene

TYRE_FRICTION = 1.0
"""Sliding friction of rubber on a smooth floor; an estimate."""
WALL_X_M = 0.35
"""Position of the wall's face."""
_TURNTABLE_FRICTION_NM = 0.02
"""Dry friction of a turntable under an arm, which would float through its play without; an
estimate: 500 g at 20 mm, 0.2."""
WEBCAM_HEIGHT_M = 0.68
"""Height of the webcam over the table."""
BALL_RADIUS_M = 0.024
_BALL_KG = 0.006
_WALL_HALF_SIZE = (0.012, 1.5, 0.096)
_BRICK = (0.78, 0.16, 0.12)


def new_spec(name: str, scene: Scene) -> mujoco.MjSpec:
    """Model of the surroundings with the physics options of all twins."""
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    set_options(spec)
    add_surroundings(spec, scene)
    return spec


def set_options(spec: mujoco.MjSpec) -> None:
    """Set the physics options of all twins; the timestep of 2.5 ms divides the hub's control loop
    of 5 ms."""
    spec.option.timestep = TIMESTEP_S
    # With this integrator and elliptic cones, a step as long as this is stable.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    # Friction is made stiffer than contacts, because wheels would creep otherwise.
    spec.option.impratio = 5.0


def add_motor(
    spec: mujoco.MjSpec,
    joint: mujoco.MjsJoint,
    port: str,
    kind: MotorKind,
    *,
    gear: float = 1.0,
    train_friction_nm: float = 0.0,
) -> None:
    """Add a voltage-driven motor to a joint. MuJoCo's dcmotor assumes equal motor constants, an
    error of 25 % here.

    Args:
        gear: turns of the motor's shaft per turn of the joint; negative for opposite directions.
        train_friction_nm: dry friction between motor and joint, at the joint.
    """
    motor = motor_constants(kind)
    actuator = spec.add_actuator(
        name=motor_name(port),
        target=joint.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
    )
    # MuJoCo's affine actuator is used as a motor: torque = torque_nm_v * voltage - drag_nm_s *
    # speed.
    actuator.gear[0] = gear
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = motor.torque_nm_v
    actuator.biasprm[2] = -motor.drag_nm_s
    # The hub limits the current, which limits the torque.
    actuator.forcelimited = True
    most_nm = motor.limit_a * motor.torque_nm_a
    actuator.forcerange = [-most_nm, most_nm]
    # Each motor has its own group, so that the body can open the circuit of this motor alone.
    actuator.group = len(spec.actuators) - 1
    # The joint feels the inertia and the friction of the shaft through the gears.
    joint.armature = motor.inertia_kg_m2 * gear**2
    joint.frictionloss = motor.friction_nm * abs(gear) + train_friction_nm
    # With MuJoCo's default, a joint creeps by 3 degrees per second at torques below its friction.
    joint.solimp_friction = [0.999, 0.999, 0.001, 0.5, 2.0]


STIFF = [0.006, 1.0]
"""``solref`` of a hard contact: its time constant (s; 20 ms, MuJoCo's default, lets a robot sink
in) and damping ratio."""
COLLIDING: dict[str, Any] = {"group": SHAPE_GROUP, "contype": 1, "conaffinity": 0}
"""Attributes of the robot's shapes that touch floor and obstacles."""
OBSTACLE: dict[str, Any] = {"group": OBSTACLE_GROUP, "contype": 0, "conaffinity": 1}
"""Attributes of fixed obstacles."""
LOOKS: dict[str, Any] = {"group": LOOKS_GROUP, "contype": 0, "conaffinity": 0}
"""Attributes of visual shapes."""


def add_box(
    body: mujoco.MjsBody,
    middle_mm: Triple | Floats,
    size_mm: Triple,
    mass_kg: float,
    *,
    turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
    collides: bool = True,
) -> None:
    """Add an invisible box with mass; ``turn`` is its quaternion."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[float(value) / 1000 for value in middle_mm],
        size=[side / 2000 for side in size_mm],
        quat=list(turn),
        mass=mass_kg,
        **{**COLLIDING, "contype": int(collides)},
    )


def contact_attributes(friction: float, mass_kg: float = 0.0) -> dict[str, Any]:
    """Attributes of wheels and feet."""
    return {
        "mass": mass_kg,
        "friction": [friction, 0.005, 0.0001],
        "priority": 1,
        "solref": STIFF,
        **COLLIDING,
    }


def add_rotor(
    spec: mujoco.MjSpec,
    parent: mujoco.MjsBody,
    motor: Motor,
    at_m: Triple,
    axis: Triple = (0.0, 1.0, 0.0),
    gear: float = 1.0,
    train_friction_nm: float = 0.0,
) -> mujoco.MjsBody:
    """Add a motor with an almost massless rotor body, which has the joint ``motor_PORT``; see
    :func:`add_motor`."""
    rotor = parent.add_body(name=f"rotor_{motor.port}", pos=list(at_m))
    shaft = rotor.add_joint(
        name=motor_name(motor.port),
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=list(axis),
    )
    # The joint's armature already holds the rotor's inertia, so the body adds almost none.
    rotor.explicitinertial = True
    rotor.mass = 0.002
    rotor.inertia = [1e-7, 1e-7, 1e-7]
    add_motor(
        spec,
        shaft,
        motor.port,
        motor.kind,
        gear=gear,
        train_friction_nm=train_friction_nm,
    )
    return rotor


def add_driven(
    rotor: mujoco.MjsBody,
    name: str,
    port: str,
    axis: Triple,
    *,
    is_heavy: bool = False,
) -> mujoco.MjsBody:
    """Add a body to a rotor, with backlash; that of a heavy body is softer and more damped."""
    is_turntable = is_heavy and abs(axis[2]) > 0.9
    body = rotor.add_body(name=name)
    # This range is a placeholder: the twin's physics sets it.
    body.add_joint(
        name=f"{BACKLASH}{port}",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=list(axis),
        limited=True,
        range=[-0.05, 0.05],
        damping=4e-3 if is_heavy else 5e-4,
        frictionloss=_TURNTABLE_FRICTION_NM if is_turntable else 0.0,
        solref_limit=[0.010 if is_heavy else 0.005, 1.0],
    )
    return body


def add_tyre(
    body: mujoco.MjsBody,
    name: str,
    size_m: Triple,
    mass_kg: float = 0.0,
    at_m: Triple | Floats = (0.0, 0.0, 0.0),
    turn: Sequence[float] | Floats = (1.0, 0.0, 0.0, 0.0),
) -> None:
    """Add a tyre with these half sizes. An ellipsoid touches in one point, which takes the solver
    half the time of a cylinder."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=list(size_m),
        pos=list(at_m),
        quat=list(turn),
        **contact_attributes(TYRE_FRICTION, mass_kg),
    )


def add_caster(
    body: mujoco.MjsBody,
    name: str,
    centre_m: Triple | Floats,
    radius_m: float,
    mass_kg: float = 0.0,
) -> None:
    """Add a ball caster without friction. (Dry friction of a sliding ball would make the contact
    chatter.)"""
    # The contact has one dimension, so it pushes without friction.
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=list(centre_m),
        size=[radius_m, 0, 0],
        condim=1,
        **contact_attributes(1.0, mass_kg),
    )


def add_surroundings(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Add floor, wall, sky, and the fixed camera."""
    _add_looks(spec)
    world = spec.worldbody
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],
        material="floor",
        group=FLOOR_GROUP,
        contype=0,
        conaffinity=1,
    )
    target: Triple = (0.0, 0.0, 0.0)
    distance_m = 1.1
    if scene.wall_distance_mm is not None:
        _add_wall(world)
        # A robot starts before the wall, at any distance up to the largest that it can measure.
        target = (-0.62, 0.1, 0.0)
        distance_m = 1.95
    if scene.objects:
        target, distance_m = overview_of(scene)
    add_camera(
        world,
        "overview",
        target,
        (-0.18, -1.0, 0.72),
        distance_m,
    )


def _add_wall(world: mujoco.MjsBody) -> None:
    """Add the wall ahead of the robot."""
    half_thickness, half_width, half_height = _WALL_HALF_SIZE
    # Nothing pushes the wall, but somebody at the page can move a mocap body.
    wall = world.add_body(
        name="wall",
        mocap=True,
        pos=[WALL_X_M + half_thickness, 0.0, half_height],
    )
    wall.add_geom(
        name="wall",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=list(_WALL_HALF_SIZE),
        rgba=[*_BRICK, 1.0],
        mass=0.0,
        **OBSTACLE,
    )
    # A box would stretch its texture over each side, so a plane in front of it repeats the texture.
    wall.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[-half_thickness - 0.0005, 0.0, 0.0],
        size=[half_width, half_height, 0.1],
        quat=[0.5, -0.5, -0.5, 0.5],
        material="bricks",
        **LOOKS,
    )


def overview_of(scene: Scene) -> tuple[Triple, float]:
    """Centre of the objects and the robot's start area (m), and a camera distance that shows all of
    them."""
    points_mm = list(zip(*scene.start_mm, strict=True))
    for item in scene.objects:
        match item:
            case Line():
                points_mm += item.points_mm
            case Wall():
                points_mm += [item.from_mm, item.to_mm]
            case Lamp() | Beacon():
                points_mm.append(item.at_mm[:2])
            case Field() | Picture() | Block() | Ball() | Ramp():
                # The reach must hold for any heading: a ramp lies on one side of its place,
                # everything else lies around it.
                if isinstance(item, Ramp):
                    reach = item.length_mm
                elif isinstance(item, Ball):
                    reach = item.diameter_mm / 2
                else:
                    reach = max(item.size_mm[:2]) / 2
                x_mm, y_mm = item.at_mm
                points_mm.append((x_mm - reach, y_mm - reach))
                points_mm.append((x_mm + reach, y_mm + reach))
    points = np.array(points_mm) / 1000
    low = points.min(0)
    high = points.max(0)
    x, y = ((low + high) / 2).tolist()
    diagonal = float(np.linalg.norm(high - low))
    return (x, y, 0.0), max(1.1, 1.25 * diagonal)


def pair_contacts(spec: mujoco.MjSpec) -> None:
    """List explicit contact pairs, after everything is added: each shape of the robot with each of
    the surroundings.

    MuJoCo then checks these pairs only. Its own broad phase would take a tenth of the time of each
    step.
    """
    surroundings = [geom for geom in spec.geoms if geom.conaffinity]
    shapes = [geom for geom in spec.geoms if geom.contype]
    for number, shape in enumerate(shapes):
        shape.name = shape.name or f"shape_{number}"
        for other in surroundings:
            pair = spec.add_pair(geomname1=other.name, geomname2=shape.name)
            # A pair has to state MuJoCo's own rule: the shape with the higher priority decides.
            pair.condim = max(shape.condim, other.condim)
            if shape.priority > other.priority:
                pair.condim = shape.condim
            # With NaN, MuJoCo derives these values from the two geoms, as it does without an
            # explicit pair.
            pair.friction = [math.nan] * 5
            pair.solref = [math.nan] * 2
            pair.solimp = [math.nan] * 5
    # Without bits only explicit pairs touch.
    for geom in (*surroundings, *shapes):
        geom.contype = 0
        geom.conaffinity = 0


def add_camera(
    body: mujoco.MjsBody,
    name: str,
    target: Triple,
    direction: Triple,
    distance_m: float,
) -> None:
    """Add a camera that looks at a point of a body's frame from a direction; on a moving body it
    follows without turning."""
    # MuJoCo's cameras look along -z, so their axes point to the right, up, and away from what they
    # see. The horizon stays level.
    backward = np.array(direction) / np.linalg.norm(direction)
    right = np.cross((0.0, 0.0, 1.0), backward)
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)
    axes = np.column_stack([right, up, backward])
    frame = np.empty(4)
    mujoco.mju_mat2Quat(frame, axes.ravel())
    mode = mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    if body.name != "world":
        mode = mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    position = np.array(target) + distance_m * backward
    body.add_camera(
        name=name,
        pos=position.tolist(),
        quat=frame.tolist(),
        fovy=40,
        mode=mode,
    )


def add_webcam(world: mujoco.MjsBody) -> None:
    """Add the camera of the RoboArm's camera task, which looks down. Its image has the robot's
    front at the bottom and its left on the right."""
    world.add_camera(
        name="webcam",
        pos=[0.0, 0.0, WEBCAM_HEIGHT_M],
        xyaxes=[0, 1, 0, -1, 0, 0],
        fovy=45,
    )


def add_ball(body: mujoco.MjsBody, at_m: Triple) -> None:
    """Add the red ball that a gripper holds."""
    # The ball collides with nothing, because the gripper holds it come what may.
    body.add_geom(
        name="ball",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=list(at_m),
        size=[BALL_RADIUS_M, 0, 0],
        mass=_BALL_KG,
        material="red",
        **LOOKS,
    )


def quaternion(axis: Triple | Floats, angle: float) -> list[float]:
    """Quaternion of a rotation about an axis, in radians."""
    imaginary = math.sin(angle / 2) * np.array(axis)
    return [math.cos(angle / 2), *imaginary.tolist()]


def add_light(body: mujoco.MjsBody) -> None:
    """Add the sun, which follows the robot, because shadows are drawn only near the centre of its
    beam."""
    direction = np.array([0.3, 0.4, -0.85])
    body.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=(-0.8 * direction).tolist(),
        dir=direction.tolist(),
        diffuse=[0.55] * 3,
        specular=[0.3] * 3,
        castshadow=True,
    )


def _add_looks(spec: mujoco.MjSpec) -> None:
    """Add sky, light, and the materials of floor and wall."""
    visual = spec.visual
    visual.map.znear = 0.02
    visual.map.zfar = 30.0
    visual.map.shadowclip = 4.0
    visual.quality.shadowsize = 4096
    visual.headlight.ambient = [0.38] * 3
    visual.headlight.diffuse = [0.30] * 3
    visual.headlight.specular = [0.1] * 3
    spec.stat.extent = 0.5
    spec.stat.center = [0.0, 0.0, 0.05]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.96, 0.97, 0.98],
        rgb2=[0.72, 0.80, 0.88],
        width=64,
        height=64,
    )
    _add_tiles(
        spec,
        "floor",
        _floor_tile(),
        (0.2, 0.2),
    )
    _add_tiles(
        spec,
        "bricks",
        _brick_tile(),
        (0.128, 0.064),
    )


def _add_tiles(
    spec: mujoco.MjSpec,
    name: str,
    image: NDArray[np.uint8],
    size_m: tuple[float, float],
) -> None:
    """Add a material that repeats an image of this size."""
    height, width, channels = image.shape
    texture = spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=width,
        height=height,
        nchannel=channels,
    )
    texture.data = image.tobytes()
    material = spec.add_material(
        name=name,
        texuniform=True,
        texrepeat=[1 / size_m[0], 1 / size_m[1]],
        specular=0.1,
        shininess=0.1,
        reflectance=0.0,
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name


def _floor_tile() -> NDArray[np.uint8]:
    """Floor texture of 2 x 2 squares of 100 mm in two light greys, separated by fine lines, which
    makes motion visible."""
    index = np.arange(256) // 128
    is_even = (index[:, None] + index) % 2 == 0
    tone = np.where(is_even, 214, 204)
    line = np.arange(256) % 128 < 1
    tone[line, :] = 186
    tone[:, line] = 186
    # A little blue keeps the grey from looking warm.
    image = np.stack([tone, tone + 2, tone + 5], axis=-1)
    return image.astype(np.uint8)


def _brick_tile() -> NDArray[np.uint8]:
    """Wall texture of two staggered courses of bricks."""
    rows = np.arange(64)[:, None]
    columns = np.arange(128)[None, :]
    # Every second course is shifted by half a brick, as in a real wall; bricks are 64 x 32 pixels.
    shift = np.where(rows < 32, 0, 32)
    bed_joint = rows % 32 < 2
    head_joint = (columns + shift) % 64 < 2
    joint = bed_joint | head_joint
    # One edge of each brick is lighter, which makes it look raised.
    light = (rows % 32 > 29) & ~joint
    tile = np.empty((64, 128, 3))
    tile[:] = np.array(_BRICK) * 255
    tile[joint] *= 0.62
    tile[light] = np.minimum(tile[light] * 1.18, 255)
    return tile.astype(np.uint8)


def add_colours(spec: mujoco.MjSpec) -> None:
    """Add materials for all colours."""
    for name, rgb in COLOURS.items():
        spec.add_material(
            name=name,
            rgba=[*rgb, 1.0],
            specular=0.35,
            shininess=0.5,
            emission=0.6 if name in GLOWING else 0.0,
        )


def draw(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    parts: Sequence[Piece],
    name: str = "",
) -> None:
    """Draw parts, given in millimetres in the body's frame: one mesh per colour, without mass or
    contact.

    The model's materials have the names of the colours; the material of a colour ``"#rrggbbaa"`` is
    created here.

    Args:
        name: first part of the meshes' names, unique in the model; by default the body's.
    """
    by_colour: dict[str, list[Shape]] = {}
    for part in parts:
        for colour, shape in part.shapes:
            by_colour.setdefault(colour, []).append(shape)
    for colour, shapes in by_colour.items():
        if colour.startswith("#") and spec.material(colour) is None:
            rgba = [value / 255 for value in bytes.fromhex(colour[1:])]
            spec.add_material(
                name=colour,
                rgba=rgba,
                specular=0.35,
                shininess=0.5,
            )
        shape = merge(shapes)
        mesh_name = f"{name or body.name}_{colour}"
        points_m = shape.points / 1000
        # Points have one normal each, so the faces use the same indices for both.
        faces = shape.faces.ravel().tolist()
        spec.add_mesh(
            name=mesh_name,
            uservert=points_m.ravel().tolist(),
            usernormal=shape.normals.ravel().tolist(),
            userface=faces,
            userfacenormal=faces,
            # A drawing may be an open surface, and MuJoCo refuses an open solid.
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh_name,
            material=colour,
            mass=0,
            **LOOKS,
        )
