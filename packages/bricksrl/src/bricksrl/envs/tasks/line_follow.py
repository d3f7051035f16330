"""The scout follows the left edge of a black line with its color sensor, clockwise around a course
with curves to both sides.

A step is 60 ms of driving. The robot starts with its sensor near the edge, at a small angle to it.
It observes only the brightness below its sensor, which on the edge is halfway between line and
floor, and its yaw rate.

The hub streams its observations. With a connection interval of 45 ms, a step then takes 90 ms; with
an exchange for each step it would take 135 ms, and even the hand-written controller loses the line
(return 28.7 instead of 46.4).

## Action

| Num | Action        | Min | Max | Drives from | Drives to | Unit  |
|-----|---------------|-----|-----|-------------|-----------|-------|
| 0   | drive_speed   | -1  | 1   | 40          | 100       | mm/s  |
| 1   | turn_rate     | -1  | 1   | -45         | 45        | deg/s |

## Observation

| Num | Observation       | Min  | Max | Unit  |
|-----|-------------------|------|-----|-------|
| 0   | light_reflection  | 0    | 100 | %     |
| 1   | yaw_rate          | -100 | 100 | deg/s |

Counter-clockwise is positive for the yaw rate, clockwise for the turn rate. The sensor is 56 mm in
front of the axle and detects the edge within 6 mm to both sides. A turn at 45 deg/s moves it by
about half of that in a step; the sharpest curve needs 26 deg/s at full speed.

## Reward

Nearness to the edge, from 1 at the brightness of the edge to 0 over bare line or bare floor, times
0.5 at the lowest speed to 1 at the highest. A step beside the edge costs 0.25 if the robot turns
back as fast as it can, to the right over the floor and to the left over the line, and up to 0.75 if
it turns away. Turning back is not rewarded, as robots then learn to turn in circles.

## End of an episode

| End       | When              |
|-----------|-------------------|
| truncated | after 100 steps   |

## Success and metrics

The robot follows the line while its sensor detects the edge, neither bare floor nor bare line. An
episode succeeds if it does so in 95 % of the steps. The metrics are the share of these steps,
`on_line_share`, and the mean difference of the brightness from that of the edge, `mean_off_pct`; a
virtual robot adds its distance, speed and straightness.

What a color sensor reads over line and floor depends on its kind, and with it the brightness of the
edge: 38 % for that of SPIKE, 45 % for that of an EV3.

With the option `robot=ev3-driver`, the yaw rate is that of its gyro sensor, and the color sensor is
64 mm in front of the axle.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

from brickhub.hub.interface import (
    DriveSpeed,
    DriveTurnRate,
    Interface,
    SensorReading,
    Wait,
    YawRate,
)
from brickhub.robot.line_edge import LineEdge, edge_of
from brickhub.user_files import NotCode
from bricksrl.envs.task import Task, Tensor
from bricksrl.envs.tasks.on_robots import on_robot
from bricktwin.robots import CART, EV3_DRIVER, SCOUT
from bricktwin.twin.objects import Line
from bricktwin.twin.scene import Scene

SUCCESS_SHARE = 0.95
LINE_MM = 30.0
_RADIUS_MM = 450.0
_LOBES_MM = 80.0
_LOBES = 3


def course() -> tuple[tuple[float, float], ...]:
    """Points of a closed line with curves to both sides, of radii down to 0.22 m; its left edge
    begins at the origin, along x.

    It runs clockwise: a robot that drives straight on leaves it to the left, where a turn to the
    right finds the edge again. Counter-clockwise, the robot would cross the line to a floor that
    looks the same but requires the opposite turn.
    """
    outer_mm = _RADIUS_MM + _LOBES_MM
    points = []
    for step in range(120):
        angle = math.tau * step / 120
        radius_mm = _RADIUS_MM + _LOBES_MM * math.cos(_LOBES * angle)
        x_mm = radius_mm * math.sin(angle)
        y_mm = radius_mm * math.cos(angle) - outer_mm - LINE_MM / 2
        points.append((x_mm, y_mm))
    return tuple(points)


@dataclass(frozen=True)
class FollowedEdge:
    """The task's functions of the readings of an edge.

    Attributes:
        line_edge: the edge as the robot's color sensor reads it.
        is_backwards: whether the robot drives backwards, so that its highest speed is the action
            -1.
    """

    line_edge: LineEdge
    is_backwards: bool = False

    def _off_pct(self, observation: Tensor) -> Tensor:
        return (observation[..., :1] - self.line_edge.edge_pct).abs()

    def reward(
        self,
        _previous: Tensor,
        action: Tensor,
        observation: Tensor,
    ) -> Tensor:
        """Nearness to the edge times a share of the speed, or the turn towards it where it is lost;
        ``[*batch, 1]``."""
        speed = action[..., :1]
        if self.is_backwards:
            speed = -speed
        turn = action[..., 1:2]
        off_pct = self._off_pct(observation)
        near = (1.0 - off_pct / self.line_edge.bare_pct).clamp(min=0.0)
        # Brighter than the edge means left of it, where a turn to the right finds it again.
        side = (observation[..., :1] - self.line_edge.edge_pct).sign()
        back = 0.25 * side * turn - 0.5
        is_lost = off_pct >= self.line_edge.bare_pct
        following = near * (0.75 + 0.25 * speed)
        return following + back * is_lost

    def _on_line_share(self, observations: Tensor) -> Tensor:
        off_pct = self._off_pct(observations)[..., 0]
        is_on_line = off_pct < self.line_edge.bare_pct
        return is_on_line.float().mean(-1)

    def success(self, observations: Tensor) -> Tensor:
        """True if the robot saw the edge for 95 % of the episode ``[*batch, steps, n]``; bool
        ``[*batch]``."""
        return self._on_line_share(observations) >= SUCCESS_SHARE

    def metrics(self, observations: Tensor) -> dict[str, Tensor]:
        """Share of the steps on the line and mean distance from the edge of the episode ``[*batch,
        steps, n]``; ``[*batch]``."""
        off_pct = self._off_pct(observations)[..., 0]
        share = self._on_line_share(observations)
        return {
            "on_line_share": share,
            "mean_off_pct": off_pct.mean(-1),
        }


def as_seen_by(
    task: Task,
    line_edge: LineEdge,
    *,
    is_backwards: bool = False,
) -> Task:
    """The task with the readings of another color sensor, or of a robot that drives backwards."""
    edge = FollowedEdge(line_edge, is_backwards)
    return replace(task, reward=edge.reward, success=edge.success, metrics=edge.metrics)


_SCOUT_EDGE = FollowedEdge(edge_of(SCOUT))
LINE_FOLLOW = Task(
    id="LineFollow-v0",
    doc=__doc__,
    robot=SCOUT,
    interface=Interface(
        commands=(DriveSpeed(40, 100), DriveTurnRate(-45, 45)),
        channels=(
            SensorReading(
                "light",
                "reflection",
                0,
                100,
                "%",
            ),
            YawRate(),
        ),
        settle=Wait(60),
    ),
    streams=True,
    max_steps=100,
    reward=_SCOUT_EDGE.reward,
    success=_SCOUT_EDGE.success,
    metrics=_SCOUT_EDGE.metrics,
    walks=True,
    scene=Scene(
        objects=(Line(course(), width_mm=LINE_MM, closed=True),),
        start_mm=((-60.0, -50.0), (-2.0, 2.0)),
        heading_deg=(-4.0, 4.0),
    ),
)


def line_follow(*, robot: Annotated[str, NotCode()] = SCOUT.name) -> Task:
    """The task.

    Args:
        robot: name of the robot that does it, scout, cart or ev3-driver.
    """
    task = on_robot(LINE_FOLLOW, robot, (CART, EV3_DRIVER))
    edge = edge_of(task.robot)
    # What the very same sensor reads leaves the very same task.
    return task if edge == _SCOUT_EDGE.line_edge else as_seen_by(task, edge)
