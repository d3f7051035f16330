"""The Walker learns to walk forward: only progress is rewarded, which Walker-v0 hardly rewards.

Robot, actions and leg angles are those of Walker-v0. A further entry of the observation is the
distance of the last step. On a virtual robot it is measured; on a real one it is estimated from the
ultrasonic sensor, so let it walk towards a wall.

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
| 7   | forward           | -100 | 100  | mm   |

## Reward

Distance forward in this step, in units of 20 mm: about 1 a step for a trot at full speed.

## End of an episode

| End        | When                                              |
|------------|---------------------------------------------------|
| terminated | pitch or roll is beyond 60 degrees to either side |
| truncated  | after 100 steps                                   |

With the option `step_ms`, the time of a step, an episode has as many steps as fit into the same 25
seconds. The return is the distance forward in units of 20 mm, whatever the step.

## Success and metrics

An episode succeeds when the robot moves forward by 10 mm in 250 ms of a step on average and does
not fall over. The metric is the mean of a step, `mean_step_mm`; a virtual robot adds its true
distance, speed and straightness.
"""

from typing import Any

from brickhub.entry import Entry
from brickhub.hub.interface import Interface
from bricksrl.envs.task import Task, Tensor
from bricksrl.envs.tasks.walker import STEP_MS, terminated, timed
from bricktwin.robots import WALKER

UNIT_MM = 20.0
"""Distance forward with reward 1."""
SUCCESS_MM_S = 40.0
"""Least mean speed forward of a successful episode, in the steps' own time."""
SETTINGS = {"n_step": 3}
"""A command shows in the distance of the steps after it: returns over 3 steps (`python -m
benchmarks ablation`)."""


def forward_task(
    env_id: str,
    doc: str,
    interface: Interface,
    max_steps: int,
    unit_mm: float,
    **more: Any,
) -> Task:
    """A task with the distance forward behind the channels, which is its reward in ``unit_mm``.
    ``more``: further fields."""
    forward = len(interface.channels)
    least_mm = SUCCESS_MM_S * interface.settle.longest_ms / 1000

    def success(observations: Tensor) -> Tensor:
        fell = terminated(observations)[..., 0].any(-1)
        mean_mm = observations[..., forward].mean(-1)
        return (mean_mm >= least_mm) & ~fell

    return Task(
        id=env_id,
        doc=doc,
        robot=WALKER,
        interface=interface,
        max_steps=max_steps,
        reward=lambda previous, action, observation: (
            observation[..., forward : forward + 1] / unit_mm
        ),
        success=success,
        metrics=lambda observations: {"mean_step_mm": observations[..., forward].mean(-1)},
        terminated=terminated,
        walks=True,
        symmetric=True,
        measured_entries=(
            Entry(
                "forward",
                -100.0,
                100.0,
                "mm",
                limits=(-32767.0, 32767.0),
            ),
        ),
        **more,
    )


def walker_forward(*, step_ms: int = STEP_MS) -> Task:
    """The task.

    Args:
        step_ms: time of a step, from the command to the answer.

    Raises:
        DescriptionError: see `timed`.
    """
    return forward_task(
        "Walker-v1",
        __doc__,
        *timed("Walker-v1", step_ms),
        UNIT_MM,
        settings=SETTINGS,
    )
