"""The 2Wheeler spins on the spot, in the direction that is drawn at the start of the episode.

Each action turns both wheels by an angle, at 400 deg/s; the next observation is taken 100 ms after
the turn began, whether it has ended or not. The floor is open.

## Action

| Num | Action | Min | Max | Turns from | Turns to | Unit |
|-----|--------|-----|-----|------------|----------|------|
| 0   | left   | -1  | 1   | -100       | 100      | deg  |
| 1   | right  | -1  | 1   | -100       | 100      | deg  |

## Observation

| Num | Observation | Min  | Max | Unit  |
|-----|-------------|------|-----|-------|
| 0   | left_angle  | 0    | 360 | deg   |
| 1   | right_angle | 0    | 360 | deg   |
| 2   | pitch       | -90  | 90  | deg   |
| 3   | roll        | -90  | 90  | deg   |
| 4   | yaw_rate    | -100 | 100 | deg/s |
| 5   | direction   | 0    | 1   |       |

Wheel angles are wrapped into 0..360. Nose down is positive pitch. The yaw rate is positive to the
left (counter-clockwise from above); its range is nominal: a good policy turns faster, and the value
is reported as it is. Direction 0 asks for a spin to the left, 1 to the right.

## Reward

The yaw rate in deg/s, negated when the direction is 1.

## End of an episode

| End        | When           |
|------------|----------------|
| truncated  | after 50 steps |

## Success and metrics

The paper defines no success for this task. Here an episode succeeds when the mean yaw rate in the
commanded direction is 100 deg/s or more. That mean, negative for the wrong direction, is the metric
`mean_yaw_rate_deg_s`.

With the option `robot=ev3-driver`, whose brick has no IMU, pitch and roll are missing, and the yaw
rate is that of its gyro sensor.
"""

from brickhub.hub.interface import Interface, MotorAngle, Pitch, Roll, RunAngle, Wait, YawRate
from bricksrl.envs.task import SampledEntry, Task, Tensor
from bricktwin.robots import TWO_WHEELER

SUCCESS_DEG_S = 100.0
"""Least mean yaw rate of a successful episode."""

# The last entries of an observation; a robot without an IMU has fewer before them.
_YAW_RATE = slice(-2, -1)
_DIRECTION = slice(-1, None)


def reward(
    _previous: Tensor,
    _action: Tensor,
    observation: Tensor,
) -> Tensor:
    """The yaw rate in the commanded direction in deg/s; ``[*batch, 1]``."""
    return _rate_in_direction(observation)


def success(observations: Tensor) -> Tensor:
    """True if the episode ``[*batch, steps, n]`` spun fast enough, the right way round; bool
    ``[*batch]``."""
    return _mean_yaw_rate_deg_s(observations) >= SUCCESS_DEG_S


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """The mean yaw rate in the commanded direction over the episode ``[*batch, steps, n]``;
    ``[*batch]``."""
    return {"mean_yaw_rate_deg_s": _mean_yaw_rate_deg_s(observations)}


def _mean_yaw_rate_deg_s(observations: Tensor) -> Tensor:
    return _rate_in_direction(observations).mean(dim=(-2, -1))


def _rate_in_direction(observation: Tensor) -> Tensor:
    yaw_rate = observation[..., _YAW_RATE]
    sign = 1 - 2 * observation[..., _DIRECTION]
    return yaw_rate * sign


SPINNING = Task(
    id="Spinning-v0",
    doc=__doc__,
    robot=TWO_WHEELER,
    interface=Interface(
        commands=(RunAngle("left", -100, 100, 400), RunAngle("right", -100, 100, 400)),
        channels=(MotorAngle("left"), MotorAngle("right"), Pitch(), Roll(), YawRate()),
        settle=Wait(100),
    ),
    max_steps=50,
    reward=reward,
    success=success,
    metrics=metrics,
    sampled_entries=(SampledEntry("direction", 0, 1, whole=True),),
)
