"""A guide tells a driver, from hub to hub, which of four pads is lit; the driver drives there.

The driver, a 2Wheeler, starts in the middle of a floor of 1.6 by 1.6 m, with a pad in each corner,
and does not see which one is lit. The guide, at the wall, sees it, and hardly moves. Each robot
tells the other two numbers in each step, which go through the hubs: what they mean is learned.
Without them the driver can only guess, and is right once in four times. The robots' positions and
the lit pad come from the simulation, in place of a camera overhead.

## Action (of each robot)

| Num | Action         | Min | Max | From          | To          | Unit |
|-----|----------------|-----|-----|---------------|-------------|------|
| 0   | left           | -1  | 1   | -150 (guide: -5) | 150 (guide: 5) | deg  |
| 1   | right          | -1  | 1   | -150 (guide: -5) | 150 (guide: 5) | deg  |
| 2-3 | tell_1, tell_2 | -1  | 1   | -1            | 1           | 1    |

## Observation (of each robot)

| Num | Observation       | Min  | Max | Unit                                              |
|-----|-------------------|------|-----|---------------------------------------------------|
| 0-1 | x, y              | -0.8 | 0.8 | m                                                 |
| 2-3 | heading_cos, _sin | -1   | 1   | 1                                                 |
| 4-5 | lit_x, lit_y      | -1   | 1   | side of the lit pad along x and y; the driver's: 0 |
| 6-7 | heard_1, heard_2  | -1   | 1   | what the other one told; 0 if not heard for 1 s   |
| 8-9 | left_moved, right_moved | -2 | 2 | share of the widest command                     |

## Reward

Both get ten times the metres by which the driver came nearer to the lit pad, 5 when it reaches it,
and -5 when it reaches another one.

## End of an episode

| End        | When                                               |
|------------|----------------------------------------------------|
| terminated | the driver is within 0.2 m of a pad                |
| truncated  | after 50 steps, or when the link to a robot breaks |

An episode succeeds when the driver reaches the lit pad.
"""

import torch
from torch import Tensor

from brickhub.entry import Entry
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask, own_pose, steer_towards
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.arena import Arena, Contestant, Place

HALF_M = 0.8
PAD_M = 0.5
"""Distance of the pads from the middle, along x and y."""
REACHED_M = 0.2
GUIDE = 0
DRIVER = 1
STEP_MS = 250
_GUIDE_TRAVEL_DEG = 5.0
_DRIVER_TRAVEL_DEG = 150.0
_SPEED_DEG_S = 900
_REWARD_PER_M = 10.0
_PAD_REWARD = 5.0

ENTRIES = (
    Entry("x", -HALF_M, HALF_M, "m"),
    Entry("y", -HALF_M, HALF_M, "m"),
    Entry("heading_cos", -1.0, 1.0),
    Entry("heading_sin", -1.0, 1.0),
    Entry("lit_x", -1.0, 1.0),
    Entry("lit_y", -1.0, 1.0),
    Entry("heard_1", -1.0, 1.0),
    Entry("heard_2", -1.0, 1.0),
    Entry("left_moved", -2.0, 2.0),
    Entry("right_moved", -2.0, 2.0),
)


def lit_side(state: ArenaState) -> Tensor:
    """Side of the lit pad along x and y, each -1 or 1; ``[*batch, 2]``."""
    return torch.where(state.drawn < 0.0, -1.0, 1.0)


def observe(state: ArenaState) -> Tensor:
    """Observations of guide and driver, ``[*batch, 2, 10]``."""
    lit = lit_side(state)
    seen = {GUIDE: lit, DRIVER: torch.zeros_like(lit)}
    views = []
    for robot, lit_seen in seen.items():
        parts = (
            own_pose(state.poses, robot),
            lit_seen,
            state.heard[..., robot, :],
            state.moved[..., robot, :],
        )
        views.append(torch.cat(parts, -1))
    return torch.stack(views, -2)


def lit_distance_m(state: ArenaState) -> Tensor:
    """Distance of the driver from the lit pad, ``[*batch, 1]``."""
    apart = state.poses[..., DRIVER, :2] - PAD_M * lit_side(state)
    length_m: Tensor = apart.norm(dim=-1, keepdim=True)
    return length_m


def reached(state: ArenaState) -> Tensor:
    """True if the driver has reached a pad; bool ``[*batch, 1]``."""
    # The nearest pad is that of the driver's own corner.
    apart = state.poses[..., DRIVER, :2].abs() - PAD_M
    near: Tensor = apart.norm(dim=-1, keepdim=True) <= REACHED_M
    return near


def reached_lit(state: ArenaState) -> Tensor:
    """True if the driver has reached the lit pad; bool ``[*batch, 1]``."""
    return lit_distance_m(state) <= REACHED_M


def reward(before: ArenaState, after: ArenaState) -> Tensor:
    """The same reward for both, ``[*batch, 2, 1]``."""
    nearer_m = lit_distance_m(before) - lit_distance_m(after)
    is_right = reached_lit(after)
    is_wrong = reached(after) & ~is_right
    gain = _REWARD_PER_M * nearer_m + _PAD_REWARD * (is_right.float() - is_wrong.float())
    return torch.stack((gain, gain), -2)


def follow(observation: Tensor) -> Tensor:
    """The script of both, ``[*batch, 10]`` to ``[*batch, 4]``: who sees the lit pad stays and tells
    its side, and who does not drives to the side of which it has heard."""
    x = observation[..., 0]
    y = observation[..., 1]
    cos = observation[..., 2]
    sin = observation[..., 3]
    lit = observation[..., 4:6]
    heard = observation[..., 6:8]
    # Rounding turns small numbers, such as those of silence, into 0.
    side = heard.round().sign()
    dx = PAD_M * side[..., 0] - x
    dy = PAD_M * side[..., 1] - y
    wheels = steer_towards(dx * cos + dy * sin, dy * cos - dx * sin)
    knows_where = side.abs().sum(-1, keepdim=True) > 0.0
    sees_pad = lit.abs().sum(-1, keepdim=True) > 0.0
    drives = knows_where & ~sees_pad
    return torch.cat((wheels * drives, lit), -1)


def _robot(
    name: str,
    place: Place,
    color: tuple[float, float, float],
) -> Contestant:
    return Contestant(name, TWO_WHEELER, place, color)


def _interface(travel_deg: float) -> Interface:
    wheels = ("left", "right")
    commands = [RunAngle(wheel, -travel_deg, travel_deg, _SPEED_DEG_S) for wheel in wheels]
    return Interface(
        commands=tuple(commands),
        channels=tuple(MotorAngle(wheel) for wheel in wheels),
        settle=Wait(STEP_MS),
    )


_AT_THE_WALL = Place((-0.68, -0.66), (-0.02, 0.02), (-5.0, 5.0))
_MIDDLE = Place((-0.1, 0.1), (-0.1, 0.1), (-180.0, 180.0))

LIT_PAD = ArenaTask(
    id="Guide-v0",
    doc=__doc__,
    arena=Arena(
        robots=(
            _robot("guide", _AT_THE_WALL, (0.95, 0.75, 0.1)),
            _robot("driver", _MIDDLE, (0.1, 0.3, 0.85)),
        ),
        half_size_m=(HALF_M, HALF_M),
    ),
    interfaces=(_interface(_GUIDE_TRAVEL_DEG), _interface(_DRIVER_TRAVEL_DEG)),
    groups={"agents": ("guide", "driver")},
    max_steps=50,
    entries=ENTRIES,
    observe=observe,
    reward=reward,
    terminated=reached,
    success=reached_lit,
    scripts={"follow": follow},
    told=2,
    drawn=((-1.0, 1.0), (-1.0, 1.0)),
)
