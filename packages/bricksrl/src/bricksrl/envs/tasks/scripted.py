"""Hand-written controllers, one per environment, as references for learned policies. Importing this
loads no torch.

Each is a function from what the robot observes, arrays by name without batch dimensions, to an
action ``[m]`` in -1..1.
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from brickhub.robot import SensorKind
from brickhub.robot.line_edge import LINE_EDGES, LineEdge, edge_of
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.line_follow import LINE_FOLLOW

ArrayPolicy = Callable[[Mapping[str, Any]], Any]
"""From ``observation`` ``[n]`` and, if there is a camera, ``image`` to an action ``[m]``."""

TROT_DEG = np.array([0.0, 180.0, 180.0, 0.0], np.float32)
"""Phases of the legs in a trot: left front, right front, left back, right back."""
_IMAGE_CENTRE_PX = np.array([31.5, 31.5])
"""Middle of the image of 64 x 64 px, as ``(x, y)``."""
_IMAGE_SCALE = np.array([640 / 64, 480 / 64])
"""Pixels of the camera's frame in one of the image, which is squeezed from 4:3 to a square."""
_RADIUS_PX = 163.0
"""Distance of the ball from the centre of the frame with the high joint at -70 degrees."""
_RADIUS_PX_PER_DEG = 0.8
"""Its change as the high joint turns."""
_LONGEST_TURN_DEG = 100.0
"""Turn of a leg in a step of Walker-v0 with the action -1; with the action 1 it stands."""
_DEG_PER_ACTION = 50.0
"""Turn of such a leg for each 1 of the action below 1."""
_ACTION_OF_REWARD = 40.0
"""Sum of the legs' actions that costs Walker-v0 a reward of 1."""
_PARKED_MM = 8.0
"""Distance within which a parking robot is in the bay."""
_FULL_SPEED_MM = 100.0
"""Distance from which on it drives at full speed."""
_FULL_RATE_DEG = 60.0
"""Turn that it asks for with the action 1."""


def _signed_deg(angle_deg: Any) -> Any:
    """The same direction in -180..180 degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def run_away(_state: Mapping[str, Any]) -> Any:
    """Backwards at full speed."""
    return np.full(1, -1.0)


def spin(state: Mapping[str, Any]) -> Any:
    """Both wheels in opposite directions at full speed, in the drawn direction."""
    turn = np.array([-1.0, 1.0])
    return turn if state["observation"][-1] < 0.5 else -turn


def trot(state: Mapping[str, Any]) -> Any:
    """All legs forward, those behind their phase faster: walks, and synchronises the legs."""
    legs_deg = state["observation"][:4]
    phase_rad = np.radians(legs_deg - TROT_DEG)
    # The mean of angles is that of their directions: a plain mean jumps where one runs around.
    mean_sine = np.sin(phase_rad).mean()
    mean_cosine = np.cos(phase_rad).mean()
    mean_rad = math.atan2(mean_sine, mean_cosine)
    lead_deg = _signed_deg(np.degrees(phase_rad - mean_rad))
    # At full speed a leg that is behind could not catch up.
    action = -0.8 - 1.2 * np.radians(lead_deg)
    return action.clip(-1.0, 1.0)


def into_step(state: Mapping[str, Any]) -> Any:
    """Action towards the trot phase with the best reward of this step, less a cost of the remaining
    turns."""
    legs_deg = state["observation"][:4]
    # One row for each trot phase that could be the next one, a column for each leg: [90, 4].
    phases_deg = np.arange(0.0, 360.0, 4.0)
    targets_deg = phases_deg[:, None] + TROT_DEG
    remaining_deg = (legs_deg - targets_deg) % 360.0  # legs turn backwards only
    turns_deg = remaining_deg.clip(None, _LONGEST_TURN_DEG)
    after_deg = (legs_deg - turns_deg) % 360.0
    left_front, right_front, left_back, right_back = after_deg.T  # [90] each
    # In a trot the legs of an axle are half a turn apart, diagonal ones together.
    apart_deg = _apart_deg(left_front, right_front) + _apart_deg(left_back, right_back)
    together_deg = _apart_deg(left_front, right_back) + _apart_deg(right_front, left_back)
    actions = 1.0 - turns_deg / _DEG_PER_ACTION
    gait = (apart_deg - together_deg) / 180.0
    cost = actions.sum(-1) / _ACTION_OF_REWARD
    # What is left after this step costs later ones.
    left_deg = (remaining_deg - turns_deg).sum(-1)
    score = gait - cost - left_deg / 180.0  # [90]
    return actions[score.argmax()]


def _apart_deg(first_deg: Any, second_deg: Any) -> Any:
    """How far two legs are from one another, 0..180 degrees."""
    return abs(_signed_deg(first_deg - second_deg))


def reach(state: Mapping[str, Any]) -> Any:
    """Each joint by its error, the rotation the shorter way around."""
    observation = state["observation"]
    error_deg = observation[4:] - observation[:4]
    error_deg[0] = _signed_deg(error_deg[0])
    largest_turn_deg = np.array([100.0, 30.0, 60.0, 25.0])  # of a step, as of the action 1
    return (error_deg / largest_turn_deg).clip(-1.0, 1.0)


def bring(state: Mapping[str, Any]) -> Any:
    """Turn and stretch the arm to the green disc in the image; 0 degrees are downwards."""
    rotation_deg, _, high_deg = state["observation"].tolist()
    image = state["image"].astype(np.float32)
    red = image[..., 0]
    green = image[..., 1]
    blue = image[..., 2]
    is_disc = (green > 140) & (red < 120) & (blue < 120)
    rows, columns = is_disc.nonzero()
    if not len(rows):
        return np.zeros(3)  # there is nothing to turn to
    # Positions in px of the camera's frame, in which the ball moves on a circle around the middle.
    disc_px = np.array([columns.mean(), rows.mean()])
    x, y = ((disc_px - _IMAGE_CENTRE_PX) * _IMAGE_SCALE).tolist()
    turn_deg = math.degrees(math.atan2(x, y)) - rotation_deg
    wanted_deg = (math.hypot(x, y) - _RADIUS_PX) / _RADIUS_PX_PER_DEG - 70.0
    stretch_deg = wanted_deg - high_deg
    action = np.array([_signed_deg(turn_deg) / 90.0, 0.0, stretch_deg / 60.0])
    return action.clip(-1.0, 1.0)


def follow(state: Mapping[str, Any], edge: LineEdge = LINE_EDGES[SensorKind.COLOR]) -> Any:
    """Half speed, with a turn proportional to the difference of the brightness from that of the
    edge."""
    off_pct = state["observation"][0] - edge.edge_pct
    turn = 0.8 * off_pct / edge.edge_pct
    return np.array([0.0, turn]).clip(-1.0, 1.0)


def park(state: Mapping[str, Any]) -> Any:
    """Turn to the start of an arc that ends in the bay with its heading, follow it, and align in
    the bay."""
    ahead_mm, left_mm, turn_deg = state["observation"][-5:-2].tolist()
    distance_mm = math.hypot(ahead_mm, left_mm)
    # An arc to a point turns the robot by twice the direction in which the point lies.
    arc_deg = -2.0 * math.degrees(math.atan2(left_mm, ahead_mm))
    heading_error_deg = _signed_deg(arc_deg - turn_deg)
    # Slower where it is near, and not at all while it points across the arc.
    along = max(math.cos(math.radians(heading_error_deg)), 0.0)
    speed_mm = min(distance_mm, _FULL_SPEED_MM) * along
    if distance_mm < _PARKED_MM:  # only the heading is left to correct
        speed_mm = 0.0
        rate_deg = 2.0 * turn_deg
    else:
        # what the arc itself turns, in the time of its way, and what corrects the heading on it
        half_turn = math.sin(math.radians(turn_deg) / 2)
        arc_rate_rad = 2.0 * speed_mm * half_turn / distance_mm
        rate_deg = 2.5 * heading_error_deg + math.degrees(arc_rate_rad)
    speed = math.copysign(speed_mm, ahead_mm) / _FULL_SPEED_MM
    action = np.array([speed, rate_deg / _FULL_RATE_DEG])
    return action.clip(-1.0, 1.0)


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


def controller_of(env_id: str, task: Task) -> ArrayPolicy:
    """The controller of an environment, on the robot that its task has."""
    if env_id == LINE_FOLLOW.id:
        return functools.partial(follow, edge=edge_of(task.robot))
    return CONTROLLERS[env_id]
