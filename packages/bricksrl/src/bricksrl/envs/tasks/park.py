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

# An episode ends by dead reckoning, so these tolerances allow for its errors.
PARKED_MM = 15.0
PARKED_DEG = 4.0
# These tolerances hold for the true pose if it is known, because wheels slip by about 5 mm on the
# way.
WITHIN_MM = 20.0
WITHIN_DEG = 5.0
# A robot at rest moves no more than this in its last step.
REST_MM = 3.0
REST_DEG = 2.0
# Each of these costs 1: a distance, and a turn.
_UNIT_MM = 100.0
_UNIT_DEG = 60.0
_NEAR_MM = 25.0
"""Distance at which a detour counts half; nearer, it hardly counts."""
_GAIN = 5.0
_TIME_COST = 0.6
"""Cost of each step."""
_BAY = (220.0, 200.0)
"""Length and width in mm."""
# The entries of the target are the last ones of an observation, so they are counted from its end.
_AHEAD = slice(-5, -4)
_LEFT = slice(-4, -3)
_TURN = slice(-3, -2)
_MOVED = slice(-2, -1)
_TURNED = slice(-1, None)


def _distance_mm(observation: Tensor) -> Tensor:
    position_mm = observation[..., -5:-3]
    distance_mm: Tensor = position_mm.norm(dim=-1, keepdim=True)
    return distance_mm


def _heading_error_deg(observation: Tensor) -> Tensor:
    return observation[..., _TURN].abs()


def _detour_deg(observation: Tensor) -> Tensor:
    """Additional turn of a robot that faces the bay first, forwards or backwards, over a turn to
    the bay's heading."""
    ahead_mm = observation[..., _AHEAD]
    left_mm = observation[..., _LEFT]
    turn_deg = observation[..., _TURN]
    # The sign is negative because headings are clockwise, but positions to the left are positive.
    bearing_deg = -left_mm.atan2(ahead_mm).rad2deg()
    forwards_deg = _turns_deg(bearing_deg, turn_deg)
    backwards_deg = _turns_deg(bearing_deg + 180.0, turn_deg)
    return forwards_deg.minimum(backwards_deg) - turn_deg.abs()


def _turns_deg(first_deg: Tensor, whole_deg: Tensor) -> Tensor:
    """Sum of a first turn and of what is then left of the whole one."""
    rest_deg = whole_deg - first_deg
    return _wrapped(first_deg).abs() + _wrapped(rest_deg).abs()


def _wrapped(angle_deg: Tensor) -> Tensor:
    return (angle_deg + 180.0).remainder(360.0) - 180.0


def cost(observation: Tensor) -> Tensor:
    """Cost of the remaining distance and turns; ``[*batch, 1]``."""
    distance_mm = _distance_mm(observation)
    share = 1.0 / (1.0 + (_NEAR_MM / distance_mm) ** 4)
    turns_deg = _heading_error_deg(observation) + share * _detour_deg(observation)
    return distance_mm / _UNIT_MM + turns_deg / _UNIT_DEG


def reward(
    previous: Tensor,
    _action: Tensor,
    observation: Tensor,
) -> Tensor:
    """Decrease of the cost by the step, less a cost of time; ``[*batch, 1]``."""
    return _GAIN * (cost(previous) - cost(observation)) - _TIME_COST


def parked(
    observation: Tensor,
    within_mm: float = PARKED_MM,
    within_deg: float = PARKED_DEG,
) -> Tensor:
    """Whether the robot stands in the bay, at rest; bool ``[*batch, 1]``."""
    is_near = _distance_mm(observation) <= within_mm
    is_straight = _heading_error_deg(observation) <= within_deg
    # A robot that only passes through the bay has not parked.
    stands = observation[..., _MOVED].abs() <= REST_MM
    keeps_heading = observation[..., _TURNED].abs() <= REST_DEG
    return is_near & is_straight & stands & keeps_heading


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


_HALF_LENGTH_MM = _BAY[0] / 2
_HALF_WIDTH_MM = _BAY[1] / 2
# The bay has no line at its back, because the robot drives in there.
_BAY_LINE = (
    (-_HALF_LENGTH_MM, _HALF_WIDTH_MM),
    (_HALF_LENGTH_MM, _HALF_WIDTH_MM),
    (_HALF_LENGTH_MM, -_HALF_WIDTH_MM),
    (-_HALF_LENGTH_MM, -_HALF_WIDTH_MM),
)

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
            Line(_BAY_LINE, 12.0, "yellow"),
        ),
        start_mm=((-550.0, -300.0), (-150.0, 150.0)),
        heading_deg=(-40.0, 40.0),
    ),
)
