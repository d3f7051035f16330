"""The 2Wheeler drives away from a wall, whose distance its ultrasonic sensor measures.

Each action is one straight drive; the next observation is taken when the drive has ended. The robot
starts 200 to 300 mm in front of a wall, facing it within 5 degrees, so that only driving backwards
is rewarded.

## Action

| Num | Action        | Min | Max | Drives from | Drives to | Unit |
|-----|---------------|-----|-----|-------------|-----------|------|
| 0   | straight      | -1  | 1   | -100        | 100       | mm   |

## Observation

| Num | Observation   | Min | Max  | Unit |
|-----|---------------|-----|------|------|
| 0   | left_angle    | 0   | 360  | deg  |
| 1   | right_angle   | 0   | 360  | deg  |
| 2   | pitch         | -90 | 90   | deg  |
| 3   | roll          | -90 | 90   | deg  |
| 4   | distance      | 0   | 2000 | mm   |

Wheel angles are wrapped into 0..360. Nose down is positive pitch.

## Reward

+1 when the distance grew in this step, -1 when it shrank, 0 when it stayed or when it is 40 mm or
less.

## End of an episode

| End        | When                                       |
|------------|--------------------------------------------|
| terminated | distance is 2000 mm, the sensor's limit    |
| terminated | distance is 40 mm or less                  |
| truncated  | after 20 steps                             |

With the option `ends_at_wall=false` only 2000 mm end an episode, and coming nearer costs -1 at the
wall too, as the paper words it.

## Success and metrics

The paper defines no success for this task. Here an episode succeeds when it ends 1000 mm or more
from the wall. Reaching 2000 mm is no criterion: it ends the episode, and with it the rewards, so
that the best policy avoids it. The metrics are the last distance, `final_distance_mm`, and the
largest pitch in either direction, `largest_pitch_deg`, as a robot that brakes hard tips over.

With the option `robot=ev3-driver`, whose brick has no IMU, pitch and roll are missing, and its
ultrasonic sensor sees up to 2550 mm.
"""

from dataclasses import replace
from typing import Annotated

from brickhub.fields import check_value
from brickhub.hub.interface import (
    Distance,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    UntilDone,
)
from brickhub.user_files import NotCode
from bricksrl.envs.task import Task, Tensor
from bricksrl.envs.tasks.on_robots import on_robot
from bricktwin.robots import EV3_DRIVER, TWO_WHEELER
from bricktwin.twin.scene import Scene

NEAR_MM = 40.0
"""The ultrasonic sensor reports nothing nearer."""
FAR_MM = 2000.0
"""The ultrasonic sensor reports nothing farther."""
AWAY_MM = 1000.0
"""Least final distance of a successful episode."""

# These are the places of the channels below in an observation. A slice keeps the last dimension.
_PITCH = 2
_DISTANCE = slice(-1, None)


def success(observations: Tensor) -> Tensor:
    """True if the episode ended well away from the wall: bool ``[*batch]``, of its observations
    ``[*batch, steps, n]``, with ``n`` numbers a step."""
    return observations[..., -1, -1] >= AWAY_MM


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """The last distance and the largest pitch of the episode, each ``[*batch]``, of its
    observations ``[*batch, steps, n]``."""
    return {
        **metrics_without_tilt(observations),
        "largest_pitch_deg": observations[..., _PITCH].abs().amax(-1),
    }


def metrics_without_tilt(observations: Tensor) -> dict[str, Tensor]:
    """The last distance of the episode, ``[*batch]``, of observations ``[*batch, steps, n]``."""
    return {"final_distance_mm": observations[..., -1, -1]}


def run_away(
    *,
    ends_at_wall: bool = True,
    robot: Annotated[str, NotCode()] = TWO_WHEELER.name,
) -> Task:
    """The task.

    Args:
        ends_at_wall: whether an episode ends at the wall, without a penalty, as in the paper's
            released code.
        robot: name of the robot that does it, two-wheeler or ev3-driver.
    """
    check_value("ends_at_wall", ends_at_wall, bool)

    def reward(
        previous: Tensor,
        _action: Tensor,
        observation: Tensor,
    ) -> Tensor:
        distance_mm = observation[..., _DISTANCE]
        sign = (distance_mm - previous[..., _DISTANCE]).sign()
        return sign.masked_fill(distance_mm <= NEAR_MM, 0.0) if ends_at_wall else sign

    def terminated(observation: Tensor) -> Tensor:
        distance_mm = observation[..., _DISTANCE]
        at_limit = distance_mm >= FAR_MM
        return at_limit | (distance_mm <= NEAR_MM) if ends_at_wall else at_limit

    task = Task(
        id="RunAway-v0",
        doc=__doc__,
        robot=TWO_WHEELER,
        interface=Interface(
            commands=(DriveStraight(-100, 100),),
            channels=(MotorAngle("left"), MotorAngle("right"), Pitch(), Roll(), Distance("eyes")),
            settle=UntilDone(),
        ),
        max_steps=20,
        reward=reward,
        success=success,
        metrics=metrics,
        terminated=terminated,
        scene=Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-5.0, 5.0)),
    )
    on_it = on_robot(task, robot, (EV3_DRIVER,))
    if not on_it.robot.hub.model.has_imu:
        return replace(on_it, metrics=metrics_without_tilt)
    return on_it


RUN_AWAY = run_away()
"""The task without options."""
