"""Hand-written controllers, one per environment, as references for learned policies.

Each is a function from the agent's input, a TensorDict without batch dimensions, to an action ``[m]`` in -1..1.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from tensordict import TensorDictBase
from torch import Tensor

from bricksrl.envs.tasks.line_follow import EDGE_PCT
from bricksrl.envs.tasks.walker import gait_reward

Controller = Callable[[TensorDictBase], Tensor]

TROT_DEG = torch.tensor([0.0, 180.0, 180.0, 0.0])
"""Phases of the legs in a trot: left front, right front, left back, right back."""
_IMAGE_CENTRE_PX, _IMAGE_SCALE = torch.tensor([31.5, 31.5]), torch.tensor([640 / 64, 480 / 64])
_RADIUS_PX, _RADIUS_PX_PER_DEG = 163.0, 0.8  # of the ball around the image's centre: with the high joint at -70, and as it turns


def _signed_deg(angle: Tensor) -> Tensor:
    return torch.remainder(angle + 180.0, 360.0) - 180.0


def run_away(_state: TensorDictBase) -> Tensor:
    """Backwards at full speed."""
    return -torch.ones(1)


def spin(state: TensorDictBase) -> Tensor:
    """Both wheels in opposite directions at full speed, in the drawn direction."""
    turn = torch.tensor([-1.0, 1.0])
    return turn if state["observation"][5] < 0.5 else -turn


def trot(state: TensorDictBase) -> Tensor:
    """All legs forward, those behind their phase faster: walks, and synchronises the legs."""
    phase = state["observation"][:4] - TROT_DEG
    mean = torch.rad2deg(torch.atan2(phase.deg2rad().sin().mean(), phase.deg2rad().cos().mean()))
    action: Tensor = (-0.8 - 1.2 * _signed_deg(phase - mean).deg2rad()).clamp(-1.0, 1.0)
    return action


def into_step(state: TensorDictBase) -> Tensor:
    """Action towards the trot phase with the best reward of this step, less a cost of the remaining turns."""
    angle = state["observation"][:4]
    target = torch.arange(0.0, 360.0, 4.0)[:, None] + TROT_DEG
    remaining_deg = torch.remainder(angle - target, 360.0)  # legs turn backwards only
    turn = remaining_deg.clamp_max(100.0)
    after = torch.nn.functional.pad(torch.remainder(angle - turn, 360.0), (0, 3))
    action = 1.0 - turn / 50.0
    score = gait_reward(after)[:, 0] - action.sum(-1) / 40.0 - (remaining_deg - turn).sum(-1) / 180.0
    best: Tensor = action[score.argmax()]
    return best


def reach(state: TensorDictBase) -> Tensor:
    """Each joint by its error, the rotation the shorter way around."""
    observation = state["observation"]
    error_deg = observation[4:] - observation[:4]
    error_deg[0] = _signed_deg(error_deg[0])
    action: Tensor = (error_deg / torch.tensor([100.0, 30.0, 60.0, 25.0])).clamp(-1.0, 1.0)
    return action


def bring(state: TensorDictBase) -> Tensor:
    """Turn and stretch the arm to the green disc in the image; 0 degrees are downwards."""
    rotation, _, high = state["observation"].tolist()
    image = state["image"].float()
    green = (image[..., 1] > 140) & (image[..., 0] < 120) & (image[..., 2] < 120)
    rows, columns = green.nonzero(as_tuple=True)
    if not len(rows):
        return torch.zeros(3)
    x, y = ((torch.stack((columns.float().mean(), rows.float().mean())) - _IMAGE_CENTRE_PX) * _IMAGE_SCALE).tolist()
    turn = math.degrees(math.atan2(x, y)) - rotation
    stretch = (math.hypot(x, y) - _RADIUS_PX) / _RADIUS_PX_PER_DEG - 70.0 - high
    action = torch.tensor([((turn + 180.0) % 360.0 - 180.0) / 90.0, 0.0, stretch / 60.0])
    return action.clamp(-1.0, 1.0)


def follow(state: TensorDictBase) -> Tensor:
    """Half speed, with a turn proportional to the difference of the brightness from that of the edge."""
    off_pct = state["observation"][0] - EDGE_PCT
    action: Tensor = torch.stack([torch.zeros(()), 0.8 * off_pct / EDGE_PCT]).clamp(-1.0, 1.0)
    return action


def park(state: TensorDictBase) -> Tensor:
    """Turn to the start of an arc that ends in the bay with its heading, follow it, and align in the bay."""
    ahead_mm, left_mm, turn_deg = state["observation"][-5:-2]
    distance_mm = torch.hypot(ahead_mm, left_mm)
    heading_error_deg = _signed_deg(-2.0 * torch.atan2(left_mm, ahead_mm).rad2deg() - turn_deg)
    speed = distance_mm.clamp_max(100.0) * heading_error_deg.deg2rad().cos().clamp_min(0.0)
    along_deg_s = (2.0 * speed * (turn_deg.deg2rad() / 2).sin() / distance_mm).rad2deg()
    rate = 2.5 * heading_error_deg + along_deg_s
    if distance_mm < 8.0:
        speed, rate = torch.zeros(()), 2.0 * turn_deg
    action: Tensor = torch.stack([speed.copysign(ahead_mm) / 100.0, rate / 60.0]).clamp(-1.0, 1.0)
    return action


CONTROLLERS: dict[str, Controller] = {
    "RunAway-v0": run_away,
    "Spinning-v0": spin,
    "Walker-v0": into_step,
    "Walker-v1": trot,
    "WalkerSim-v0": into_step,
    "WalkerSim-v1": into_step,
    "LineFollow-v0": follow,
    "Park-v0": park,
    "RoboArm-v0": reach,
    "RoboArmSim-v0": reach,
    "RoboArm_mixed-v0": bring,
}
