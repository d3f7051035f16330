"""Two 2Wheelers push a beam that is too heavy for one.

The beam of 0.7 m lies across, in front of the robots, which start behind its two halves. One robot
alone cannot move it, or turns it about the other end; both together move it, and each has to slow
down when its half is ahead.

## Action (of each robot)

| Num | Action | Min | Max | Drives from | Drives to | Unit |
|-----|--------|-----|-----|-------------|-----------|------|
| 0   | left   | -1  | 1   | -120        | 120       | deg  |
| 1   | right  | -1  | 1   | -120        | 120       | deg  |

## Observation (of each robot)

| Num   | Observation       | Min | Max | Unit                                  |
|-------|-------------------|-----|-----|---------------------------------------|
| 0-1   | x, y              | -2  | 2   | m                                     |
| 2-3   | heading_cos, _sin | -1  | 1   | 1                                     |
| 4-5   | beam_ahead, _left | -2  | 2   | m, seen from the robot                |
| 6-7   | beam_cos, _sin    | -1  | 1   | 1, the beam's heading against its own |
| 8-9   | mate_ahead, _left | -2  | 2   | m, seen from the robot                |
| 10-11 | left_moved, right_moved | -2 | 2 | share of the widest command         |

## Reward

Both get ten times the metres by which the beam's middle moved along x in the step, minus twice the
radians by which the beam turned away from lying across, and 5 when it has arrived.

## End of an episode

| End        | When                                                 |
|------------|------------------------------------------------------|
| terminated | the beam's middle has moved 0.4 m along x            |
| terminated | the beam has turned by more than 45 degrees          |
| truncated  | after 60 steps, or when the link to a robot breaks   |

An episode succeeds when the beam has arrived.
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
from bricktwin.twin.arena import Arena, Contestant, Load, Place

START_M = 0.12
GOAL_M = 0.52
"""Position of the beam's middle along x, at the start and at the goal."""
MAX_TURN = math.radians(45.0)
STEP_MS = 250
_TRAVEL_DEG = 120.0
_BEAM = 2
_ARRIVAL_REWARD = 5.0
_FARTHEST_M = 5.0
"""Distance that no robot drives in an episode: 60 times 120 degrees, with wheels of 56 mm, are 3.5
m."""
_APART_M = (-2.0 * _FARTHEST_M, 2.0 * _FARTHEST_M)

_PLACE_M = (-_FARTHEST_M, _FARTHEST_M)

ENTRIES = (
    # There are no walls, so positions have only nominal ranges.
    Entry("x", -2.0, 2.0, "m", limits=_PLACE_M),
    Entry("y", -2.0, 2.0, "m", limits=_PLACE_M),
    Entry("heading_cos", -1.0, 1.0),
    Entry("heading_sin", -1.0, 1.0),
    Entry(
        "beam_ahead",
        -2.0,
        2.0,
        "m",
        limits=_APART_M,
    ),
    Entry(
        "beam_left",
        -2.0,
        2.0,
        "m",
        limits=_APART_M,
    ),
    Entry("beam_cos", -1.0, 1.0),
    Entry("beam_sin", -1.0, 1.0),
    Entry(
        "mate_ahead",
        -2.0,
        2.0,
        "m",
        limits=_APART_M,
    ),
    Entry(
        "mate_left",
        -2.0,
        2.0,
        "m",
        limits=_APART_M,
    ),
    Entry("left_moved", -2.0, 2.0),
    Entry("right_moved", -2.0, 2.0),
)


def observe(state: ArenaState) -> Tensor:
    """Observations of both robots, ``[*batch, 2, 12]``."""
    return torch.stack([_view(state, robot) for robot in (0, 1)], -2)


def _view(state: ArenaState, robot: int) -> Tensor:
    """Observation of a robot, ``[*batch, 12]``."""
    poses = state.poses
    mate = seen_from(poses, robot, 1 - robot)
    parts = (
        own_pose(poses, robot),
        seen_from(poses, robot, _BEAM),
        mate[..., :2],
        state.moved[..., robot, :],
    )
    return torch.cat(parts, -1)


def arrived(state: ArenaState) -> Tensor:
    """True if the beam is at the goal; bool ``[*batch, 1]``."""
    return state.poses[..., _BEAM, :1] >= GOAL_M


def terminated(state: ArenaState) -> Tensor:
    """True if the beam has arrived or turned too far; bool ``[*batch, 1]``."""
    turn = state.poses[..., _BEAM, 2:].abs()
    return arrived(state) | (turn > MAX_TURN)


def reward(before: ArenaState, after: ArenaState) -> Tensor:
    """Rewards, equal for both, ``[*batch, 2, 1]``."""
    beam_before = before.poses[..., _BEAM, :]
    beam_after = after.poses[..., _BEAM, :]
    forward_m = beam_after[..., :1] - beam_before[..., :1]
    turn = beam_after[..., 2:].abs() - beam_before[..., 2:].abs()
    gain = 10.0 * forward_m - 2.0 * turn + _ARRIVAL_REWARD * arrived(after)
    return torch.stack((gain, gain), -2)


def push(observation: Tensor) -> Tensor:
    """Script of both: drive along x, more slowly if the robot's half of the beam is ahead;
    ``[*batch, 12]`` to ``[*batch, 2]``."""
    y = observation[..., 1]
    cos = observation[..., 2]
    sin = observation[..., 3]
    # This angle of the beam in the world is positive when its left end lags.
    beam_sin = observation[..., 6] * sin + observation[..., 7] * cos
    home = torch.where(y >= 0, 0.2, -0.2) - y
    lead = -beam_sin * y.sign()
    speed = (1.0 - 6.0 * lead.clamp_min(0.0)).clamp(0.1, 1.0)
    ahead = torch.ones_like(y)
    left = 2.0 * home.clamp(-0.3, 0.3)
    # A robot needs the error in its own frame, so it is turned from the world's.
    own_ahead = ahead * cos + left * sin
    own_left = left * cos - ahead * sin
    steered = steer_towards(own_ahead, own_left)
    return steered * speed.unsqueeze(-1)


def _robot(
    name: str,
    y_m: float,
    color: tuple[float, float, float],
) -> Contestant:
    place = Place((-0.08, -0.02), (y_m - 0.03, y_m + 0.03), (-8.0, 8.0))
    return Contestant(name, TWO_WHEELER, place, color)


_SPEED_DEG_S = 700
_INTERFACE = Interface(
    commands=(
        RunAngle(
            "left",
            -_TRAVEL_DEG,
            _TRAVEL_DEG,
            _SPEED_DEG_S,
        ),
        RunAngle(
            "right",
            -_TRAVEL_DEG,
            _TRAVEL_DEG,
            _SPEED_DEG_S,
        ),
    ),
    channels=(MotorAngle("left"), MotorAngle("right")),
    settle=Wait(STEP_MS),
)

CARRY = ArenaTask(
    id="Carry-v0",
    doc=__doc__,
    arena=Arena(
        robots=(_robot("left", 0.2, (0.1, 0.6, 0.3)), _robot("right", -0.2, (0.6, 0.2, 0.6))),
        loads=(
            Load(
                "beam",
                (0.02, 0.35, 0.04),
                mass_kg=1.2,
                friction=0.34,
                place=Place((START_M, START_M)),
            ),
        ),
        gap_m=0.2,
    ),
    interfaces=(_INTERFACE, _INTERFACE),
    groups={"agents": ("left", "right")},
    max_steps=60,
    entries=ENTRIES,
    observe=observe,
    reward=reward,
    terminated=terminated,
    success=arrived,
    scripts={"push": push},
)
