"""Bindings of a robot's body to a model: where its motors, sensors and base are.

All names are looked up once, when the body is made; what is read in each step are indices. In an
arena several robots share one model, and the names of each begin with its ``prefix``, ``"ROBOT/"``.
"""

import math
from dataclasses import dataclass

from brickhub.errors import TwinError
from brickhub.robot import Robot, Sense, Sensor, SensorKind
from bricktwin.twin.engines.conventions import (
    BACKLASH,
    FOOT,
    OBSTACLE_GROUP,
    SHAPE_GROUP,
    motor_name,
    object_name,
    site_name,
)
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import Vector, rotated, vector
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import WorldSenses
from bricktwin.twin.stance import Feet

_CONES_DEG = {
    SensorKind.ULTRASONIC: (12.0, 0.0),
    SensorKind.EV3_ULTRASONIC: (15.0, 15.0),
    # In this light a floor is as good as a wall, so that only a level ray tells what is ahead.
    SensorKind.EV3_INFRARED: (15.0, 0.0),
}
"""Largest angles of a sensor's rays to where it looks, to a side and up or down; estimates. Other
sensors have one ray."""
_RAY_SHARES = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Directions of rays as shares of such an angle."""
_FREE = 0
"""MuJoCo's number of a joint that moves freely (``mjtJoint``)."""


@dataclass(frozen=True, slots=True)
class Root:
    """First body of a robot, and how it is joined to the world.

    Attributes:
        body: its index.
        is_free: whether it moves freely; else it is fixed.
        address, dof: of the first position and the first velocity of its joint; of a fixed body
            those of its first motor.
        feet: what the robot may stand on; ``None`` for wheels, and where its stance is kept.
    """

    body: int
    is_free: bool
    address: int
    dof: int
    feet: Feet | None


def bind_root(engine: Engine, prefix: str) -> Root:
    """The first body of a robot."""
    joint = 0
    if prefix:
        # Alone, the robot's joints are the first; in an arena only names tell whose they are.
        chassis = engine.index("body", f"{prefix}chassis")
        joint = engine.indices("body_jntadr")[chassis]
    names = engine.names("geom")
    feet = [geom for geom, name in enumerate(names) if name.startswith(FOOT)]
    # Nothing stands on one foot; in an arena a robot keeps the stance in which it has settled.
    derives_stance = len(feet) > 1 and not prefix
    return Root(
        body=engine.indices("jnt_bodyid")[joint],
        is_free=engine.indices("jnt_type")[joint] == _FREE,
        address=engine.indices("jnt_qposadr")[joint],
        dof=engine.indices("jnt_dofadr")[joint],
        feet=Feet(engine, feet) if derives_stance else None,
    )


@dataclass(frozen=True, slots=True)
class Motors:
    """Motors of a robot.

    Attributes:
        terminals: index of the actuator, and the bit of its circuit in the engine's
            ``open_circuits``, by port.
        shafts: address of the joint's position, and millidegrees of the shaft for a radian there,
            by port.
        amperes: index of the actuator, and current for a torque, of each motor.
        joints: index of each motor's joint, by port.
        dofs: degree of freedom of each motor's joint.
        plays: index of the joint of each motor's play, and its play as a share of that of a SPIKE
            motor.
        tyres: geometries of the drive base's tyres, left and right, if it has such.
    """

    terminals: dict[str, tuple[int, int]]
    shafts: dict[str, tuple[int, float]]
    amperes: list[tuple[int, float]]
    joints: dict[str, int]
    dofs: list[int]
    plays: list[tuple[int, float]]
    tyres: list[int]


def bind_motors(
    engine: Engine,
    robot: Robot,
    prefix: str,
) -> Motors:
    """The motors of a robot, in the order of its description. Raises TwinError if the model has no
    joint or actuator for one."""
    terminals = {}
    shafts = {}
    amperes = []
    joints = {}
    dofs = []
    plays = []
    groups = engine.indices("actuator_group")
    # Six numbers each, of which a hinge has the first.
    gears = engine.nominal("actuator_gear")
    addresses = engine.indices("jnt_qposadr")
    first_dofs = engine.indices("jnt_dofadr")
    for motor in robot.motors:
        name = f"{prefix}{motor_name(motor.port)}"
        joint = engine.index("joint", name)
        actuator = engine.index("actuator", name)
        if joint < 0 or actuator < 0:
            raise TwinError(
                f"the model of robot '{robot.name}' has no motor '{motor.name}' (a joint and an "
                f"actuator '{name}'); give it both"
            )
        terminals[motor.port] = (actuator, 1 << groups[actuator])
        mdeg_per_rad = gears[6 * actuator] * math.degrees(1000.0)
        shafts[motor.port] = (addresses[joint], mdeg_per_rad)
        constants = motor_constants(motor.kind)
        amperes.append((actuator, 1.0 / constants.torque_nm_a))
        joints[motor.port] = joint
        dofs.append(first_dofs[joint])
        play = engine.index("joint", f"{prefix}{BACKLASH}{motor.port}")
        # A model of the user may have no play.
        if play >= 0:
            plays.append((play, constants.play_share))
    return Motors(
        terminals=terminals,
        shafts=shafts,
        amperes=amperes,
        joints=joints,
        dofs=dofs,
        plays=plays,
        tyres=_tyres(engine, robot, prefix),
    )


def _tyres(
    engine: Engine,
    robot: Robot,
    prefix: str,
) -> list[int]:
    """Geometries of the drive base's tyres, left and right; empty if there are none."""
    base = robot.drive_base
    if base is None:
        return []
    tyres = []
    for name in (base.left, base.right):
        tyre = f"{prefix}tyre_{robot.motor(name).port}"
        tyres.append(engine.index("geom", tyre))
    # A model of the user may have other names.
    return tyres if min(tyres) >= 0 else []


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of a robot, by port. Positions and directions are in the frame of the robot's first
    body.

    Attributes:
        kinds: of those that sense anything.
        gazes: position of each, and where it looks.
        lefts: direction to the left of each.
        rays: directions of the rays of each.
        ranges_mm: least and largest distance of each ultrasonic sensor.
        forces: address of what a force sensor feels (N) in the engine's ``sensordata``.
        echoing_groups: geometry groups that throw sound back.
        silent_body: body that sound passes through; -1 for none.
        soft_geoms: geometries of the scene that scatter sound.
        world: what can be seen from a place.
    """

    kinds: dict[str, SensorKind]
    gazes: dict[str, tuple[Vector, Vector]]
    lefts: dict[str, Vector]
    rays: dict[str, list[Vector]]
    ranges_mm: dict[str, tuple[int, int]]
    forces: dict[str, int]
    echoing_groups: tuple[int, ...]
    silent_body: int
    soft_geoms: set[int]
    world: WorldSenses


def bind_sensors(
    engine: Engine,
    robot: Robot,
    scene: Scene,
    root: Root,
    prefix: str,
) -> Sensors:
    """The sensors of a robot. Raises TwinError if the model has no place for one."""
    kinds: dict[str, SensorKind] = {}
    gazes: dict[str, tuple[Vector, Vector]] = {}
    lefts: dict[str, Vector] = {}
    rays: dict[str, list[Vector]] = {}
    ranges_mm: dict[str, tuple[int, int]] = {}
    forces: dict[str, int] = {}
    for sensor in robot.sensors:
        kind = sensor.kind
        if not kind.model.senses:
            continue
        site = _site(engine, robot, sensor, prefix)
        position_m = vector(engine.nominal("site_pos")[3 * site : 3 * site + 3])
        turn = engine.nominal("site_quat")[4 * site : 4 * site + 4]
        kinds[sensor.port] = kind
        # Sensors look along their x axes.
        gazes[sensor.port] = (position_m, rotated((1.0, 0.0, 0.0), turn))
        lefts[sensor.port] = rotated((0.0, 1.0, 0.0), turn)
        rays[sensor.port] = [rotated(ray, turn) for ray in _cone(kind)]
        if kind.model.range_mm is not None:
            ranges_mm[sensor.port] = kind.model.range_mm
        if Sense.FORCE in kind.model.senses:
            touch = engine.index("sensor", f"{prefix}force_{sensor.port}")
            forces[sensor.port] = engine.indices("sensor_adr")[touch]

    # In an arena the other robots are obstacles too, but not this one.
    is_in_arena = bool(prefix)
    soft_geoms = set()
    for number, item in enumerate(scene.solids):
        if item.soft:
            soft_geoms.add(engine.index("geom", object_name(number)))
    return Sensors(
        kinds=kinds,
        gazes=gazes,
        lefts=lefts,
        rays=rays,
        ranges_mm=ranges_mm,
        forces=forces,
        echoing_groups=(OBSTACLE_GROUP, SHAPE_GROUP) if is_in_arena else (OBSTACLE_GROUP,),
        silent_body=root.body if is_in_arena else -1,
        soft_geoms=soft_geoms,
        world=WorldSenses(engine, scene),
    )


def _cone(kind: SensorKind) -> list[Vector]:
    """Directions of a sensor's rays, in its own axes."""
    if kind not in _CONES_DEG:
        return [(1.0, 0.0, 0.0)]
    aside_deg, upright_deg = _CONES_DEG[kind]
    rays = []
    for share in _RAY_SHARES:
        angle = math.radians(share * aside_deg)
        rays.append((math.cos(angle), math.sin(angle), 0.0))
        # The ray straight ahead is one of both planes.
        if share and upright_deg:
            angle = math.radians(share * upright_deg)
            rays.append((math.cos(angle), 0.0, math.sin(angle)))
    return rays


def _site(
    engine: Engine,
    robot: Robot,
    sensor: Sensor,
    prefix: str,
) -> int:
    """Index of a sensor's site. Raises TwinError if there is none."""
    name = f"{prefix}{site_name(sensor)}"
    site = engine.index("site", name)
    if site < 0:
        raise TwinError(
            f"the model of robot '{robot.name}' has no place for '{sensor.name}' (a site "
            f"'{name}'); give it one, or the "
            "robot no model and the scene what the sensor reads"
        )
    return site
