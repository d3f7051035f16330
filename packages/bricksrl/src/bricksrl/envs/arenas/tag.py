"""A 2Wheeler catches another one, which is a little slower, between four walls.

Both start at random places of a floor of 1.6 by 1.6 m, at least 0.6 m apart. An action turns the
two wheels for 250 ms, without waiting; the runner's wheels turn three quarters as far as the
catcher's. The robots' positions come from the simulation, in place of a camera overhead, and the
turns of the wheels from their hubs.

## Action (of each robot)

| Num | Action | Min | Max | Drives from | Drives to | Unit |
|-----|--------|-----|-----|-------------|-----------|------|
| 0   | left   | -1  | 1   | -150        | 150       | deg  |
| 1   | right  | -1  | 1   | -150        | 150       | deg  |

## Observation (of each robot)

| Num | Observation      | Min  | Max | Unit                                     |
|-----|------------------|------|-----|------------------------------------------|
| 0-1 | x, y             | -0.8 | 0.8 | m                                        |
| 2-3 | heading_cos, _sin| -1   | 1   | 1                                        |
| 4-5 | other_ahead, _left | -2.3 | 2.3 | m, seen from the robot                 |
| 6-7 | other_cos, _sin  | -1   | 1   | 1, heading of the other one against its own |
| 8-9 | left_moved, right_moved | -2 | 2 | share of the widest command          |

## Reward

The catcher gets ten times the metres by which it came nearer and 5 when it catches the runner; the
runner gets the opposite.

## End of an episode

| End        | When                                            |
|------------|-------------------------------------------------|
| terminated | the middles of the axles are within 0.2 m       |
| truncated  | after 80 steps, or when the link to a robot breaks |

The catcher succeeds when it catches the runner.
"""

import math

import torch
from torch import Tensor

from brickhub.entry import Entry
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from bricksrl.envs.arenas.arena_task import (
    ArenaState,
    ArenaTask,
    own_pose,
    seen_from,
    steer_towards,
)
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.arena import Arena, Contestant, Place

HALF_M = 0.8
CAUGHT_M = 0.2
CATCHER = 0
RUNNER = 1
STEP_MS = 250
_TRAVEL_DEG = (150.0, 112.0)
_SPEED_DEG_S = 900
_STEP_M = (0.073, 0.055)
"""Largest travel of the catcher and the runner in a step, with wheels of 56 mm."""
_TURN_RAD = 0.7
"""Approximate angle by which the runner turns in place in a step, including acceleration."""
_REACH_M = 0.73
"""Largest distance of a robot from the middle along x and y; the walls are at 0.8 m."""
_DIRECTIONS = 16
_LOOK_STEPS = 16
_CATCH_REWARD = 5.0
_REWARD_PER_M = 10.0

_FARTHEST_M = 2.3
"""Distance that is larger than the diagonal between the walls."""

ENTRIES = (
    Entry("x", -HALF_M, HALF_M, "m"),
    Entry("y", -HALF_M, HALF_M, "m"),
    Entry("heading_cos", -1.0, 1.0),
    Entry("heading_sin", -1.0, 1.0),
    Entry(
        "other_ahead",
        -_FARTHEST_M,
        _FARTHEST_M,
        "m",
    ),
    Entry(
        "other_left",
        -_FARTHEST_M,
        _FARTHEST_M,
        "m",
    ),
    Entry("other_cos", -1.0, 1.0),
    Entry("other_sin", -1.0, 1.0),
    Entry("left_moved", -2.0, 2.0),
    Entry("right_moved", -2.0, 2.0),
)


def distance_m(state: ArenaState) -> Tensor:
    """Distance of the two robots, ``[*batch, 1]``."""
    catcher = state.poses[..., CATCHER, :2]
    runner = state.poses[..., RUNNER, :2]
    apart = catcher - runner
    length_m: Tensor = apart.norm(dim=-1, keepdim=True)
    return length_m


def observe(state: ArenaState) -> Tensor:
    """Observations of catcher and runner, ``[*batch, 2, 10]``."""
    views = [_view(state, CATCHER, RUNNER), _view(state, RUNNER, CATCHER)]
    return torch.stack(views, -2)


def _view(
    state: ArenaState,
    robot: int,
    other: int,
) -> Tensor:
    """Observation of a robot, ``[*batch, 10]``."""
    parts = (
        own_pose(state.poses, robot),
        seen_from(state.poses, robot, other),
        state.moved[..., robot, :],
    )
    return torch.cat(parts, -1)


def caught(state: ArenaState) -> Tensor:
    """True if the runner is caught; bool ``[*batch, 1]``."""
    near: Tensor = distance_m(state) <= CAUGHT_M
    return near


def reward(before: ArenaState, after: ArenaState) -> Tensor:
    """Rewards of catcher and runner, ``[*batch, 2, 1]``; their sum is 0."""
    nearer_m = distance_m(before) - distance_m(after)
    gain = _REWARD_PER_M * nearer_m + _CATCH_REWARD * caught(after)
    return torch.stack((gain, -gain), -2)


def flee(observation: Tensor) -> Tensor:
    """The runner's script, ``[*batch, 10]`` to ``[*batch, 2]``. Of 16 directions it takes the one
    in which it is caught latest by a catcher that drives straight at it, if it turns there first,
    drives on and slides along the walls."""
    start = observation[..., 0:2]
    cos = observation[..., 2]
    sin = observation[..., 3]
    ahead = observation[..., 4]
    left = observation[..., 5]
    numbers = torch.arange(_DIRECTIONS, device=observation.device)
    angles = numbers * (2.0 * math.pi / _DIRECTIONS)
    directions = torch.stack((angles.cos(), angles.sin()), -1)  # [16, 2]
    # The other robot is seen in the runner's frame, but the walls are in the world's.
    x = ahead * cos - left * sin
    y = ahead * sin + left * cos
    offset = torch.stack((x, y), -1)
    runner = _for_each_direction(start)
    catcher = _for_each_direction(start + offset)
    alignment = torch.stack((cos, sin), -1) @ directions.T
    # The runner first needs this many steps to face each way.
    turn_steps = alignment.clamp(-1.0, 1.0).arccos() / _TURN_RAD
    free = torch.ones_like(turn_steps)
    score = torch.zeros_like(turn_steps)
    for step in range(1, _LOOK_STEPS + 1):
        driven = _STEP_M[RUNNER] * (step - turn_steps).clamp(0.0, 1.0)
        runner = (runner + driven.unsqueeze(-1) * directions).clamp(-_REACH_M, _REACH_M)
        gap = runner - catcher
        gap_m = gap.norm(dim=-1)
        # The catcher drives straight at the runner for its step, and not past it.
        share = _STEP_M[CATCHER] / gap_m.clamp_min(_STEP_M[CATCHER])
        catcher = catcher + gap * share.unsqueeze(-1)
        free = free * (gap_m > CAUGHT_M + _STEP_M[CATCHER])
        # A later catch is better, and among equal ones the way that stays farther away.
        score = score + free * (1.0 + gap_m)
    direction = directions[score.argmax(-1)]
    x = direction[..., 0]
    y = direction[..., 1]
    return steer_towards(x * cos + y * sin, y * cos - x * sin)


def _for_each_direction(position: Tensor) -> Tensor:
    """A position ``[*batch, 2]`` as ``[*batch, 16, 2]``."""
    return position.unsqueeze(-2).expand(*position.shape[:-1], _DIRECTIONS, 2)


def chase(observation: Tensor) -> Tensor:
    """The catcher's script: drive straight at the runner; ``[*batch, 10]`` to ``[*batch, 2]``."""
    ahead = observation[..., 4]
    left = observation[..., 5]
    return steer_towards(ahead, left)


def _interface(travel_deg: float) -> Interface:
    return Interface(
        commands=(
            RunAngle(
                "left",
                -travel_deg,
                travel_deg,
                _SPEED_DEG_S,
            ),
            RunAngle(
                "right",
                -travel_deg,
                travel_deg,
                _SPEED_DEG_S,
            ),
        ),
        channels=(MotorAngle("left"), MotorAngle("right")),
        settle=Wait(STEP_MS),
    )


_ANYWHERE = Place((-0.6, 0.6), (-0.6, 0.6), (-180.0, 180.0))

TAG = ArenaTask(
    id="Tag-v0",
    doc=__doc__,
    arena=Arena(
        robots=(
            Contestant(
                "catcher",
                TWO_WHEELER,
                _ANYWHERE,
                (0.85, 0.15, 0.1),
            ),
            Contestant(
                "runner",
                TWO_WHEELER,
                _ANYWHERE,
                (0.1, 0.3, 0.85),
            ),
        ),
        half_size_m=(HALF_M, HALF_M),
        gap_m=0.6,
    ),
    interfaces=tuple(_interface(travel_deg) for travel_deg in _TRAVEL_DEG),
    groups={"catcher": ("catcher",), "runner": ("runner",)},
    max_steps=80,
    entries=ENTRIES,
    observe=observe,
    reward=reward,
    terminated=caught,
    success=caught,
    scripts={"flee": flee, "chase": chase},
    opponents={"catcher": "chase", "runner": "flee,random"},
)
