"""Odometry: distance along the initial heading, straightness, estimate of a real robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from tensordict import TensorDict

import bricksrl
from bricksrl.envs.odometry import SonarOdometer, TrueOdometer
from bricksrl.envs.registry import get_task
from bricktwin.twin.standing import Pose

NOTHING = np.zeros(7, dtype=np.float32)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -30.0, 400.0])
def test_forward_is_initial_heading(heading_deg: float) -> None:
    poses = [Pose(1.0, 2.0, heading_deg)]
    odometer = TrueOdometer(lambda: poses[-1], 10.0)
    ahead = math.radians(heading_deg)
    poses.append(Pose(1.0 + 0.3 * math.cos(ahead), 2.0 - 0.3 * math.sin(ahead), heading_deg + 5))
    assert odometer.forward_mm(12.0, NOTHING) == pytest.approx(300)
    poses.append(
        Pose(
            poses[-1].x_m + 0.4 * math.sin(ahead),
            poses[-1].y_m + 0.4 * math.cos(ahead),
            heading_deg + 5,
        )
    )
    assert odometer.forward_mm(13.0, NOTHING) == pytest.approx(0, abs=1e-6), "sideways is not ahead"
    metrics = odometer.metrics()
    assert metrics["forward_m"] == pytest.approx(0.3)
    assert metrics["forward_speed_m_s"] == pytest.approx(0.1)
    assert metrics["straightness"] == pytest.approx(0.3 / 0.7)
    assert metrics["turned_deg"] == pytest.approx(5)


def test_real_robot_uses_wall_distance() -> None:
    odometer = SonarOdometer(get_task("Walker-v1").interface)
    readings = [
        np.array([0] * 6 + [distance_mm], dtype=np.float32)
        for distance_mm in (2000, 1500, 1480, 1490, 2000, 1000)
    ]
    steps = [odometer.forward_mm(0.0, values) for values in readings]
    assert steps == [0, 0, 20, -10, 0, 0]
    assert odometer.metrics() == {}


@pytest.mark.parametrize("env_id", ["Walker-v0", "Walker-v1"])
def test_trot_advances_standing_does_not(env_id: str) -> None:
    env = bricksrl.make(env_id, seed=0)
    ways = {}
    for name, speed in (("standing", 1.0), ("going", -1.0)):
        state = env.reset()
        total = 0.0
        for _ in range(20):
            legs = torch.deg2rad(state["observation"][:4] - torch.tensor([0.0, 180.0, 180.0, 0.0]))
            behind = torch.atan2((legs - legs.mean()).sin(), (legs - legs.mean()).cos())
            action = torch.full((4,), speed) if speed > 0 else (-0.8 - 0.6 * behind).clamp(-1, 1)
            state = env.step(TensorDict({"action": action}))["next"]
            total += float(state["reward"])
        ways[name] = env.walk_metrics()["forward_m"], total
    assert abs(ways["standing"][0]) < 0.02
    assert ways["going"][0] > 0.15
    if env_id == "Walker-v1":
        assert ways["going"][1] == pytest.approx(ways["going"][0] * 1000 / 20, abs=0.05)
