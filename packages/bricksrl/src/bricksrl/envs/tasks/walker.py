"""The Walker turns its four leg cranks so that diagonal legs move together.

The hub turns each leg by the commanded angle and answers 250 ms later, whether the legs have
arrived or not. The paper's reward is for large steps and a trot, hardly for progress.

## Action

| Num | Action        | Min | Max | Turns from | Turns to | Unit |
|-----|---------------|-----|-----|------------|----------|------|
| 0   | left_front    | -1  | 1   | -100       | 0        | deg  |
| 1   | right_front   | -1  | 1   | -100       | 0        | deg  |
| 2   | left_back     | -1  | 1   | -100       | 0        | deg  |
| 3   | right_back    | -1  | 1   | -100       | 0        | deg  |

## Observation

| Num | Observation       | Min | Max  | Unit |
|-----|-------------------|-----|------|------|
| 0   | left_front_angle  | 0   | 360  | deg  |
| 1   | right_front_angle | 0   | 360  | deg  |
| 2   | left_back_angle   | 0   | 360  | deg  |
| 3   | right_back_angle  | 0   | 360  | deg  |
| 4   | pitch             | -90 | 90   | deg  |
| 5   | roll              | -90 | 90   | deg  |
| 6   | distance          | 0   | 2000 | mm   |

Leg angles are wrapped into 0..360.

## Reward

`-sum(action)/40 - d(lf, rb)/180 - d(rf, lb)/180 - (180 - d(lf, rf))/180 - (180 - d(lb, rb))/180`
with `d` the shortest angle between two legs, and the action as the agent gave it: 0.1 a step at
best.

## End of an episode

| End        | When                                              |
|------------|---------------------------------------------------|
| terminated | pitch or roll is beyond 60 degrees to either side |
| truncated  | after 100 steps                                   |

While an obstacle is within 40 mm (option `blocked_at_mm`), the robot waits with its motors held and
logs a warning. With the option `step_ms`, the time of a step, an episode has as many steps as fit
into the same 25 seconds, or `max_steps`. With `safe_tilt_deg=180` no tilt ends it.

## Success and metrics

An episode succeeds when the robot trots: it does not fall over, its legs turn by 90 degrees a
second or more, and the four angles of the reward are within 20 degrees of a trot, all on average.
The metric is the mean reward of a step for a trot alone, `mean_gait_reward`, at most 0.
"""

from dataclasses import replace
from functools import partial

from brickhub.fields import check_value
from brickhub.hub.interface import Distance, Interface, MotorAngle, Pitch, Roll, RunAngle, Wait
from bricksrl.envs.task import Task, Tensor
from bricksrl.errors import DescriptionError
from bricktwin.robots import WALKER

STEP_MS = 250
EPISODE_MS = 25_000
SAFE_TILT_DEG = 60.0
"""A Walker that is tilted further has fallen over."""
TROT_WITHIN_DEG = 20.0
"""Largest mean deviation of two legs from a trot, in a successful episode."""
TURNS_DEG_S = 90.0
"""Least mean speed of the legs in a successful episode."""
BLOCKED_AT_MM = 40.0
"""The ultrasonic sensor reports nothing nearer."""

_LEGS = ("left_front", "right_front", "left_back", "right_back")
# These places in the observation come after the four legs.
_TILT = slice(4, 6)
_DISTANCE = slice(6, 7)


def shortest_angle_deg(first: Tensor, second: Tensor) -> Tensor:
    """Angle between two directions, in 0..180 degrees."""
    turn = second - first
    # Whole turns are removed, so that 359 and 1 are 2 degrees apart.
    whole_turns = (turn / 360.0).round_()
    return turn.sub(whole_turns, alpha=360.0).abs_()


def gait_reward(observation: Tensor) -> Tensor:
    """Negative deviation of the legs from a trot, 0 at best; ``[*batch, 1]``."""
    left_front, right_front, left_back, right_back = observation[..., :4].split(1, -1)
    # In a trot, the legs of an axle are half a turn apart and diagonal ones move together.
    apart = shortest_angle_deg(left_front, right_front) + shortest_angle_deg(left_back, right_back)
    together = shortest_angle_deg(left_front, right_back) + shortest_angle_deg(
        right_front, left_back
    )
    return (apart - together) / 180.0 - 2.0


def reward(
    _previous: Tensor,
    action: Tensor,
    observation: Tensor,
) -> Tensor:
    """Reward for large steps in a trot; ``[*batch, 1]``."""
    return gait_reward(observation) - action.sum(-1, keepdim=True) / 40.0


def terminated(observation: Tensor, safe_tilt_deg: float = SAFE_TILT_DEG) -> Tensor:
    """True if the robot has fallen over; bool ``[*batch, 1]``."""
    tilt_deg = observation[..., _TILT].abs()
    return (tilt_deg > safe_tilt_deg).any(-1, keepdim=True)


def mean_turn_deg(observations: Tensor) -> Tensor:
    """Mean angle of a step by which the legs turn forwards in the episode ``[*batch, steps, n]``;
    ``[*batch]``."""
    before = observations[..., :-1, :4]
    after = observations[..., 1:, :4]
    # The difference is reversed, because angles fall as the Walker walks forwards.
    turn = before - after
    whole_turns = (turn / 360.0).round_()
    mean = turn.sub(whole_turns, alpha=360.0).mean((-2, -1))
    # An episode of one step has no turns, whose mean is NaN.
    return mean.nan_to_num(0.0)


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """Mean gait reward of the episode ``[*batch, steps, n]``; ``[*batch]``."""
    rewards = gait_reward(observations)[..., 0]
    return {"mean_gait_reward": rewards.mean(-1)}


INTERFACE = Interface(
    commands=tuple(RunAngle(leg, -100, 0, speed_deg_s=600) for leg in _LEGS),
    channels=(*(MotorAngle(leg) for leg in _LEGS), Pitch(), Roll(), Distance("eyes")),
    settle=Wait(STEP_MS),
)


def timed(env_id: str, step_ms: int) -> tuple[Interface, int]:
    """The interface with steps of ``step_ms``, and the number of steps of an episode. Raises
    DescriptionError if a step takes no whole number of ms, or longer than an episode."""
    check_value("step_ms", step_ms, int)
    if not 1 <= step_ms <= EPISODE_MS:
        raise DescriptionError(f"{env_id}: step_ms is {step_ms}; give 1 to {EPISODE_MS}")
    return replace(INTERFACE, settle=Wait(step_ms)), EPISODE_MS // step_ms


def walker(
    env_id: str,
    *,
    blocked_at_mm: float = BLOCKED_AT_MM,
    step_ms: int = STEP_MS,
    max_steps: int | None = None,
    safe_tilt_deg: float = SAFE_TILT_DEG,
) -> Task:
    """The task, for the robot or for its simulation.

    Args:
        blocked_at_mm: distance at which, and nearer, the robot waits until its way is clear.
        step_ms: time of a step, from the command to the answer.
        max_steps: steps of an episode; by default those of 25 seconds.
        safe_tilt_deg: pitch or roll beyond which the robot has fallen over; 180 for none.

    Raises:
        DescriptionError: the distance or the tilt is negative, there is no step, or a step takes no
            whole number of ms, or longer than 25 seconds.
    """
    interface, steps = timed(env_id, step_ms)
    check_value("max_steps", max_steps, int | None)
    if blocked_at_mm < 0:
        raise DescriptionError(f"{env_id}: blocked_at_mm is {blocked_at_mm}; give 0 or more")
    if max_steps is not None and max_steps < 1:
        raise DescriptionError(f"{env_id}: max_steps is {max_steps}; give 1 or more")
    if not 0 < safe_tilt_deg <= 180:
        raise DescriptionError(
            f"{env_id}: safe_tilt_deg is {safe_tilt_deg}; give more than 0, up to 180"
        )

    has_fallen = partial(terminated, safe_tilt_deg=safe_tilt_deg)

    def success(observations: Tensor) -> Tensor:
        mean_reward = gait_reward(observations)[..., 0].mean(-1)
        # The reward sums the deviations of four pairs of legs in half turns, so the limit is
        # converted to that.
        trots = mean_reward >= -4.0 * TROT_WITHIN_DEG / 180.0
        turns = mean_turn_deg(observations) >= TURNS_DEG_S * step_ms / 1000.0
        falls = has_fallen(observations)[..., 0].any(-1)
        return trots & turns & ~falls

    def blocked(observation: Tensor) -> Tensor:
        return observation[..., _DISTANCE] <= blocked_at_mm

    return Task(
        id=env_id,
        doc=__doc__,
        robot=WALKER,
        interface=interface,
        max_steps=max_steps or steps,
        reward=reward,
        success=success,
        metrics=metrics,
        terminated=has_fallen,
        blocked=blocked,
        walks=True,
        # In v0 agents learn as in the paper, without the mirror.
        symmetric=env_id != "Walker-v0",
    )
