"""Stop and pause from another thread."""

from __future__ import annotations

import threading
import time

import pytest
import torch
from tensordict import TensorDict

import bricksrl
from brickhub.hub.link.states import LinkState
from bricksrl.envs.env import HubEnv
from bricksrl.errors import StoppedError

pytestmark = pytest.mark.realtime


@pytest.fixture
def env() -> HubEnv:
    made = bricksrl.make("Spinning-v0", seed=0)
    made.reset()
    yield made
    made.close(raise_if_closed=False)


def step(env: HubEnv) -> TensorDict:
    return env.step(TensorDict({"action": torch.ones(2)}))["next"]


def elsewhere(call) -> None:
    thread = threading.Thread(target=call)
    thread.start()
    thread.join(5.0)


def driven(env: HubEnv) -> bool:
    return any(servo.control.is_active for servo in env.twin.machine.servos.values())


def test_stopped_robot_moves_only_after_release(env: HubEnv) -> None:
    step(env)
    elsewhere(env.stop)
    with pytest.raises(StoppedError):
        step(env)
    assert not driven(env)
    for _ in range(2):
        with pytest.raises(StoppedError, match=r"stopped by hand"):
            env.reset()
    assert not driven(env)
    env.resume()
    env.reset()
    step(env)
    assert driven(env)


def test_seeding_keeps_robot_stopped(env: HubEnv) -> None:
    """A new seed makes a new virtual robot."""
    env.stop()
    env.set_seed(3)
    with pytest.raises(StoppedError):
        env.reset()


def test_stop_before_connection() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    env.stop()
    with pytest.raises(StoppedError):
        env.reset()
    env.resume()
    env.reset()
    env.close()


def test_pause_truncates_after_current_step(env: HubEnv) -> None:
    assert not step(env)["done"]
    elsewhere(env.pause)
    assert env.is_paused and not env.is_cut
    last = step(env)
    assert last["truncated"] and not last["terminated"] and env.is_cut
    link = env._connection.link
    assert link.state is LinkState.READY and not driven(env)


def test_reset_waits_during_pause(env: HubEnv) -> None:
    env.pause()
    step(env)
    link = env._connection.link
    exchanges = link.statistics.exchanges
    threading.Timer(0.7, env.resume).start()
    start_s = time.monotonic()
    env.reset()
    assert time.monotonic() - start_s > 0.5
    assert link.statistics.exchanges > exchanges + 2, "it was kept alive"
    assert not env.is_paused and not env.is_cut
    assert not step(env)["done"]


def test_a_stop_ends_a_pause(env: HubEnv) -> None:
    env.pause()
    step(env)
    threading.Timer(0.3, env.stop).start()
    with pytest.raises(StoppedError):
        env.reset()


def test_pause_delays_first_reset() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    env.pause()
    threading.Timer(0.5, env.resume).start()
    start_s = time.monotonic()
    env.reset()
    assert time.monotonic() - start_s > 0.3
    env.close()
