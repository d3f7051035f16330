"""An environment over Bluetooth: same task and program."""

from __future__ import annotations

import itertools

import pytest
import torch
from ble_world import World
from tensordict import TensorDict

from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.spinning import SPINNING

pytestmark = pytest.mark.realtime


def test_episode_over_bluetooth(world: World) -> None:
    placed = []
    connection = Connection(world.link(SPINNING.interface), placed.append)
    env = HubEnv(SPINNING, lambda _seed: connection, seed=0)
    env.reset()
    angles = [
        env.step(TensorDict({"action": torch.ones(2)}))["next", "observation"][0].item()
        for _ in range(6)
    ]
    assert len(placed) == 1, "the hand is asked once an episode"
    assert env.twin is None
    steps = [after - before for before, after in itertools.pairwise(angles)]
    assert min(steps) > 20, "the wheel turns on from step to step"
    env.close()
    assert not world.hub.is_running
