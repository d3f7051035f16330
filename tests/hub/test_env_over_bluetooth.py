"""An environment on a robot that is reached over Bluetooth: the same task, the same program, another transport."""

from __future__ import annotations

import torch
from ble_world import World

from bricksrl.envs.env import Connection, HubEnv
from bricksrl.envs.odometer import SonarOdometer
from bricksrl.envs.tasks.spinning import SPINNING


def test_an_episode_over_bluetooth(world: World) -> None:
    placed = []
    connection = Connection(world.link(SPINNING.interface), placed.append, SonarOdometer(SPINNING.interface))
    env = HubEnv(SPINNING, lambda _seed: connection, seed=0)
    steps = env.rollout(6, policy=lambda state: state.set("action", torch.ones(2)))
    assert steps.shape == (6,)
    assert len(placed) == 1, "the hand is asked once an episode"
    assert env.twin is None
    turned = steps["next", "observation"][:, 0]
    assert (turned[1:] - turned[:-1] > 20).all(), "the wheel turns on from step to step"
    env.close()
    assert not world.hub.is_running
