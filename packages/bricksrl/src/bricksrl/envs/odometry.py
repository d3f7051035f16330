"""Odometry: distance travelled, and the position of a target relative to a driving robot.

The distance comes from a virtual robot's true pose or is estimated from the ultrasonic sensor. The
position is dead reckoning: computed from the rotations of the wheels since the start.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from brickhub.entry import Entry
from brickhub.hub.interface import Distance, Interface
from brickhub.robot import Robot
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    import numpy as np

    from bricktwin.twin.scene import Scene
    from bricktwin.twin.standing import Pose

_log = logging.getLogger(__name__)

_DISTANCE_LIMITS_MM = (-1e5, 1e5)
"""Farther than a robot drives in an episode."""
_TURN_LIMITS_DEG = (-180.0, 180.0)


def _signed_deg(angle_deg: float) -> float:
    """The same direction in -180..180 degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0


@dataclass(frozen=True)
class FloorPose:
    """Position and heading on the floor: mm along x and y, degrees clockwise from x."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    heading_deg: float = 0.0

    def seen_from(self, robot: FloorPose) -> tuple[float, float, float]:
        """This pose in the robot's frame: mm ahead, mm to the left, and the heading difference in
        -180..180 deg."""
        x_mm = self.x_mm - robot.x_mm
        y_mm = self.y_mm - robot.y_mm
        heading = math.radians(robot.heading_deg)
        # Headings are clockwise, but y points to the left.
        ahead_mm = x_mm * math.cos(heading) - y_mm * math.sin(heading)
        left_mm = x_mm * math.sin(heading) + y_mm * math.cos(heading)
        turn_deg = _signed_deg(self.heading_deg - robot.heading_deg)
        return ahead_mm, left_mm, turn_deg

    def driven(
        self,
        way_mm: float,
        turn_deg: float,
    ) -> FloorPose:
        """The pose after driving an arc of length ``way_mm`` that turns the robot by ``turn_deg``
        clockwise."""
        # An arc ends where its chord does, which points to the middle of the headings at its ends.
        heading = math.radians(self.heading_deg + turn_deg / 2)
        chord_mm = way_mm
        if turn_deg:
            half_turn = math.radians(turn_deg) / 2
            chord_mm = way_mm * math.sin(half_turn) / half_turn
        x_mm = self.x_mm + chord_mm * math.cos(heading)
        y_mm = self.y_mm - chord_mm * math.sin(heading)
        return FloorPose(x_mm, y_mm, self.heading_deg + turn_deg)


@dataclass(frozen=True)
class Target:
    """A pose in a task's scene that a driving robot is to reach. Its pose relative to the robot is
    part of the observation.

    The start pose lies in the ranges of the scene and is known to the host: it is read from a
    virtual robot, and a real one is placed there. From then on the pose is integrated from the
    wheel angles. These are channels of the task, wrapped into 0..360 degrees, but not part of the
    observation: they carry nothing useful, and an agent would need many episodes to learn that.

    Attributes:
        place: target pose of the middle of the robot's axle in the scene.
        range_mm, range_deg: nominal range of the distances ahead and to the left, and of the turn.
            Features are scaled by them, so choose the distance at which precision matters.
        step_mm, step_deg: nominal range of the distance and the turn of one step.
    """

    place: FloorPose = FloorPose()
    range_mm: float = 200.0
    range_deg: float = 60.0
    step_mm: float = 20.0
    step_deg: float = 12.0

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Entries that the target adds to the observation."""
        return (
            Entry(
                "target_ahead",
                -self.range_mm,
                self.range_mm,
                "mm",
                limits=_DISTANCE_LIMITS_MM,
            ),
            Entry(
                "target_left",
                -self.range_mm,
                self.range_mm,
                "mm",
                limits=_DISTANCE_LIMITS_MM,
            ),
            Entry(
                "target_turn",
                -self.range_deg,
                self.range_deg,
                "deg",
                limits=_TURN_LIMITS_DEG,
            ),
            Entry(
                "moved",
                -self.step_mm,
                self.step_mm,
                "mm",
                limits=_DISTANCE_LIMITS_MM,
            ),
            Entry(
                "turned",
                -self.step_deg,
                self.step_deg,
                "deg",
                limits=_TURN_LIMITS_DEG,
            ),
        )


def wheels(robot: Robot, interface: Interface) -> tuple[int, int]:
    """Indices of the left and the right wheel's angle among the channels. Raises DescriptionError
    if the robot has no drive base, or the angles are not observed."""
    base = robot.drive_base
    indices = interface.angle_indices
    if base is None or not {base.left, base.right} <= set(indices):
        raise DescriptionError(
            f"robot '{robot.name}' cannot tell where its target is; give it a drive base and "
            "observe the MotorAngle of each wheel"
        )
    return indices[base.left], indices[base.right]


class TargetTracker:
    """Tracker of a task's target relative to the robot, over one episode.

    Args:
        target: the task's target.
        robot: the driving robot.
        interface: channels, with the angle of each wheel.
        true_pose: returns a virtual robot's true pose; ``None`` for a real robot.
        pose: start pose of the robot.
        values: channels ``[n]`` at the start.
    """

    def __init__(
        self,
        target: Target,
        robot: Robot,
        interface: Interface,
        true_pose: Callable[[], Pose] | None,
        pose: FloorPose,
        values: Sequence[float],
    ) -> None:
        assert robot.drive_base is not None  # noqa: S101 - the task checked it
        self._target = target
        self._base = robot.drive_base
        self._true_pose = true_pose
        self.pose = pose
        self._wheels = wheels(robot, interface)
        self._angles_deg = self._angles(values)
        self._last_step = (0.0, 0.0)

    def entries(self) -> tuple[float, ...]:
        """The target as `FloorPose.seen_from`, then the distance (mm) and the turn (deg) of the
        last step."""
        return (*self._target.place.seen_from(self.pose), *self._last_step)

    def follow(self, values: Sequence[float]) -> None:
        """Update the pose from the channels ``values [n]`` after a step."""
        angles_deg = self._angles(values)
        # A wheel turns by less than half a turn in a step, which is why wrapped angles tell its
        # direction.
        pairs = zip(angles_deg, self._angles_deg, strict=True)
        left_deg, right_deg = (_signed_deg(after - before) for after, before in pairs)
        deg_per_mm = self._base.turn_deg(1.0)
        left_mm = left_deg / deg_per_mm
        right_mm = right_deg / deg_per_mm
        self._angles_deg = angles_deg
        way_mm = (left_mm + right_mm) / 2
        turn = (left_mm - right_mm) / self._base.axle_track_mm
        self._last_step = (way_mm, math.degrees(turn))
        self.pose = self.pose.driven(*self._last_step)

    def truth(self) -> tuple[float, ...]:
        """The `entries` from the true pose of a virtual robot; for a real robot they are
        estimates."""
        pose = self.pose if self._true_pose is None else floor_pose(self._true_pose())
        return (*self._target.place.seen_from(pose), *self._last_step)

    def metrics(self) -> dict[str, float]:
        """Errors of the dead reckoning; empty for a real robot."""
        if self._true_pose is None:
            return {}
        ahead_mm, left_mm, turn_deg = floor_pose(self._true_pose()).seen_from(self.pose)
        return {
            "reckoning_error_mm": math.hypot(ahead_mm, left_mm),
            "reckoning_error_deg": abs(turn_deg),
        }

    def _angles(self, values: Sequence[float]) -> tuple[float, ...]:
        return tuple(values[index] for index in self._wheels)


def floor_pose(pose: Pose) -> FloorPose:
    """The floor pose of a virtual robot's pose."""
    return FloorPose(pose.x_m * 1000, pose.y_m * 1000, pose.heading_deg)


def start_pose(
    scene: Scene,
    task_id: str,
    true_pose: Callable[[], Pose] | None,
    rng: np.random.Generator,
) -> FloorPose:
    """Start pose of an episode: a virtual robot's present one; for a real robot a drawn one, where
    the log asks to put it."""
    if true_pose is not None:
        return floor_pose(true_pose())
    ranges = (*scene.start_mm, scene.heading_deg)
    x_mm, y_mm, heading_deg = (float(rng.uniform(low, high)) for low, high in ranges)
    start = FloorPose(x_mm, y_mm, heading_deg)
    place = (
        f"x = {start.x_mm:.0f} mm, y = {start.y_mm:.0f} mm, turned by {start.heading_deg:.0f} "
        "degrees clockwise"
    )
    _log.warning("%s: put the robot at %s", task_id, place)
    return start


class TrueOdometer:
    """Odometer of a virtual robot over one episode that starts at ``time_s``, along its heading at
    the start."""

    def __init__(
        self,
        pose: Callable[[], Pose],
        time_s: float,
    ) -> None:
        self._pose = pose
        self._start = self._last = pose()
        self._start_s = self._now_s = time_s
        self._path_m = self._forward_m = 0.0

    def forward_mm(
        self,
        time_s: float,
        _values: Sequence[float],
    ) -> float:
        """Distance forward since the last call, in mm; ``time_s`` is the time of this one."""
        pose = self._pose()
        moved_x_m = pose.x_m - self._last.x_m
        moved_y_m = pose.y_m - self._last.y_m
        self._path_m += math.hypot(moved_x_m, moved_y_m)
        x_m = pose.x_m - self._start.x_m
        y_m = pose.y_m - self._start.y_m
        # Headings are clockwise, but y points to the left.
        heading = math.radians(self._start.heading_deg)
        forward_m = x_m * math.cos(heading) - y_m * math.sin(heading)
        step_mm = (forward_m - self._forward_m) * 1000
        self._forward_m = forward_m
        self._last = pose
        self._now_s = time_s
        return step_mm

    def metrics(self) -> dict[str, float]:
        """Metrics of the episode's motion; straightness is the distance forward over the path
        length, at most 1."""
        time_s = self._now_s - self._start_s
        # Before the first step, neither time nor way has passed.
        speed_m_s = self._forward_m / time_s if time_s > 0 else 0.0
        straightness = self._forward_m / self._path_m if self._path_m > 0 else 0.0
        return {
            "forward_m": self._forward_m,
            "forward_speed_m_s": speed_m_s,
            "straightness": straightness,
            "turned_deg": self._last.heading_deg - self._start.heading_deg,
        }


class SonarOdometer:
    """Odometer of a real robot that walks towards a wall, over one episode, from its ultrasonic
    distance.

    It measures nothing while the wall is out of range, and takes a turn for a distance.
    """

    def __init__(self, interface: Interface) -> None:
        self._column = interface.distance_index
        self._last_mm = Distance.FARTHEST_MM

    def forward_mm(
        self,
        _time_s: float,
        values: Sequence[float],
    ) -> float:
        """Decrease of the distance to the wall since the last call, in mm; 0 where it was out of
        range."""
        now_mm = Distance.FARTHEST_MM if self._column is None else values[self._column]
        # A sensor that hears no echo reads the farthest distance, which is no measurement.
        in_range = max(now_mm, self._last_mm) < Distance.FARTHEST_MM
        step_mm = self._last_mm - now_mm if in_range else 0.0
        self._last_mm = now_mm
        return step_mm

    def metrics(self) -> dict[str, float]:
        """Empty: an estimate is not reported as a measurement."""
        return {}


Odometer = TrueOdometer | SonarOdometer
