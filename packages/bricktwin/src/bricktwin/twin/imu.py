"""Inertial sensors of a hub on a floating or a fixed base, from MuJoCo's state."""

from __future__ import annotations

import math

import mujoco
import numpy as np

Vector = np.ndarray[tuple[int], np.dtype[np.float64]]


def hub_mount(model: mujoco.MjModel, site: str) -> tuple[Vector, Vector]:
    """Position [3] of a hub on its chassis, and the quaternion [4] from the chassis' axes to the hub's."""
    to_hub = np.empty(4)
    mujoco.mju_negQuat(to_hub, model.site(site).quat)
    return model.site(site).pos.copy(), to_hub


class Turns:
    """Turns of a hub, summed up from its orientations; updates must be less than half a turn apart.

    Attributes:
        heading_deg: about the vertical, clockwise positive seen from above, 0 along x, not wrapped.
        rotation_rad: angular velocity in the axes of the part that carries the hub [3], summed up.
    """

    def __init__(self) -> None:
        self.heading_deg = 0.0
        self.rotation_rad: Vector = np.zeros(3)
        self._last: Vector = np.array([1.0, 0.0, 0.0, 0.0])

    def update(self, orientation: Vector) -> None:
        """Add the turn to an orientation, a quaternion [4]."""
        w, x, y, z = orientation.tolist()
        clockwise_deg = math.degrees(math.atan2(-2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        self.heading_deg += (clockwise_deg - self.heading_deg + 180.0) % 360.0 - 180.0
        turn_rad: Vector = np.empty(3)
        mujoco.mju_subQuat(turn_rad, orientation, self._last)
        self.rotation_rad += turn_rad
        self._last[:] = orientation


class _Base:
    """What carries a hub; ``_to_hub`` is the quaternion [4] from its axes to the hub's, ``_position`` and ``_frame`` are the
    origin [3] and the quaternion [4] of the robot's first body, which carries its sensors."""

    _to_hub: Vector
    _position: Vector
    _frame: Vector

    def position(self) -> Vector:
        """Origin of the robot's first body [3] in the world, m."""
        return self._position

    def in_world(self, vector: Vector) -> Vector:
        """A vector [3] of the axes of the robot's first body, in the world's."""
        rotated = np.empty(3)
        mujoco.mju_rotVecQuat(rotated, vector, self._frame)
        return rotated

    def in_hub(self, vector: Vector) -> Vector:
        """A vector [3] of the axes of the part that carries the hub, in the hub's."""
        rotated = np.empty(3)
        mujoco.mju_rotVecQuat(rotated, vector, self._to_hub)
        return rotated


class FloatingBase(_Base):
    """Floating base, a freely moving chassis; all values come from the joint coordinates, which are up to date after each step.

    Args:
        position, dof: indices of the first position and of the first velocity of its free joint.
        imu: site of the hub.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, position: int = 0, dof: int = 0, imu: str = "imu") -> None:
        self._gravity = model.opt.gravity
        self._hub, self._to_hub = hub_mount(model, imu)
        self._position = data.qpos[position : position + 3]
        self._frame = data.qpos[position + 3 : position + 7]
        self._spin: Vector = data.qvel[dof + 3 : dof + 6]
        self._qacc: Vector = data.qacc[dof : dof + 6]

    def orientation(self) -> Vector:
        """Quaternion [4] from the chassis' axes to the world's."""
        return self._frame

    def up(self, vertical: Vector) -> Vector:
        """A direction [3] of the world in the hub's axes."""
        from_world, rotated = np.empty(4), np.empty(3)
        mujoco.mju_negQuat(from_world, self._frame)
        mujoco.mju_rotVecQuat(rotated, vertical, from_world)
        return self.in_hub(rotated)

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        return self.in_hub(self._spin)

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2; at rest +9.81 upwards."""
        spin, angular = self._spin, self._qacc[3:6]
        to_hub, force = np.empty(4), np.empty(3)
        mujoco.mju_negQuat(to_hub, self._frame)
        mujoco.mju_rotVecQuat(force, self._qacc[0:3] - self._gravity, to_hub)
        force += np.cross(angular, self._hub) + np.cross(spin, np.cross(spin, self._hub))
        return self.in_hub(force)


class FixedBase(_Base):
    """Fixed base of a robot that carries the hub on a moving part, at the site "imu".

    All values are those that MuJoCo derived in its last step, one step behind the joints.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._site = int(model.site("imu").id)
        self._body = int(model.site_bodyid[self._site])
        self._to_hub = hub_mount(model, "imu")[1]
        first = int(model.body_rootid[self._body])
        self._position, self._frame = data.xpos[first], data.xquat[first]

    def orientation(self) -> Vector:
        """Quaternion [4] from the axes of the part that carries the hub to the world's."""
        orientation: Vector = self._data.xquat[self._body].copy()
        return orientation

    def up(self, vertical: Vector) -> Vector:
        """A direction [3] of the world in the hub's axes."""
        up: Vector = self._data.site_xmat[self._site].reshape(3, 3).T @ vertical
        return up

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(self._model, self._data, mujoco.mjtObj.mjOBJ_SITE, self._site, velocity, 1)
        return velocity[0:3]

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2; at rest +9.81 upwards."""
        acceleration = np.empty(6)
        mujoco.mj_rnePostConstraint(self._model, self._data)
        mujoco.mj_objectAcceleration(self._model, self._data, mujoco.mjtObj.mjOBJ_SITE, self._site, acceleration, 1)
        return acceleration[3:6]
