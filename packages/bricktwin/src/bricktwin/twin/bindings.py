"""Bindings of a robot's body to a compiled MuJoCo model: where its motors, sensors and base are.

All names are looked up once, when the body is made; what is read in each step are indices, and
views of MuJoCo's arrays, which show the present state. In an arena several robots share one model,
and the names of each begin with its ``prefix``, ``"ROBOT/"``.
"""

import math
from dataclasses import dataclass
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from brickhub.robot import Robot, Sense, Sensor, SensorKind
from bricktwin.plans.geometry import Floats
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP, SHAPE_GROUP
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.models.mounts import site_name
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import Vector, WorldSenses
from bricktwin.twin.stance import Feet

_CONE_DEG = (-12.0, -6.0, 0.0, 6.0, 12.0)
"""Directions of an ultrasonic sensor's rays, to the left of where it looks."""


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


def bind_root(model: mujoco.MjModel, prefix: str) -> Root:
    """The first body of a robot."""
    # Alone, the robot's joints are the first; in an arena only names tell whose they are.
    joint = int(model.body(f"{prefix}chassis").jntadr[0]) if prefix else 0
    feet = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("foot_")]
    # Nothing stands on one foot; in an arena a robot keeps the stance in which it has settled.
    derives_stance = len(feet) > 1 and not prefix
    return Root(
        body=int(model.jnt_bodyid[joint]),
        is_free=bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE),
        address=int(model.jnt_qposadr[joint]),
        dof=int(model.jnt_dofadr[joint]),
        feet=Feet(model, feet) if derives_stance else None,
    )


@dataclass(frozen=True, slots=True)
class Motors:
    """Motors of a robot.

    Attributes:
        terminals: index of the actuator, and the bit of its circuit in MuJoCo's option
            ``disableactuator``, by port.
        shafts: address of the joint's position, and millidegrees of the shaft for a radian there,
            by port.
        amperes: index of the actuator, and current for a torque, of each motor.
        dofs: degree of freedom of each motor's joint.
        tyres: geometries of the drive base's tyres, left and right, if it has such.
        positions: of all joints, a view.
        voltages_v: of all actuators, a view; what is written there is applied.
        torques_nm: of all actuators, a view.
    """

    terminals: dict[str, tuple[int, int]]
    shafts: dict[str, tuple[int, float]]
    amperes: list[tuple[int, float]]
    dofs: list[int]
    tyres: list[int]
    positions: "memoryview[float]"
    voltages_v: "memoryview[float]"
    torques_nm: "memoryview[float]"


def bind_motors(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: Robot,
    prefix: str,
) -> Motors:
    """The motors of a robot, in the order of its description."""
    terminals = {}
    shafts = {}
    amperes = []
    dofs = []
    for motor in robot.motors:
        joint = model.joint(f"{prefix}motor_{motor.port}")
        actuator = int(model.actuator(f"{prefix}motor_{motor.port}").id)
        circuit = 1 << int(model.actuator_group[actuator])
        gear = float(model.actuator_gear[actuator, 0])
        terminals[motor.port] = (actuator, circuit)
        address = int(joint.qposadr[0])
        mdeg_per_rad = gear * math.degrees(1000.0)
        shafts[motor.port] = (address, mdeg_per_rad)
        constants = motor_constants(motor.kind)
        amperes.append((actuator, 1.0 / constants.torque_nm_a))
        dofs.append(int(joint.dofadr[0]))
    # Memory views, as NumPy is slow for single values.
    return Motors(
        terminals=terminals,
        shafts=shafts,
        amperes=amperes,
        dofs=dofs,
        tyres=_tyres(model, robot, prefix),
        positions=cast("memoryview[float]", memoryview(data.qpos)),
        voltages_v=cast("memoryview[float]", memoryview(data.ctrl)),
        torques_nm=cast("memoryview[float]", memoryview(data.actuator_force)),
    )


def _tyres(
    model: mujoco.MjModel,
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
        tyres.append(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, tyre))
    # A model of the user may have other names, which MuJoCo answers with -1.
    return tyres if min(tyres) >= 0 else []


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of a robot, by port. Positions ``[3]`` and axes ``[3, 3]``, as columns, are in the
    frame of the robot's first body; sensors look along their x axes.

    Attributes:
        kinds: of those that sense anything.
        frames: position and axes of each.
        sonars: position and directions of the rays ``[5, 3]`` of each ultrasonic sensor.
        forces: what a force sensor feels (N) ``[1]``, a view.
        echoing_groups: flags of the geometry groups that throw sound back.
        silent_body: body that sound passes through; -1 for none.
        soft_geoms: geometries of the scene that scatter sound.
        world: what can be seen from a place.
    """

    kinds: dict[str, SensorKind]
    frames: dict[str, tuple[Vector, Floats]]
    sonars: dict[str, tuple[Vector, Floats]]
    forces: dict[str, Vector]
    echoing_groups: NDArray[np.uint8]
    silent_body: int
    soft_geoms: set[int]
    world: WorldSenses


def bind_sensors(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: Robot,
    scene: Scene,
    root: Root,
    prefix: str,
) -> Sensors:
    """The sensors of a robot. Raises TwinError if the model has no place for one."""
    rays = _rays()
    kinds: dict[str, SensorKind] = {}
    frames: dict[str, tuple[Vector, Floats]] = {}
    sonars: dict[str, tuple[Vector, Floats]] = {}
    forces: dict[str, Vector] = {}
    for sensor in robot.sensors:
        kind = sensor.kind
        if not kind.model.senses:
            continue
        position_m, axes = _frame(model, robot, sensor, prefix)
        kinds[sensor.port] = kind
        frames[sensor.port] = (position_m, axes)
        if kind.model.range_mm is not None:
            sonars[sensor.port] = (position_m, rays @ axes.T)
        if Sense.FORCE in kind.model.senses:
            touch = data.sensor(f"{prefix}force_{sensor.port}")
            forces[sensor.port] = touch.data

    # In an arena the other robots are obstacles too, but not this one.
    is_in_arena = bool(prefix)
    echoing_groups = np.zeros(6, np.uint8)
    echoing_groups[OBSTACLE_GROUP] = 1
    if is_in_arena:
        echoing_groups[SHAPE_GROUP] = 1
    soft_geoms = set()
    for number, item in enumerate(scene.solids):
        if item.soft:
            geom = model.geom(f"object_{number}")
            soft_geoms.add(int(geom.id))
    return Sensors(
        kinds=kinds,
        frames=frames,
        sonars=sonars,
        forces=forces,
        echoing_groups=echoing_groups,
        silent_body=root.body if is_in_arena else -1,
        soft_geoms=soft_geoms,
        world=WorldSenses(model, data, scene),
    )


def _rays() -> Floats:
    """Directions ``[5, 3]`` of an ultrasonic sensor's rays, in its own axes."""
    rays = []
    for angle_deg in _CONE_DEG:
        angle = math.radians(angle_deg)
        rays.append((math.cos(angle), math.sin(angle), 0.0))
    return np.array(rays)


def _frame(
    model: mujoco.MjModel,
    robot: Robot,
    sensor: Sensor,
    prefix: str,
) -> tuple[Vector, Floats]:
    """Position of a sensor's site on the chassis [3], and its axes as columns [3, 3]. Raises
    TwinError if there is no such site."""
    name = f"{prefix}{site_name(sensor)}"
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site < 0:
        raise TwinError(
            f"the model of robot '{robot.name}' has no place for '{sensor.name}' (a site "
            f"'{name}'); give it one, or the "
            "robot no model and the scene what the sensor reads"
        )
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.site_quat[site])
    return model.site_pos[site].copy(), axes.reshape(3, 3)
