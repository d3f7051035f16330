"""Engine of MuJoCo's Python build."""

import copy
import functools
from collections.abc import Sequence
from typing import Any, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from bricktwin.twin.engines.engine import Hit, Kind, Touch, Values
from bricktwin.twin.engines.rotations import Vector

_OBJECTS = {
    "body": (mujoco.mjtObj.mjOBJ_BODY, "nbody"),
    "joint": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "geom": (mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "site": (mujoco.mjtObj.mjOBJ_SITE, "nsite"),
    "actuator": (mujoco.mjtObj.mjOBJ_ACTUATOR, "nu"),
    "sensor": (mujoco.mjtObj.mjOBJ_SENSOR, "nsensor"),
}
"""MuJoCo's type of each kind, and the model's field with their number."""
_SITE = mujoco.mjtObj.mjOBJ_SITE
_IN_OWN_AXES = 1
"""Flag of MuJoCo's velocities and accelerations of objects."""


class MujocoEngine:
    """Engine of a compiled model; implements :class:`bricktwin.twin.engines.engine.Engine`.

    Args:
        nominal: model as compiled, which is not changed.
        model, data: a copy of it and its data; by default made here.

    Attributes:
        model, data: MuJoCo's own, e.g. for a renderer; what is written there holds too.
    """

    def __init__(
        self,
        nominal: mujoco.MjModel,
        model: mujoco.MjModel | None = None,
        data: mujoco.MjData | None = None,
    ) -> None:
        self._nominal = nominal
        self.model = model or copy.copy(nominal)
        self.data = data or mujoco.MjData(self.model)
        # Memory views, as NumPy is slow for single values.
        self.qpos = _flat(self.data.qpos)
        self.qvel = _flat(self.data.qvel)
        self.qacc = _flat(self.data.qacc)
        self.ctrl = _flat(self.data.ctrl)
        self.actuator_force = _flat(self.data.actuator_force)
        self.sensordata = _flat(self.data.sensordata)
        self.mocap_pos = _flat(self.data.mocap_pos)
        self.xfrc_applied = _flat(self.data.xfrc_applied)
        self.gravity = _flat(self.model.opt.gravity)
        self.open_circuits = int(self.model.opt.disableactuator)
        self._derived: dict[str, Values] = {}
        # Arguments of a ray, made once, as rays are cast often.
        self._origin = np.empty(3)
        self._direction = np.empty(3)
        self._geom = np.empty(1, np.int32)
        self._normal = np.empty(3)
        self._origin_view = _flat(self._origin)
        self._direction_view = _flat(self._direction)

    def switch_circuits(self, circuits: int) -> None:
        self.open_circuits ^= circuits
        self.model.opt.disableactuator = self.open_circuits

    def names(self, kind: Kind) -> Sequence[str]:
        object_type, count_field = _OBJECTS[kind]
        count = getattr(self.model, count_field)
        # None for what has no name.
        return [mujoco.mj_id2name(self.model, object_type, index) or "" for index in range(count)]

    def index(self, kind: Kind, name: str) -> int:
        object_type, _ = _OBJECTS[kind]
        return int(mujoco.mj_name2id(self.model, object_type, name))

    @property
    def nominal_gravity(self) -> Vector:
        x, y, z = self._nominal.opt.gravity.tolist()
        return x, y, z

    def nominal(self, field: str) -> Sequence[float]:
        values: list[float] = getattr(self._nominal, field).ravel().tolist()
        return values

    def indices(self, field: str) -> Sequence[int]:
        values: list[int] = getattr(self._nominal, field).ravel().tolist()
        return values

    def parameters(self, field: str) -> list[float]:
        values: list[float] = getattr(self.model, field).ravel().tolist()
        return values

    def set_parameters(self, field: str, values: Sequence[float]) -> None:
        getattr(self.model, field).reshape(-1)[:] = values

    def derive_constants(self) -> None:
        # In data that nobody uses: MuJoCo sets all positions for it.
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def step(self, count: int) -> None:
        mujoco.mj_step(self.model, self.data, count)

    def forward(self) -> None:
        mujoco.mj_forward(self.model, self.data)

    def kinematics(self) -> None:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def forget(self) -> None:
        self.data.qacc_warmstart[:] = 0.0

    def derived(self, field: str) -> Values:
        values = self._derived.get(field)
        if values is None:
            values = self._derived[field] = _flat(getattr(self.data, field))
        return values

    def ray(
        self,
        origin_m: Vector,
        direction: Vector,
        groups: tuple[int, ...],
        but_body: int = -1,
    ) -> Hit | None:
        origin = self._origin_view
        origin[0], origin[1], origin[2] = origin_m
        towards = self._direction_view
        towards[0], towards[1], towards[2] = direction
        distance_m = mujoco.mj_ray(
            self.model,
            self.data,
            self._origin,
            self._direction,
            _flags(groups),
            True,
            but_body,
            self._geom,
            self._normal,
        )
        # MuJoCo answers with -1 where a ray hits nothing.
        if distance_m < 0.0:
            return None
        x, y, z = self._normal.tolist()
        return Hit(distance_m, int(self._geom[0]), (x, y, z))

    def touches(self) -> list[Touch]:
        contacts = self.data.contact
        pairs = contacts.geom.tolist()
        distances = contacts.dist.tolist()
        return [
            Touch(first, second, distance_m)
            for (first, second), distance_m in zip(pairs, distances, strict=True)
        ]

    def site_spin(self, site: int) -> Vector:
        # Rotation first, then translation.
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(
            self.model,
            self.data,
            _SITE,
            site,
            velocity,
            _IN_OWN_AXES,
        )
        x, y, z, *_ = velocity.tolist()
        return x, y, z

    def site_force(self, site: int) -> Vector:
        # A step computes the accelerations of bodies only if a sensor of the model needs them.
        mujoco.mj_rnePostConstraint(self.model, self.data)
        acceleration = np.empty(6)
        mujoco.mj_objectAcceleration(
            self.model,
            self.data,
            _SITE,
            site,
            acceleration,
            _IN_OWN_AXES,
        )
        *_, x, y, z = acceleration.tolist()
        return x, y, z


@functools.cache
def _flags(groups: tuple[int, ...]) -> NDArray[np.uint8]:
    """Flags of the groups that a ray meets."""
    flags = np.zeros(mujoco.mjNGROUP, np.uint8)
    flags[list(groups)] = 1
    return flags


def _flat(values: NDArray[np.float64]) -> Values:
    """Flat view of an array."""
    flat: Any = values.reshape(-1)
    return cast("Values", memoryview(flat))
