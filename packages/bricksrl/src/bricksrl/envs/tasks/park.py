"""The 2Wheeler parks: it drives into a bay, straightens up and stands still there.

A step is 200 ms of driving. The robot starts 0.3 to 0.6 m in front of the bay, up to 0.15 m to one
side and turned by up to 40 degrees. From then on it computes the position of the bay from its wheel
angles. Its position is that of the axle's middle.

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

`target_ahead` and `target_left` are the position of the bay's middle in the robot's frame,
`target_turn` is the clockwise turn to the bay's heading, `moved` and `turned` are the motion of the
last step. The wheels reach a new speed about 80 ms late: nearly half of a step's motion is due to
the previous command, which is therefore observed.

## Reward

The robot cannot drive sideways: it has to face the bay, forwards or backwards, drive there, and
turn to the bay's heading. The cost of a pose is 1 for each 100 mm of distance d, and 1 for each 60
degrees of these two turns, which take about as long. The detour, by which the two turns exceed the
direct turn to the bay's heading, is weighted by 1 / (1 + (25 mm / d)^4), as it vanishes in the
bay's middle. More than 25 mm from there, some step decreases the cost for any heading. The reward
is 5 times the decrease of the cost in the step, minus 0.6 for the time.

## End of an episode

| End        | When                                                                                                   |
|------------|--------------------------------------------------------------------------------------------------------|
| terminated | parked: within 15 mm and 4 degrees, and in the last step moved by up to 3 mm and turned by up to 2 degrees |
| truncated  | after 100 steps                                                                                        |

## Success and metrics

An episode succeeds when the robot stands within 20 mm and 5 degrees at its end. The metrics are the
remaining errors, `final_error_mm` and `final_error_deg`. The limits of termination are narrower, as
wheels slip and dead reckoning is inexact. For a virtual robot, success and metrics use its true
pose; `reckoning_error_mm` and `reckoning_error_deg` are the errors of dead reckoning.
"""  # noqa: E501

from brickhub.hub.interface import DriveSpeed, DriveTurnRate, Interface, MotorAngle, Wait
from bricksrl.envs.odometry import Target
from bricksrl.envs.task import Task, Tensor
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.objects import Field, Line
from bricktwin.twin.scene import Scene

PARKED_MM = 15.0
PARKED_DEG = 4.0
"""Tolerances by dead reckoning, at which an episode ends."""
WITHIN_MM = 20.0
WITHIN_DEG = 5.0
"""Tolerances by the true pose if it is known: wheels slip by about 5 mm on the way."""
REST_MM = 3.0
REST_DEG = 2.0
"""Largest motion in the last step of a robot at rest."""
_UNIT_MM = 100.0
_UNIT_DEG = 60.0
_NEAR_MM = 25.0
_GAIN = 5.0
_TIME_COST = 0.6
_BAY = (220.0, 200.0)
_AHEAD, _LEFT, _TURN, _MOVED, _TURNED = (slice(place - 5, place - 4 or None) for place in range(5))


def _distance_mm(observation: Tensor) -> Tensor:
    distance_mm: Tensor = observation[..., -5:-3].norm(dim=-1, keepdim=True)
    return distance_mm


def _heading_error_deg(observation: Tensor) -> Tensor:
    return observation[..., _TURN].abs()


def _detour_deg(observation: Tensor) -> Tensor:
    """Additional turn of a robot that faces the bay first, forwards or backwards, over a turn to
    the bay's heading."""
    ahead_mm = observation[..., _AHEAD]
    left_mm = observation[..., _LEFT]
    turn_deg = observation[..., _TURN]
    bearing_deg = -left_mm.atan2(ahead_mm).rad2deg()
    turns_deg = [
        (_wrapped(first).abs() + _wrapped(turn_deg - first).abs())
        for first in (bearing_deg, bearing_deg + 180.0)
    ]
    return turns_deg[0].minimum(turns_deg[1]) - turn_deg.abs()


def _wrapped(angle_deg: Tensor) -> Tensor:
    return (angle_deg + 180.0).remainder(360.0) - 180.0


def cost(observation: Tensor) -> Tensor:
    """Cost of the remaining distance and turns; ``[*batch, 1]``."""
    distance_mm = _distance_mm(observation)
    share = 1.0 / (1.0 + (_NEAR_MM / distance_mm) ** 4)
    return (
        distance_mm / _UNIT_MM
        + (_heading_error_deg(observation) + share * _detour_deg(observation)) / _UNIT_DEG
    )


def reward(previous: Tensor, _action: Tensor, observation: Tensor) -> Tensor:
    """Decrease of the cost by the step, less a cost of time; ``[*batch, 1]``."""
    return _GAIN * (cost(previous) - cost(observation)) - _TIME_COST


def parked(
    observation: Tensor,
    within_mm: float = PARKED_MM,
    within_deg: float = PARKED_DEG,
) -> Tensor:
    """Whether the robot stands in the bay, at rest; bool ``[*batch, 1]``."""
    in_bay = (_distance_mm(observation) <= within_mm) & (
        _heading_error_deg(observation) <= within_deg
    )
    at_rest = (observation[..., _MOVED].abs() <= REST_MM) & (
        observation[..., _TURNED].abs() <= REST_DEG
    )
    return in_bay & at_rest


def success(observations: Tensor) -> Tensor:
    """True if the robot stands in the bay at the end of the episode ``[*batch, steps, n]``; bool
    ``[*batch]``."""
    return parked(observations[..., -1, :], WITHIN_MM, WITHIN_DEG)[..., 0]


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """Errors at the end of the episode ``[*batch, steps, n]``; ``[*batch]``."""
    last = observations[..., -1, :]
    return {
        "final_error_mm": _distance_mm(last)[..., 0],
        "final_error_deg": _heading_error_deg(last)[..., 0],
    }


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
            Line(
                tuple(
                    (x * _BAY[0] / 2, y * _BAY[1] / 2)
                    for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1))
                ),
                12.0,
                "yellow",
            ),
        ),
        start_mm=((-550.0, -300.0), (-150.0, 150.0)),
        heading_deg=(-40.0, 40.0),
    ),
)
