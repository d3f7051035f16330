"""Senses of a robot: inertial sensors of its hub, and stimuli of its other sensors, computed from
the world around them.

Estimates, where LEGO gives no data: the spot that a colour sensor sees widens with its distance,
and beyond 20 mm less of its light is reflected (LEGO's technical sheet gives 16 mm as the best
distance).
"""

import colorsys
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

from brickhub.robot import SensorKind
from bricktwin.twin.engines.conventions import OBSTACLE_GROUP, object_name
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import (
    Quaternion,
    Vector,
    cross,
    dot,
    inverse,
    minus,
    plus,
    rotated,
    rotated_back,
    times,
    turn_between,
    vector,
)
from bricktwin.twin.objects import COLORS, Beacon, Field, Lamp, Line, Mark, Picture, Point
from bricktwin.twin.scene import FLOOR, Scene

INFRARED_MM = {
    SensorKind.COLOR_DISTANCE: 100.0,
    SensorKind.INFRARED: 150.0,
    # ev3dev's documentation has this one, and that of a beacon.
    SensorKind.EV3_INFRARED: 700.0,
}
"""Distances that sensors with infrared light report as 100 %; estimates."""
SENSOR_DRIFTS = {SensorKind.EV3_GYRO: 10.0}
"""Drift of a gyroscope on a port, as a share of that of a SPIKE hub; an estimate: owners of EV3
tell of drift at rest (ev3dev/ev3dev#1219), not how much."""
_GYRO_SAMPLE_S = 1 / 833
"""Time between two samples of a hub's gyroscope."""
_SUMMED_S = 0.005
"""Time over which samples of the gyroscope are drawn as one."""


class Noise(Protocol):
    """Source of random numbers of sensors, such as NumPy's ``Generator``."""

    def random(self) -> float:
        """A number from 0 up to 1."""

    def standard_normal(self) -> float:
        """A normally distributed number, of mean 0 and deviation 1."""


def clockwise_deg(orientation: Sequence[float]) -> float:
    """Rotation about the vertical of a quaternion [4], clockwise seen from above."""
    w, x, y, z = orientation
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
        self.rotation_rad: Vector = (0.0, 0.0, 0.0)
        self._last: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def update(self, orientation: Quaternion) -> None:
        """Add the turn to an orientation, a quaternion [4]."""
        # The shorter way round, from the heading with all its turns.
        change_deg = clockwise_deg(orientation) - self.heading_deg
        self.heading_deg += (change_deg + 180.0) % 360.0 - 180.0
        self.rotation_rad = plus(self.rotation_rad, turn_between(orientation, self._last))
        self._last = orientation


class SummedNoise:
    """What a gyroscope's noise adds to the heading, which is summed up from it: it disturbs what is
    unstable.

    It depends on time alone, not on who asks. ``rng``: of its own.
    """

    def __init__(self, rng: Noise) -> None:
        self._draw = rng.standard_normal
        self._samples = 0
        self._sum = 0.0

    def deg(
        self,
        time_s: float,
        noise_deg_s: float,
    ) -> float:
        """The sum at a time, which must not decrease, for a noise of this standard deviation."""
        samples = int(time_s / _SUMMED_S)
        # One by one: a sum of floats depends on its order, and must not depend on who asks when.
        while self._samples < samples:
            self._sum += self._draw()
            self._samples += 1
        # A random walk: the sum of n samples has the square root of n times the deviation of one.
        return self._sum * noise_deg_s * math.sqrt(_SUMMED_S * _GYRO_SAMPLE_S)


class _Base(ABC):
    """What carries a hub; ``_hub`` and ``_to_hub`` are the hub's position [3] there and the
    quaternion [4] to its axes."""

    def __init__(
        self,
        engine: Engine,
        imu: str,
    ) -> None:
        self._engine = engine
        self._site = engine.index("site", imu)
        first = 3 * self._site
        self._hub = vector(engine.nominal("site_pos")[first : first + 3])
        first = 4 * self._site
        self._to_hub = inverse(engine.nominal("site_quat")[first : first + 4])

    @abstractmethod
    def orientation(self) -> Quaternion:
        """Quaternion [4] from the axes of the part that carries the hub to the world's."""

    @abstractmethod
    def position(self) -> Vector:
        """Origin of the robot's first body [3] in the world, m."""

    @abstractmethod
    def in_world(self, of: Vector) -> Vector:
        """A vector [3] of the axes of the robot's first body, in the world's."""

    def in_hub(self, of: Vector) -> Vector:
        """A vector [3] of the axes of the part that carries the hub, in the hub's."""
        return rotated(of, self._to_hub)

    def up(self, vertical: Vector) -> Vector:
        """A direction [3] of the world in the hub's axes."""
        return self.in_hub(rotated_back(vertical, self.orientation()))


class FloatingBase(_Base):
    """Floating base, a freely moving chassis; all values come from the joint coordinates, which are
    up to date after each step.

    Args:
        position, dof: indices of the first position and of the first velocity of its free joint.
        imu: site of the hub.
    """

    def __init__(
        self,
        engine: Engine,
        position: int,
        dof: int,
        imu: str,
    ) -> None:
        super().__init__(engine, imu)
        # Views, not copies: they show the present state.
        self._position = engine.qpos[position : position + 3]
        self._frame = engine.qpos[position + 3 : position + 7]
        self._spin = engine.qvel[dof + 3 : dof + 6]
        self._linear = engine.qacc[dof : dof + 3]
        self._angular = engine.qacc[dof + 3 : dof + 6]

    def orientation(self) -> Quaternion:
        w, x, y, z = self._frame
        return w, x, y, z

    def position(self) -> Vector:
        x, y, z = self._position
        return x, y, z

    def in_world(self, of: Vector) -> Vector:
        return rotated(of, self._frame)

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        return rotated(self._spin, self._to_hub)

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2;
        at rest +9.81 upwards."""
        # MuJoCo gives a free joint's linear acceleration in the world's axes, and its rotation in
        # those of the body.
        spin = vector(self._spin)
        felt = minus(vector(self._linear), vector(self._engine.gravity))
        force = rotated_back(felt, self._frame)
        # The hub is beside the origin, so its acceleration has an Euler and a centripetal part.
        euler = cross(vector(self._angular), self._hub)
        centripetal = cross(spin, cross(spin, self._hub))
        return self.in_hub(plus(force, plus(euler, centripetal)))


class FixedBase(_Base):
    """Fixed base of a robot that carries the hub on a moving part, at the site ``imu``.

    All values are those that MuJoCo derived in its last step, one step behind the joints.
    """

    def __init__(self, engine: Engine, imu: str) -> None:
        super().__init__(engine, imu)
        self._body = engine.indices("site_bodyid")[self._site]
        self._first = engine.indices("body_rootid")[self._body]

    def orientation(self) -> Quaternion:
        return self._orientation_of(self._body)

    def position(self) -> Vector:
        first = 3 * self._first
        return vector(self._engine.derived("xpos")[first : first + 3])

    def in_world(self, of: Vector) -> Vector:
        return rotated(of, self._orientation_of(self._first))

    def angular_velocity(self) -> Vector:
        """Angular velocity in the hub's axes [3], rad/s."""
        return self._engine.site_spin(self._site)

    def specific_force(self) -> Vector:
        """Specific force at the hub, as an accelerometer measures it [3], in the hub's axes, m/s2;
        at rest +9.81 upwards."""
        return self._engine.site_force(self._site)

    def _orientation_of(self, body: int) -> Quaternion:
        first = 4 * body
        w, x, y, z = self._engine.derived("xquat")[first : first + 4]
        return w, x, y, z


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
_BEACON_MM = 2000.0
"""Distance from which an infrared beacon is reported as 100 %, and beyond which it is not seen."""
_MAX_DISTANCE_M = 3.0
_WALL_COLOR = (0.78, 0.16, 0.12)
"""Reflectance of the wall of bricks ahead, and of all else that is no object of the scene."""


_OBSTACLES = (OBSTACLE_GROUP,)


def _floor_distance_m(eye_m: Vector, gaze: Vector) -> float:
    """Distance to the floor along a gaze; infinite if that does not go down."""
    descent = gaze[2]
    if descent >= -1e-6:
        return math.inf
    return -eye_m[2] / descent


def _disc() -> list[Point]:
    """Points that fill a disc of radius 1 evenly: a sunflower pattern (Vogel 1979)."""
    points = []
    for number in range(_POINTS):
        seed = number + 0.5
        angle = seed * math.pi * (3.0 - math.sqrt(5.0))
        radius = math.sqrt(seed / _POINTS)
        points.append((radius * math.cos(angle), radius * math.sin(angle)))
    return points


class WorldSenses:
    """Stimuli in the world, from the position and direction of a sensor.

    Args:
        engine: engine of the robot in its scene.
        scene: scene with the objects.
    """

    def __init__(
        self,
        engine: Engine,
        scene: Scene,
    ) -> None:
        self._engine = engine
        self._scene = scene
        # The uppermost mark is the last, and hides those below it.
        self._marks: list[Mark] = scene.marks[::-1]
        self._lamps = [item for item in scene.objects if isinstance(item, Lamp)]
        self._beacons = [item for item in scene.objects if isinstance(item, Beacon)]
        self._colors: dict[int, Vector] = {}
        """Colours of the scene's objects, by the indices of their geometries."""
        for number, item in enumerate(scene.solids):
            geom = engine.index("geom", object_name(number))
            self._colors[geom] = COLORS[item.color]
        self._disc = _disc()

    def surface(
        self,
        eye_m: Vector,
        gaze: Vector,
    ) -> tuple[float, float, float]:
        """Colour (hue in deg, saturation and value in %) that a sensor at ``eye_m`` sees along
        ``gaze`` in its light."""
        # Rays meet obstacles only; the floor is where the gaze reaches the height 0.
        hit = self._engine.ray(eye_m, gaze, _OBSTACLES)
        distance_m = math.inf if hit is None else hit.distance_m
        floor_m = _floor_distance_m(eye_m, gaze)
        if floor_m < distance_m:
            rgb = self._floor(plus(eye_m, times(floor_m, gaze)), floor_m)
            distance_m = floor_m
        elif hit is not None:
            rgb = self._colors.get(hit.geom, _WALL_COLOR)
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
        eye_m: Vector,
        gaze: Vector,
    ) -> float:
        """Ambient light at a sensor, %: that of the room, and that of each visible lamp."""
        light_pct = self._scene.light_pct
        for lamp in self._lamps:
            offset_m = minus(times(1e-3, lamp.at_mm), eye_m)
            distance_m = math.hypot(*offset_m)
            cosine = dot(offset_m, gaze) / max(distance_m, 1e-9)
            if cosine <= 0.0:
                continue
            if self._is_hidden(eye_m, offset_m):
                continue
            # A lamp is no point: very near it no longer gets brighter.
            distance_mm = max(distance_m * 1000.0, _LAMP_MM / 10)
            closeness = (_LAMP_MM / distance_mm) ** 2
            light_pct += lamp.light_pct * cosine * closeness
        return min(light_pct, 100.0)

    def _is_hidden(self, eye_m: Vector, offset_m: Vector) -> bool:
        """Whether an obstacle is between an eye and what is at this offset from it."""
        distance_m = math.hypot(*offset_m)
        towards = times(1.0 / max(distance_m, 1e-9), offset_m)
        obstacle = self._engine.ray(eye_m, towards, _OBSTACLES)
        return obstacle is not None and obstacle.distance_m < distance_m

    def beacon(
        self,
        eye_m: Vector,
        gaze: Vector,
        left: Vector,
    ) -> tuple[float, ...]:
        """Distance (%) and direction (deg, to the right positive) of the nearest infrared beacon
        before a sensor; empty if it sees none."""
        seen: list[tuple[float, float]] = []
        for item in self._beacons:
            offset_m = minus(times(1e-3, item.at_mm), eye_m)
            ahead_m = dot(offset_m, gaze)
            share = math.hypot(*offset_m) * 1000.0 / _BEACON_MM
            if ahead_m <= 0.0 or share > 1.0 or self._is_hidden(eye_m, offset_m):
                continue
            right = math.atan2(-dot(offset_m, left), ahead_m)
            seen.append((100.0 * share, math.degrees(right)))
        return min(seen, default=())

    def distance_mm(
        self,
        eye_m: Vector,
        gaze: Vector,
    ) -> float:
        """Distance to the nearest surface along ``gaze``, including the floor; infinite if there is
        none."""
        nearest_m = _floor_distance_m(eye_m, gaze)
        hit = self._engine.ray(eye_m, gaze, _OBSTACLES)
        if hit is not None:
            nearest_m = min(nearest_m, hit.distance_m)
        return nearest_m * 1000.0 if nearest_m < _MAX_DISTANCE_M else math.inf

    def _floor(
        self,
        point_m: Vector,
        distance_m: float,
    ) -> Vector:
        """Mean colour of the spot on the floor at ``point_m`` that is seen from a distance."""
        radius_mm = spot_mm(distance_m * 1000.0)
        middle_mm = (point_m[0] * 1000.0, point_m[1] * 1000.0)
        # Points that no mark has covered so far, and the colours of the others with their numbers.
        bare = self._disc
        seen: list[tuple[int, Vector]] = []
        for mark in self._marks:
            if isinstance(mark, Picture):
                bare, colors = _beside_picture(
                    mark,
                    bare,
                    middle_mm,
                    radius_mm,
                )
                seen += colors
            else:
                left = _beside(
                    mark,
                    bare,
                    middle_mm,
                    radius_mm,
                )
                if left is not bare:
                    seen.append((len(bare) - len(left), COLORS[mark.color]))
                bare = left
            if not bare:
                break
        seen.append((len(bare), FLOOR))
        red = 0.0
        green = 0.0
        blue = 0.0
        for count, (part_red, part_green, part_blue) in seen:
            share = count / _POINTS
            red += share * part_red
            green += share * part_green
            blue += share * part_blue
        return red, green, blue


def spot_mm(distance_mm: float) -> float:
    """Radius of the spot that a colour sensor sees at a distance: so near to it, it sees the edge
    of a line."""
    return _SPOT_MM + _SPOT_RATIO * distance_mm


def _beside(
    mark: Line | Field,
    points: list[Point],
    middle_mm: Point,
    radius_mm: float,
) -> list[Point]:
    """Those of a spot's points, given in shares of its radius, that a mark does not cover."""
    middle_x, middle_y = middle_mm
    beyond_mm = mark.beyond_mm(middle_x, middle_y)
    # No point of the spot is farther from its middle than the radius.
    if beyond_mm > radius_mm:
        return points
    if beyond_mm <= -radius_mm:
        return []
    left = []
    for x, y in points:
        if mark.beyond_mm(middle_x + radius_mm * x, middle_y + radius_mm * y) > 0.0:
            left.append((x, y))
    return left


def _beside_picture(
    picture: Picture,
    points: list[Point],
    middle_mm: Point,
    radius_mm: float,
) -> tuple[list[Point], list[tuple[int, Vector]]]:
    """Those of a spot's points, given in shares of its radius, that are beside a picture, and the
    colour of each of the others, one time."""
    middle_x, middle_y = middle_mm
    left = []
    seen = []
    for x, y in points:
        color = picture.color_at(middle_x + radius_mm * x, middle_y + radius_mm * y)
        if color is None:
            left.append((x, y))
        else:
            seen.append((1, color))
    return left, seen
