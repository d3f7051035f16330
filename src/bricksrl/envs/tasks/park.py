"""The 2Wheeler parks: it drives into a bay, straightens up and stands still there.

A step is 100 ms of driving. The robot starts 0.3 to 0.6 m before the bay, to one side of it and askew; from then on it knows by
the turns of its wheels where the bay is. What counts is the middle of its axle.

## Action

| Num | Action        | Min | Max | Drives from | Drives to | Unit  |
|-----|---------------|-----|-----|-------------|-----------|-------|
| 0   | drive_speed   | -1  | 1   | -150        | 150       | mm/s  |
| 1   | turn_rate     | -1  | 1   | -90         | 90        | deg/s |

## Observation

| Num | Observation   | Min  | Max | Unit |
|-----|---------------|------|-----|------|
| 0   | target_ahead  | -200 | 200 | mm   |
| 1   | target_left   | -200 | 200 | mm   |
| 2   | target_turn   | -60  | 60  | deg  |
| 3   | moved         | -20  | 20  | mm   |
| 4   | turned        | -12  | 12  | deg  |

The bay's middle is so far ahead and to the left of the robot, and so far it has to turn, clockwise, to stand straight in it. So
far it drove and turned in its last step.

## Reward

A robot drives ahead and back, not sideways: its way into the bay is an arc of a circle, and one that ends straight in it turns by
twice the angle at which the robot sees the bay. What is left to do is therefore a cost of 1 for each 100 mm of distance d, and of
1 for each 30 degrees of heading; from afar (d over 50 mm) this counts from the heading in which such an arc begins, near the bay
from that of the bay. A turn on the spot and an arc bring it to 0 without a rise between. The reward is 5 times what a step takes
off the cost, less 0.3 for the time.

## End of an episode

| End        | When                                                                                                   |
|------------|--------------------------------------------------------------------------------------------------------|
| terminated | parked: within 15 mm and 4 degrees, and in the last step moved by up to 3 mm and turned by up to 2 degrees |
| truncated  | after 100 steps                                                                                        |

## Success and metrics

An episode succeeds when the robot has parked. By how much wheels slip, what they tell is wrong: with 15 mm and 4 degrees by their
account it stands within 20 mm and 5 degrees. The metrics are what is left by that account, `final_error_mm` and
`final_error_deg`; a virtual robot adds what is left in truth, `true_error_mm` and `true_error_deg`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bricksrl.envs.dead_reckoning import Target
from bricksrl.envs.task import Task
from bricksrl.hub.interface import DriveSpeed, DriveTurnRate, Interface, MotorAngle, Wait
from bricksrl.robots import TWO_WHEELER
from bricksrl.twin.objects import Field, Line
from bricksrl.twin.scene import Scene

if TYPE_CHECKING:
    from torch import Tensor

PARKED_MM, PARKED_DEG = 15.0, 4.0
REST_MM, REST_DEG = 3.0, 2.0
"""Of the last step."""
_UNIT_MM, _UNIT_DEG, _NEAR_MM = 100.0, 30.0, 50.0
_GAIN, _OF_TIME = 5.0, 0.3
_BAY = (220.0, 200.0)


def _left_mm(observation: Tensor) -> Tensor:
    left: Tensor = observation[..., 0:2].norm(dim=-1, keepdim=True)
    return left


def _left_deg(observation: Tensor) -> Tensor:
    return observation[..., 2:3].abs()


def _off_arc_deg(observation: Tensor) -> Tensor:
    """By how much the robot would have to turn to be able to drive into the bay along one arc, ahead or back."""
    arc = -2.0 * observation[..., 1:2].atan2(observation[..., 0:1]).rad2deg()
    off: Tensor = ((arc - observation[..., 2:3] + 180.0).remainder(360.0) - 180.0).abs()
    return off


def cost(observation: Tensor) -> Tensor:
    """What is left to do; ``[*batch, 1]``."""
    left_mm = _left_mm(observation)
    far = left_mm**2 / (left_mm**2 + _NEAR_MM**2)
    heading_deg = far * _off_arc_deg(observation) + (1.0 - far) * _left_deg(observation)
    return left_mm / _UNIT_MM + heading_deg / _UNIT_DEG


def reward(previous: Tensor, _action: Tensor, observation: Tensor) -> Tensor:
    """What the step takes off the cost, less its time; ``[*batch, 1]``."""
    return _GAIN * (cost(previous) - cost(observation)) - _OF_TIME


def parked(observation: Tensor) -> Tensor:
    """Whether the robot stands in the bay; bool ``[*batch, 1]``."""
    is_there = (_left_mm(observation) <= PARKED_MM) & (_left_deg(observation) <= PARKED_DEG)
    rests = (observation[..., 3:4].abs() <= REST_MM) & (observation[..., 4:5].abs() <= REST_DEG)
    return is_there & rests


def success(observations: Tensor) -> Tensor:
    """True if the robot has parked at the end of the episode ``[*batch, steps, n]``; bool ``[*batch]``."""
    return parked(observations[..., -1, :])[..., 0]


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """What is left at the end of the episode ``[*batch, steps, n]``; ``[*batch]``."""
    last = observations[..., -1, :]
    return {"final_error_mm": _left_mm(last)[..., 0], "final_error_deg": _left_deg(last)[..., 0]}


PARK = Task(
    id="Park-v0",
    doc=__doc__,
    robot=TWO_WHEELER,
    interface=Interface(
        commands=(DriveSpeed(-150, 150), DriveTurnRate(-90, 90)),
        channels=(MotorAngle("left"), MotorAngle("right")),
        settle=Wait(100),
    ),
    max_steps=100,
    reward=reward,
    success=success,
    metrics=metrics,
    terminated=parked,
    target=Target(),
    scene=Scene(
        objects=(
            Field((0.0, 0.0), _BAY, "light_grey"),
            Line(tuple((x * _BAY[0] / 2, y * _BAY[1] / 2) for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1))), 12.0, "yellow"),
        ),
        start_mm=((-550.0, -300.0), (-150.0, 150.0)),
        heading_deg=(-40.0, 40.0),
    ),
)
