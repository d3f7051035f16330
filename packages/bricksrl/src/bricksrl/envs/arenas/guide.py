"""A guide tells a driver, from hub to hub, where the gate of a line is; the driver drives through.

The driver, a 2Wheeler, starts at one side of a floor of 1.6 by 1.6 m. Across the other side goes a
line with a gate of 0.24 m, anywhere within one metre, which the driver does not see. The guide, in
a corner, sees it, and hardly moves. Each robot tells the other two numbers in each step, which go
through the hubs: what they mean is learned. Without them the driver can only guess, and is right
once in four times. The robots' positions and the gate come from the simulation, in place of a
camera overhead.

## Action (of each robot)

| Num | Action         | Min | Max | From          | To          | Unit |
|-----|----------------|-----|-----|---------------|-------------|------|
| 0   | left           | -1  | 1   | -150 (guide: -5) | 150 (guide: 5) | deg  |
| 1   | right          | -1  | 1   | -150 (guide: -5) | 150 (guide: 5) | deg  |
| 2-3 | tell_1, tell_2 | -1  | 1   | -1            | 1           | 1    |

## Observation (of each robot)

| Num | Observation       | Min  | Max | Unit                                               |
|-----|-------------------|------|-----|----------------------------------------------------|
| 0-1 | x, y              | -0.8 | 0.8 | m                                                  |
| 2-3 | heading_cos, _sin | -1   | 1   | 1                                                  |
| 4   | sees              | 0    | 1   | 1: the guide's                                     |
| 5   | gate              | -0.5 | 0.5 | m, the gate's middle along y; the driver's is 0    |
| 6-7 | heard_1, heard_2  | -1   | 1   | what the other one told; 0 if not heard for 1 s    |
| 8-9 | left_moved, right_moved | -2 | 2 | share of the widest command                      |

## Reward

Both get ten times the metres by which the driver came nearer to the gate, and 5 when it drives
through it.

## End of an episode

| End        | When                                               |
|------------|----------------------------------------------------|
| terminated | the middle of the driver's axle crosses the line   |
| truncated  | after 40 steps, or when the link to a robot breaks |

An episode succeeds when the driver crosses the line in the gate.
"""

import torch
from torch import Tensor

from brickhub.entry import Entry
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask, own_pose, steer_towards
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.arena import Arena, Contestant, Mark, Place

HALF_M = 0.8
LINE_M = 0.4
"""Position of the line along x."""
FARTHEST_GATE_M = 0.5
"""Largest distance of the gate's middle from that of the line."""
HALF_GATE_M = 0.12
GUIDE = 0
DRIVER = 1
STEP_MS = 250
_GUIDE_TRAVEL_DEG = 5.0
_DRIVER_TRAVEL_DEG = 150.0
_SPEED_DEG_S = 900
_REWARD_PER_M = 10.0
_GATE_REWARD = 5.0

ENTRIES = (
    Entry("x", -HALF_M, HALF_M, "m"),
    Entry("y", -HALF_M, HALF_M, "m"),
    Entry("heading_cos", -1.0, 1.0),
    Entry("heading_sin", -1.0, 1.0),
    Entry("sees", 0.0, 1.0),
    Entry("gate", -FARTHEST_GATE_M, FARTHEST_GATE_M, "m"),
    Entry("heard_1", -1.0, 1.0),
    Entry("heard_2", -1.0, 1.0),
    Entry("left_moved", -2.0, 2.0),
    Entry("right_moved", -2.0, 2.0),
)


def observe(state: ArenaState) -> Tensor:
    """Observations of guide and driver, ``[*batch, 2, 10]``."""
    gate = state.drawn
    views = []
    for robot in (GUIDE, DRIVER):
        sees = torch.full_like(gate, float(robot == GUIDE))
        parts = (
            own_pose(state.poses, robot),
            sees,
            sees * gate,
            state.heard[..., robot, :],
            state.moved[..., robot, :],
        )
        views.append(torch.cat(parts, -1))
    return torch.stack(views, -2)


def gate_distance_m(state: ArenaState) -> Tensor:
    """Distance of the driver from the middle of the gate, ``[*batch, 1]``."""
    line = torch.full_like(state.drawn, LINE_M)
    gate = torch.cat((line, state.drawn), -1)
    driver = state.poses[..., DRIVER, :2]
    apart = driver - gate
    length_m: Tensor = apart.norm(dim=-1, keepdim=True)
    return length_m


def crossed(state: ArenaState) -> Tensor:
    """True if the driver has crossed the line; bool ``[*batch, 1]``."""
    return state.poses[..., DRIVER, :1] >= LINE_M


def crossed_in_gate(state: ArenaState) -> Tensor:
    """True if the driver has crossed the line in the gate; bool ``[*batch, 1]``."""
    aside_m = state.poses[..., DRIVER, 1:2] - state.drawn
    is_in_gate = aside_m.abs() <= HALF_GATE_M
    return crossed(state) & is_in_gate


def reward(before: ArenaState, after: ArenaState) -> Tensor:
    """The same reward for both, ``[*batch, 2, 1]``."""
    nearer_m = gate_distance_m(before) - gate_distance_m(after)
    gain = _REWARD_PER_M * nearer_m + _GATE_REWARD * crossed_in_gate(after)
    return torch.stack((gain, gain), -2)


def follow(observation: Tensor) -> Tensor:
    """The script of both, ``[*batch, 10]`` to ``[*batch, 4]``: who sees the gate stays and tells
    where it is, and who does not drives to where it has heard that it is."""
    x = observation[..., 0]
    y = observation[..., 1]
    cos = observation[..., 2]
    sin = observation[..., 3]
    sees = observation[..., 4:5]
    # The first number says where the gate is, the second one that it was told.
    share = observation[..., 5:6] / FARTHEST_GATE_M
    told = torch.cat((share, torch.ones_like(share)), -1)
    gate = observation[..., 6] * FARTHEST_GATE_M
    is_heard = observation[..., 7:8] > 0.5
    # It aims beyond the line, so that it does not turn just before it.
    dx = LINE_M + 0.1 - x
    dy = gate - y
    ahead = dx * cos + dy * sin
    left = dy * cos - dx * sin
    wheels = steer_towards(ahead, left)
    drives = is_heard * (1.0 - sees)
    return torch.cat((wheels * drives, told * sees), -1)


def mark(drawn: Tensor) -> Tensor:
    """Places of the line, of the gate in it and of the gate's posts, ``[4, 2]`` m, by what was
    drawn, ``[1]``."""
    gate = drawn.item()
    along_y = (0.0, gate, gate - HALF_GATE_M, gate + HALF_GATE_M)
    return torch.tensor([(LINE_M, y) for y in along_y])


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


_MARKS = (
    Mark("line", (0.01, HALF_M, 0.0005), (0.25, 0.25, 0.28)),
    Mark("gate", (0.014, HALF_GATE_M, 0.001), (0.2, 0.65, 0.3)),
    Mark("right_post", (0.014, 0.014, 0.05), (0.2, 0.65, 0.3)),
    Mark("left_post", (0.014, 0.014, 0.05), (0.2, 0.65, 0.3)),
)
_CORNER = Place((-0.66, -0.64), (-0.66, -0.64), (-5.0, 5.0))
_START = Place((-0.5, -0.4), (-0.1, 0.1), (-30.0, 30.0))

GATE = ArenaTask(
    id="Guide-v0",
    doc=__doc__,
    arena=Arena(
        robots=(
            _robot("guide", _CORNER, (0.95, 0.75, 0.1)),
            _robot("driver", _START, (0.1, 0.3, 0.85)),
        ),
        half_size_m=(HALF_M, HALF_M),
        marks=_MARKS,
    ),
    interfaces=(_interface(_GUIDE_TRAVEL_DEG), _interface(_DRIVER_TRAVEL_DEG)),
    groups={"agents": ("guide", "driver")},
    max_steps=40,
    entries=ENTRIES,
    observe=observe,
    reward=reward,
    terminated=crossed,
    success=crossed_in_gate,
    scripts={"follow": follow},
    told=2,
    drawn=((-FARTHEST_GATE_M, FARTHEST_GATE_M),),
    mark=mark,
)
