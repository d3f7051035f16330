"""The Walker learns to walk in steps of 100 ms, which its hub streams: faster than in Walker-v1,
and within five minutes.

Robot and actions are those of Walker-v1. With an exchange for each step, a step of 100 ms takes 185
ms over a link as Linux has it. Streamed, it takes 101 ms, and a command reaches the legs so late
that half of a step is still the command before: the last commands are observed. So is the heading,
as a robot that has turned gets less for the same step.

## Action

| Num | Action        | Min | Max | Turns from | Turns to | Unit |
|-----|---------------|-----|-----|------------|----------|------|
| 0   | left_front    | -1  | 1   | -100       | 0        | deg  |
| 1   | right_front   | -1  | 1   | -100       | 0        | deg  |
| 2   | left_back     | -1  | 1   | -100       | 0        | deg  |
| 3   | right_back    | -1  | 1   | -100       | 0        | deg  |

## Observation

| Num | Observation       | Min  | Max  | Unit |
|-----|-------------------|------|------|------|
| 0   | left_front_angle  | 0    | 360  | deg  |
| 1   | right_front_angle | 0    | 360  | deg  |
| 2   | left_back_angle   | 0    | 360  | deg  |
| 3   | right_back_angle  | 0    | 360  | deg  |
| 4   | pitch             | -90  | 90   | deg  |
| 5   | roll              | -90  | 90   | deg  |
| 6   | distance          | 0    | 2000 | mm   |
| 7   | heading           | -180 | 180  | deg  |
| 8   | forward           | -100 | 100  | mm   |
| 9   | last_left_front   | -100 | 0    | deg  |
| 10  | last_right_front  | -100 | 0    | deg  |
| 11  | last_left_back    | -100 | 0    | deg  |
| 12  | last_right_back   | -100 | 0    | deg  |

The heading counts from the start of the episode. `forward` is measured as in Walker-v1, along that
start; the last commands are 0 after a reset.

## Reward

Distance forward in this step, in units of 8 mm: for the same speed as much a step as in Walker-v1,
1.3 for a good gait.

## End of an episode

| End        | When                                              |
|------------|---------------------------------------------------|
| terminated | pitch or roll is beyond 60 degrees to either side |
| truncated  | after 250 steps                                   |

## Success and metrics

As in Walker-v1: an episode succeeds at 40 mm/s or more on average without a fall. The metric is the
mean of a step, `mean_step_mm`; a virtual robot adds its true distance, speed and straightness.
"""

import math
from dataclasses import replace

from brickhub.hub.interface import Heading
from bricksrl.envs.tasks import walker
from bricksrl.envs.tasks.walker_forward import UNIT_MM, forward_task

STEP_MS = 100
_SHARE = STEP_MS / walker.STEP_MS
SETTINGS = {
    "gamma": 0.95**_SHARE,
    "n_step": math.ceil(1 / _SHARE),
    "target_entropy": -1.0 - math.log(_SHARE) / 2,
    "min_scale": 0.1 / math.sqrt(_SHARE),
    "trial_steps": 25,
    "settle_steps": 10,
}
"""Defaults of agents, which suit the 250 ms of Walker-v1, as they are in a second: the discount;
the steps whose rewards are summed; the variance of SAC's noise, as what actions add to a leg's
angle adds up like a random walk; and a trial of a gait, whose steps of 250 ms take some 320 over a
link. `python -m benchmarks step_times` measures what they give."""

_INTERFACE, _MAX_STEPS = walker.timed("Walker-v2", STEP_MS)
WALKER_STREAMED = forward_task(
    "Walker-v2",
    __doc__,
    replace(_INTERFACE, channels=(*_INTERFACE.channels, Heading())),
    _MAX_STEPS,
    UNIT_MM * _SHARE,
    streams=True,
    observes_commands=True,
    settings=SETTINGS,
)
