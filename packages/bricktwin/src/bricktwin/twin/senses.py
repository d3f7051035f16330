"""Senses of a robot: inertial sensors of its hub, and stimuli of its other sensors, computed from
the world around them.

Estimates, where LEGO gives no data: the spot that a colour sensor sees widens with its distance,
and beyond 20 mm less of its light is reflected (LEGO's technical sheet gives 16 mm as the best
distance).
"""

import colorsys
import math
from abc import ABC, abstractmethod

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP
from bricktwin.twin.objects import COLORS, Lamp, Mark, Picture
from bricktwin.twin.scene import FLOOR, Scene

Vector = np.ndarray[tuple[int], np.dtype[np.float64]]


_GYRO_SAMPLE_S = 1 / 833
"""Time between two samples of a hub's gyroscope."""
_SUMMED_S = 0.005
"""Time over which samples of the gyroscope are drawn as one."""


def clockwise_deg(orientation: Vector) -> float:
    """Rotation about the vertical of a quaternion [4], clockwise seen from above."""
    # NumPy is slow for single values.
    w, x, y, z = orientation.tolist()
    # Where the x axis looks, seen from above: the yaw of the quaternion, with its sign turned.
    sine = -2.0 * (w * z + x * y)
    cosine = 1.0 - 2.0 * (y * y + z * z)
    return math.degrees(math.atan2(sine, cosine))


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
        # The shorter way round, from the heading with all its turns.
        change_deg = clockwise_deg(orientation) - self.heading_deg
        self.heading_deg += (change_deg + 180.0) % 360.0 - 180.0
        turn_rad: Vector = np.empty(3)
        mujoco.mju_subQuat(turn_rad, orientation, self._last)
        self.rotation_rad += turn_rad
        self._last[:] = orientation


class SummedNoise:
    """What a gyroscope's noise adds to the heading, which is summed up from it: it disturbs what is
    unstable.

    It depends on time alone, not on who asks. ``rng``: of its own.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._samples = 0
        self._sum = 0.0

    def deg(
        self,
        time_s: float,
        noise_deg_s: float,
    ) -> float:
        """The sum at a time, which must not decrease, for a noise of this standard deviation."""
        samples = int(time_s / _SUMMED_S)
        new_samples = max(samples - self._samples, 0)
        # One by one: a sum of floats depends on its order, and must not depend on who asks when.
        for noise in self._rng.standard_normal(new_samples).tolist():
            self._sum += noise
        self._samples = max(samples, self._samples)
        # A random walk: the sum of n samples has the square root of n times the deviation of one.
        return self._sum * noise_deg_s * math.sqrt(_SUMMED_S * _GYRO_SAMPLE_S)


class _Base(ABC):
    """What carries a hub; ``_hub`` and ``_to_hub`` are the hub's position [3] there and the
    quaternion [4] to its axes, ``_position`` and ``_frame`` the origin [3] and the quaternion [4]
    of the robot's first body, which carries its sensors."""

    _position: Vector
    _frame: Vector

    def __init__(
        self,
        model: mujoco.MjModel,
        imu: str,
    ) -> None:
        self._hub = model.site(imu).pos.copy()
        self._to_hub = np.empty(4)
        mujoco.mju_negQuat(self._to_hub, model.site(imu).quat)

    @abstractmethod
    def orientation(self) -> Vector:
        """Quaternion [4] from the axes of the part that carries the hub to the world's."""

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

    def up(self, vertical: Vector) -> Vector:
        """A direction [3] of the world in the hub's axes."""
        from_world = np.empty(4)
        rotated = np.empty(3)
        mujoco.mju_negQuat(from_world, self.orientation())
        mujoco.mju_rotVecQuat(rotated, vertical, from_world)
        return self.in_hub(rotated)


class FloatingBase(_Base):
    """Floating base, a freely moving chassis; all values come from the joint coordinates, which are
    up to date after each step.

    Args:
        position, dof: indices of the first position and of the first velocity of its free joint.
        imu: site of the hub.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        position: int,
        dof: int,
        imu: str,
    ) -> None:
        # Views, not copies: they show the present state.
        self._gravity = model.opt.gravity
        super().__init__(model, imu)
        self._position = data.qpos[position : position + 3]
        self._frame = data.qpos[position + 3 : position + 7]
        self._spin: Vector = data.qvel[dof + 3 : dof + 6]
        self._qacc: Vector = data.qacc[dof : dof + 6]

    def orientation(self) -> Vector:
        return self._frame

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        return self.in_hub(self._spin)

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2;
        at rest +9.81 upwards."""
        # MuJoCo gives a free joint's linear acceleration in the world's axes, and its rotation in
        # those of the body.
        spin = self._spin
        angular = self._qacc[3:6]
        to_hub = np.empty(4)
        force = np.empty(3)
        mujoco.mju_negQuat(to_hub, self._frame)
        felt = self._qacc[0:3] - self._gravity
        mujoco.mju_rotVecQuat(force, felt, to_hub)
        # The hub is beside the origin, so its acceleration has an Euler and a centripetal part.
        euler = np.cross(angular, self._hub)
        centripetal = np.cross(spin, np.cross(spin, self._hub))
        force += euler + centripetal
        return self.in_hub(force)


class FixedBase(_Base):
    """Fixed base of a robot that carries the hub on a moving part, at the site ``imu``.

    All values are those that MuJoCo derived in its last step, one step behind the joints.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        imu: str,
    ) -> None:
        self._model = model
        self._data = data
        self._site = int(model.site(imu).id)
        self._body = int(model.site_bodyid[self._site])
        super().__init__(model, imu)
        first = int(model.body_rootid[self._body])
        self._position = data.xpos[first]
        self._frame = data.xquat[first]

    def orientation(self) -> Vector:
        orientation: Vector = self._data.xquat[self._body].copy()
        return orientation

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        # Rotation first, then translation; the last argument asks for the site's own axes.
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(
            self._model,
            self._data,
            mujoco.mjtObj.mjOBJ_SITE,
            self._site,
            velocity,
            1,
        )
        return velocity[0:3]

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2;
        at rest +9.81 upwards."""
        acceleration = np.empty(6)
        # A step computes the accelerations of bodies only if a sensor of the model needs them.
        mujoco.mj_rnePostConstraint(self._model, self._data)
        mujoco.mj_objectAcceleration(
            self._model,
            self._data,
            mujoco.mjtObj.mjOBJ_SITE,
            self._site,
            acceleration,
            1,
        )
        return acceleration[3:6]


_SPOT_MM = 1.0
"""Radius of the spot that a colour sensor sees at zero distance; an estimate."""
_SPOT_RATIO = 0.3
"""Increase of this radius per millimetre of distance; an estimate."""
_POINTS = 19
"""Points of the spot whose colours are averaged."""
_FULL_LIGHT_MM = 20.0
"""Distance up to which a colour sensor gets all of its light back; an estimate."""
_LAMP_MM = 300.0
"""Distance from which a lamp's ``light_pct`` is read."""
_MAX_DISTANCE_M = 3.0
_WALL_COLOR = (0.78, 0.16, 0.12)
"""Reflectance of the wall of bricks ahead, and of all else that is no object of the scene."""


def _floor_distance_m(eye_m: Floats, gaze: Floats) -> float:
    """Distance to the floor along a gaze; infinite if that does not go down."""
    descent = gaze[2]
    if descent >= -1e-6:
        return math.inf
    return float(-eye_m[2] / descent)


class WorldSenses:
    """Stimuli in the world, from the position and direction of a sensor.

    Args:
        model, data: MuJoCo's model and data of the robot in its scene.
        scene: scene with the objects.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        scene: Scene,
    ) -> None:
        self._model = model
        self._data = data
        self._scene = scene
        self._marks: list[tuple[Mark, Floats | None]] = []
        """Marks with their colours; ``None`` for a picture, which has many."""
        for mark in scene.marks:
            rgb = None if isinstance(mark, Picture) else np.array(COLORS[mark.color])
            self._marks.append((mark, rgb))
        self._lamps = [item for item in scene.objects if isinstance(item, Lamp)]
        self._colors: dict[int, tuple[float, float, float]] = {}
        """Colours of the scene's objects, by the indices of their geometries."""
        for number, item in enumerate(scene.solids):
            geom = int(model.geom(f"object_{number}").id)
            self._colors[geom] = COLORS[item.color]
        self._obstacles = np.zeros(6, np.uint8)
        self._obstacles[OBSTACLE_GROUP] = 1
        # Sunflower pattern: points that fill a disc evenly (Vogel 1979).
        seed = np.arange(_POINTS) + 0.5
        angle = seed * math.pi * (3.0 - math.sqrt(5.0))
        radius = np.sqrt(seed / _POINTS)
        x = radius * np.cos(angle)
        y = radius * np.sin(angle)
        self._disc = np.stack([x, y], -1)  # [points, 2]
        self._bare_floor = np.full((_POINTS, 3), FLOOR)

    def surface(
        self,
        eye_m: Floats,
        gaze: Floats,
    ) -> tuple[float, float, float]:
        """Colour (hue in deg, saturation and value in %) that a sensor at ``eye_m`` sees along
        ``gaze`` in its light."""
        # Rays meet obstacles only; the floor is where the gaze reaches the height 0.
        distance_m, geom = self._ray(eye_m, gaze)
        floor_m = _floor_distance_m(eye_m, gaze)
        if floor_m < distance_m:
            rgb = self._floor(eye_m + floor_m * gaze, floor_m)
            distance_m = floor_m
        elif geom >= 0:
            rgb = self._colors.get(geom, _WALL_COLOR)
        else:
            return 0.0, 0.0, 0.0
        # The sensor's own light weakens with the square of the distance.
        distance_mm = max(distance_m * 1000.0, 1e-6)
        brightness = min(1.0, (_FULL_LIGHT_MM / distance_mm) ** 2)
        red, green, blue = (min(max(part * brightness, 0.0), 1.0) for part in rgb)
        hue, saturation, value = colorsys.rgb_to_hsv(red, green, blue)
        return hue * 360.0, saturation * 100.0, value * 100.0

    def ambient(
        self,
        eye_m: Floats,
        gaze: Floats,
    ) -> float:
        """Ambient light at a sensor, %: that of the room, and that of each visible lamp."""
        light_pct = self._scene.light_pct
        for lamp in self._lamps:
            offset_m = np.array(lamp.at_mm) / 1000.0 - eye_m
            distance_m = float(np.linalg.norm(offset_m))
            cosine = float(offset_m @ gaze) / max(distance_m, 1e-9)
            if cosine <= 0.0:
                continue
            # An obstacle between the sensor and a lamp hides the lamp.
            obstacle_m, _ = self._ray(eye_m, offset_m / distance_m)
            if obstacle_m < distance_m:
                continue
            # A lamp is no point: very near it no longer gets brighter.
            distance_mm = max(distance_m * 1000.0, _LAMP_MM / 10)
            closeness = (_LAMP_MM / distance_mm) ** 2
            light_pct += lamp.light_pct * cosine * closeness
        return min(light_pct, 100.0)

    def distance_mm(
        self,
        eye_m: Floats,
        gaze: Floats,
    ) -> float:
        """Distance to the nearest surface along ``gaze``, including the floor; infinite if there is
        none."""
        distance_m, _ = self._ray(eye_m, gaze)
        floor_m = _floor_distance_m(eye_m, gaze)
        nearest_m = min(distance_m, floor_m)
        return nearest_m * 1000.0 if nearest_m < _MAX_DISTANCE_M else math.inf

    def _ray(
        self,
        eye_m: Floats,
        gaze: Floats,
    ) -> tuple[float, int]:
        """Distance (m) and geometry of the first obstacle along a ray; infinite and -1 if there is
        none."""
        geom = np.empty(1, np.int32)
        distance_m = mujoco.mj_ray(
            self._model,
            self._data,
            eye_m,
            gaze,
            self._obstacles,
            True,
            -1,
            geom,
        )
        if distance_m < 0:
            return math.inf, -1
        return float(distance_m), int(geom[0])

    def _floor(
        self,
        point_m: Floats,
        distance_m: float,
    ) -> tuple[float, float, float]:
        """Mean colour of the spot on the floor at ``point_m`` that is seen from a distance."""
        radius_mm = _SPOT_MM + _SPOT_RATIO * distance_m * 1000.0
        points_mm = point_m[:2] * 1000.0 + radius_mm * self._disc
        rgb = self._bare_floor.copy()  # [points, 3]
        # The uppermost mark is the last, and hides those below it.
        for mark, color in self._marks:
            if not isinstance(mark, Picture):
                rgb[mark.covers(points_mm)] = color
                continue
            for point, (x_mm, y_mm) in enumerate(points_mm.tolist()):
                pixel = mark.color_at(x_mm, y_mm)
                if pixel is not None:
                    rgb[point] = pixel
        # `mean` takes longer for so few points.
        mean = np.add.reduce(rgb) / _POINTS
        red, green, blue = mean.tolist()
        return red, green, blue
