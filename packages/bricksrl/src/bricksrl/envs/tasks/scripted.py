"""Hand-written controllers, one per environment, as references for learned policies. Importing this
loads no torch.

Each is a function from what the robot observes, arrays by name without batch dimensions, to an
action ``[m]`` in -1..1.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from bricksrl.envs.tasks.line_follow import EDGE_PCT

ArrayPolicy = Callable[[Mapping[str, Any]], Any]
"""From ``observation`` ``[n]`` and, if there is a camera, ``image`` to an action ``[m]``."""

TROT_DEG = np.array([0.0, 180.0, 180.0, 0.0], np.float32)
"""Phases of the legs in a trot: left front, right front, left back, right back."""
_IMAGE_CENTRE_PX = np.array([31.5, 31.5])
_IMAGE_SCALE = np.array([640 / 64, 480 / 64])
# of the ball around the image's centre: with the high joint at -70, and as it turns
_RADIUS_PX = 163.0
_RADIUS_PX_PER_DEG = 0.8


def _signed_deg(angle: Any) -> Any:
    return (angle + 180.0) % 360.0 - 180.0


def run_away(_state: Mapping[str, Any]) -> Any:
    """Backwards at full speed."""
    return np.full(1, -1.0)


def spin(state: Mapping[str, Any]) -> Any:
    """Both wheels in opposite directions at full speed, in the drawn direction."""
    turn = np.array([-1.0, 1.0])
    return turn if state["observation"][5] < 0.5 else -turn


def trot(state: Mapping[str, Any]) -> Any:
    """All legs forward, those behind their phase faster: walks, and synchronises the legs."""
    phase = np.radians(state["observation"][:4] - TROT_DEG)
    mean = math.atan2(np.sin(phase).mean(), np.cos(phase).mean())
    return (-0.8 - 1.2 * np.radians(_signed_deg(np.degrees(phase - mean)))).clip(-1.0, 1.0)


def into_step(state: Mapping[str, Any]) -> Any:
    """Action towards the trot phase with the best reward of this step, less a cost of the remaining
    turns."""
    angle = state["observation"][:4]
    target = np.arange(0.0, 360.0, 4.0)[:, None] + TROT_DEG
    remaining_deg = (angle - target) % 360.0  # legs turn backwards only
    turn = remaining_deg.clip(None, 100.0)
    lf, rf, lb, rb = ((angle - turn) % 360.0).T
    apart, together = (
        sum(abs(_signed_deg(a - b)) for a, b in pairs)
        for pairs in (((lf, rf), (lb, rb)), ((lf, rb), (rf, lb)))
    )
    action = 1.0 - turn / 50.0
    score = (
        (apart - together) / 180.0 - action.sum(-1) / 40.0 - (remaining_deg - turn).sum(-1) / 180.0
    )
    return action[score.argmax()]


def reach(state: Mapping[str, Any]) -> Any:
    """Each joint by its error, the rotation the shorter way around."""
    observation = state["observation"]
    error_deg = observation[4:] - observation[:4]
    error_deg[0] = _signed_deg(error_deg[0])
    return (error_deg / np.array([100.0, 30.0, 60.0, 25.0])).clip(-1.0, 1.0)


def bring(state: Mapping[str, Any]) -> Any:
    """Turn and stretch the arm to the green disc in the image; 0 degrees are downwards."""
    rotation, _, high = state["observation"].tolist()
    image = state["image"].astype(np.float32)
    rows, columns = (
        (image[..., 1] > 140) & (image[..., 0] < 120) & (image[..., 2] < 120)
    ).nonzero()
    if not len(rows):
        return np.zeros(3)
    x, y = ((np.array([columns.mean(), rows.mean()]) - _IMAGE_CENTRE_PX) * _IMAGE_SCALE).tolist()
    turn = math.degrees(math.atan2(x, y)) - rotation
    stretch = (math.hypot(x, y) - _RADIUS_PX) / _RADIUS_PX_PER_DEG - 70.0 - high
    return np.array([_signed_deg(turn) / 90.0, 0.0, stretch / 60.0]).clip(-1.0, 1.0)


def follow(state: Mapping[str, Any]) -> Any:
    """Half speed, with a turn proportional to the difference of the brightness from that of the
    edge."""
    off_pct = state["observation"][0] - EDGE_PCT
    return np.array([0.0, 0.8 * off_pct / EDGE_PCT]).clip(-1.0, 1.0)


def park(state: Mapping[str, Any]) -> Any:
    """Turn to the start of an arc that ends in the bay with its heading, follow it, and align in
    the bay."""
    ahead_mm, left_mm, turn_deg = state["observation"][-5:-2].tolist()
    distance_mm = math.hypot(ahead_mm, left_mm)
    heading_error_deg = _signed_deg(-2.0 * math.degrees(math.atan2(left_mm, ahead_mm)) - turn_deg)
    speed = min(distance_mm, 100.0) * max(math.cos(math.radians(heading_error_deg)), 0.0)
    if distance_mm < 8.0:
        speed = 0.0
        rate = 2.0 * turn_deg
    else:
        rate = 2.5 * heading_error_deg + math.degrees(
            2.0 * speed * math.sin(math.radians(turn_deg) / 2) / distance_mm
        )
    return np.array([math.copysign(speed, ahead_mm) / 100.0, rate / 60.0]).clip(-1.0, 1.0)


CONTROLLERS: dict[str, ArrayPolicy] = {
    "RunAway-v0": run_away,
    "Spinning-v0": spin,
    "Walker-v0": into_step,
    "Walker-v1": trot,
    "Walker-v2": trot,
    "WalkerSim-v0": into_step,
    "WalkerSim-v1": into_step,
    "LineFollow-v0": follow,
    "Park-v0": park,
    "RoboArm-v0": reach,
    "RoboArmSim-v0": reach,
    "RoboArm_mixed-v0": bring,
}
