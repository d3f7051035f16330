"""The 2Wheeler parks: it drives into a bay, straightens up and stands still there.

A step is 200 ms of driving. The robot starts 0.3 to 0.6 m before the bay, to one side of it and askew; from then on it knows by
the turns of its wheels where the bay is. What counts is the middle of its axle.

## Action

| Num | Action        | Min | Max | Drives from | Drives to | Unit  |
|-----|---------------|-----|-----|-------------|-----------|-------|
| 0   | drive_speed   | -1  | 1   | -100        | 100       | mm/s  |
| 1   | turn_rate     | -1  | 1   | -60         | 60        | deg/s |

## Observation

| Num | Observation      | Min  | Max | Unit  |
|-----|------------------|------|-----|-------|
| 0   | last_drive_speed | -100 | 100 | mm/s  |
| 1   | last_turn_rate   | -60  | 60  | deg/s |
| 2   | target_ahead     | -100 | 100 | mm    |
| 3   | target_left      | -100 | 100 | mm    |
| 4   | target_turn      | -30  | 30  | deg   |
| 5   | moved            | -20  | 20  | mm    |
| 6   | turned           | -12  | 12  | deg   |

The bay's middle is so far ahead and to the left of the robot, and so far it has to turn, clockwise, to stand straight in it. So
far it drove and turned in its last step. The wheels come to a new speed about 80 ms late: near to half of what a step does is the
command before, which has to be known.

## Reward

A robot drives ahead and back, not sideways: it has to face the bay, ahead or back, drive there, and turn to its heading. What is
left to do is a cost of 1 for each 100 mm of distance d, and of 1 for each 60 degrees of these two turns, which take it about as
long. What the two exceed the one turn from heading to heading by is counted 1 / (1 + (25 mm / d)^4) times: near the bay's middle
there is nothing to face. So more than 25 mm from it there is always a step that lessens the cost, however askew the robot stands.
The reward is 5 times what a step takes off it, less 0.6 for the time.

## End of an episode

| End        | When                                                                                                   |
|------------|--------------------------------------------------------------------------------------------------------|
| terminated | parked: within 15 mm and 4 degrees, and in the last step moved by up to 3 mm and turned by up to 2 degrees |
| truncated  | after 100 steps                                                                                        |

## Success and metrics

An episode succeeds when the robot stands within 20 mm and 5 degrees at its end. The metrics are what is left, `final_error_mm`
and `final_error_deg`. Wheels slip, and by so much what they tell is wrong; hence the narrower limits of the end. Of a virtual
robot the truth is known: success and metrics are by it, and `reckoning_error_mm` and `reckoning_error_deg` say how wrong the
wheels were.
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
"""Tolerances by dead reckoning, at which an episode ends."""
WITHIN_MM, WITHIN_DEG = 20.0, 5.0
"""Tolerances by the true pose if it is known: wheels slip by about 5 mm on the way."""
REST_MM, REST_DEG = 3.0, 2.0
"""Largest motion in the last step of a robot at rest."""
_UNIT_MM, _UNIT_DEG, _NEAR_MM = 100.0, 60.0, 25.0
_GAIN, _OF_TIME = 5.0, 0.6
_BAY = (220.0, 200.0)
_AHEAD, _LEFT, _TURN, _MOVED, _TURNED = (slice(place - 5, place - 4 or None) for place in range(5))


def _left_mm(observation: Tensor) -> Tensor:
    left: Tensor = observation[..., -5:-3].norm(dim=-1, keepdim=True)
    return left


def _left_deg(observation: Tensor) -> Tensor:
    return observation[..., _TURN].abs()


def _detour_deg(observation: Tensor) -> Tensor:
    """Additional turn of a robot that faces the bay first, forwards or backwards, over a turn to the bay's heading."""
    ahead_mm, left_mm, turn_deg = observation[..., _AHEAD], observation[..., _LEFT], observation[..., _TURN]
    there_deg = -left_mm.atan2(ahead_mm).rad2deg()
    ways = [(_wrapped(first).abs() + _wrapped(turn_deg - first).abs()) for first in (there_deg, there_deg + 180.0)]
    return ways[0].minimum(ways[1]) - turn_deg.abs()


def _wrapped(angle_deg: Tensor) -> Tensor:
    return (angle_deg + 180.0).remainder(360.0) - 180.0


def cost(observation: Tensor) -> Tensor:
    """Cost of the remaining way and turns; ``[*batch, 1]``."""
    left_mm = _left_mm(observation)
    far = 1.0 / (1.0 + (_NEAR_MM / left_mm) ** 4)
    return left_mm / _UNIT_MM + (_left_deg(observation) + far * _detour_deg(observation)) / _UNIT_DEG


def reward(previous: Tensor, _action: Tensor, observation: Tensor) -> Tensor:
    """Decrease of the cost by the step, less a cost of time; ``[*batch, 1]``."""
    return _GAIN * (cost(previous) - cost(observation)) - _OF_TIME


def parked(observation: Tensor, within_mm: float = PARKED_MM, within_deg: float = PARKED_DEG) -> Tensor:
    """Whether the robot stands in the bay, at rest; bool ``[*batch, 1]``."""
    is_there = (_left_mm(observation) <= within_mm) & (_left_deg(observation) <= within_deg)
    rests = (observation[..., _MOVED].abs() <= REST_MM) & (observation[..., _TURNED].abs() <= REST_DEG)
    return is_there & rests


def success(observations: Tensor) -> Tensor:
    """True if the robot stands in the bay at the end of the episode ``[*batch, steps, n]``; bool ``[*batch]``."""
    return parked(observations[..., -1, :], WITHIN_MM, WITHIN_DEG)[..., 0]


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """Errors at the end of the episode ``[*batch, steps, n]``; ``[*batch]``."""
    last = observations[..., -1, :]
    return {"final_error_mm": _left_mm(last)[..., 0], "final_error_deg": _left_deg(last)[..., 0]}


PARK = Task(
    id="Park-v0",
    doc=__doc__,
    robot=TWO_WHEELER,
    interface=Interface(
        commands=(DriveSpeed(-100, 100), DriveTurnRate(-60, 60)),
        channels=(MotorAngle("left"), MotorAngle("right")),
        settle=Wait(200),
    ),
    max_steps=100,
    reward=reward,
    success=success,
    metrics=metrics,
    terminated=parked,
    observes_commands=True,
    target=Target(range_mm=100.0, range_deg=30.0),
    scene=Scene(
        objects=(
            Field((0.0, 0.0), _BAY, "light_grey"),
            Line(tuple((x * _BAY[0] / 2, y * _BAY[1] / 2) for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1))), 12.0, "yellow"),
        ),
        start_mm=((-550.0, -300.0), (-150.0, 150.0)),
        heading_deg=(-40.0, 40.0),
    ),
)
