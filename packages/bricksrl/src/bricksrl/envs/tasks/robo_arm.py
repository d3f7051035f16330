"""The RoboArm moves its four joints to angles that are drawn for each episode.

The hub turns each joint by the commanded angle, within the joint's range, and answers 250 ms later.

## Action

| Num | Action        | Min | Max | Turns from | Turns to | Unit |
|-----|---------------|-----|-----|------------|----------|------|
| 0   | rotation      | -1  | 1   | -100       | 100      | deg  |
| 1   | low           | -1  | 1   | -30        | 30       | deg  |
| 2   | high          | -1  | 1   | -60        | 60       | deg  |
| 3   | grab          | -1  | 1   | -25        | 25       | deg  |

## Observation

| Num | Observation    | Min  | Max | Unit |
|-----|----------------|------|-----|------|
| 0   | rotation_angle | 0    | 360 | deg  |
| 1   | low_angle      | 10   | 70  | deg  |
| 2   | high_angle     | -150 | 10  | deg  |
| 3   | grab_angle     | -148 | -45 | deg  |
| 4   | rotation_goal  | 0    | 360 | deg  |
| 5   | low_goal       | 10   | 70  | deg  |
| 6   | high_goal      | -150 | 10  | deg  |
| 7   | grab_goal      | -148 | -45 | deg  |

The rotation is wrapped into 0..360. A joint may yield a little beyond its range.

## Reward

Minus the sum of the four shortest angles between joints and goals, divided by 100. With
`sparse=True` it is 1 if that sum is below the threshold, else 0.

## End of an episode

| End        | When                                                  |
|------------|-------------------------------------------------------|
| terminated | the sum of the four angles is under 50 degrees        |
| truncated  | after 100 steps                                       |

## Success and metrics

An episode succeeds when it reaches the goal. The metric is the sum of the four joints' angles to
their goals at the end, `error_sum_deg`.
"""

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from bricksrl.envs.task import SampledEntry, Task, Tensor
from bricksrl.envs.tasks.walker import shortest_angle_deg
from bricksrl.errors import DescriptionError
from bricktwin.robots import ROBO_ARM

THRESHOLD_DEG = 50.0
"""Sum of the four errors under which a goal counts as reached."""

_TURNS_DEG = {"rotation": 100, "low": 30, "high": 60, "grab": 25}
"""Largest turn of each joint in a step."""


def _channel(name: str) -> MotorAngle:
    """The angle of a joint in its range; the endless one is 0..360 degrees."""
    low_deg, high_deg = ROBO_ARM.motor(name).range_deg or (0, 360)
    return MotorAngle(name, float(low_deg), float(high_deg))


_CHANNELS = tuple(_channel(motor.name) for motor in ROBO_ARM.motors)
_COMMANDS = tuple(RunAngle(name, -turn, turn, speed_deg_s=250) for name, turn in _TURNS_DEG.items())

INTERFACE = Interface(
    commands=_COMMANDS,
    channels=_CHANNELS,
    settle=Wait(250),
)

_GOALS = tuple(
    SampledEntry(
        f"{channel.motor}_goal",
        channel.low,
        channel.high,
        "deg",
        wraps=channel.wraps,
    )
    for channel in _CHANNELS
)


def error_deg(observation: Tensor) -> Tensor:
    """Sum of the angles between joints and goals; ``[*batch, 1]``."""
    joints = observation[..., :4]
    goals = observation[..., 4:]
    return shortest_angle_deg(joints, goals).sum(-1, keepdim=True)


def robo_arm(
    env_id: str,
    *,
    sparse: bool = False,
    threshold_deg: float = THRESHOLD_DEG,
) -> Task:
    """The task with its options.

    Args:
        sparse: reward 1 at the goal and 0 elsewhere.
        threshold_deg: sum of the errors under which the goal is reached.

    Raises:
        DescriptionError: the threshold is not positive.
    """
    if not threshold_deg > 0:
        raise DescriptionError(
            f"{env_id}: a threshold of {threshold_deg} degrees is never reached; give a "
            "positive one"
        )

    def terminated(observation: Tensor) -> Tensor:
        return error_deg(observation) < threshold_deg

    def reward(
        _previous: Tensor,
        _action: Tensor,
        observation: Tensor,
    ) -> Tensor:
        if sparse:
            return terminated(observation).to(observation.dtype)
        return -error_deg(observation) / 100.0

    def success(observations: Tensor) -> Tensor:
        last = observations[..., -1, :]
        return terminated(last)[..., 0]

    def metrics(observations: Tensor) -> dict[str, Tensor]:
        last = observations[..., -1, :]
        return {"error_sum_deg": error_deg(last)[..., 0]}

    return Task(
        id=env_id,
        doc=__doc__,
        robot=ROBO_ARM,
        interface=INTERFACE,
        max_steps=100,
        reward=reward,
        success=success,
        metrics=metrics,
        terminated=terminated,
        sampled_entries=_GOALS,
    )
