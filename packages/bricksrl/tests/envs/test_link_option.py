"""Link of a virtual robot: its profile by name, its seed, and steps that suit it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import bricksrl
from brickhub.hub.link.profiles import DEFAULT_LINK, PROFILES
from brickhub.hub.link.streaming import StreamingLink
from bricksrl.envs import get_task
from bricksrl.envs.env import HubEnv
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.rollout import seed_episode
from bricksrl.errors import DescriptionError, UnknownNameError
from bricksrl.evaluation.evaluator import evaluation_options
from bricksrl.training import TrainConfig
from bricksrl.training.run_folder import Origin
from bricktwin.twin.physics import DRAWN_LINKS, Physics, RandomPhysics


def made(env_id: str, **options: Any) -> HubEnv:
    env = bricksrl.make(env_id, **options)
    assert isinstance(env, HubEnv)
    return env


def step_ms(env_id: str, steps: int, **options: Any) -> float:
    """Simulated time of a step."""
    env = made(env_id, seed=0, **options)
    env.reset()
    start_ms = env.twin.machine.time_ms
    env.rollout(steps, auto_reset=False, tensordict=env.reset())
    taken_ms = env.twin.machine.time_ms - start_ms - 1000  # of the placement
    env.close()
    return taken_ms / steps


def test_the_default_link_is_that_of_linux() -> None:
    assert DEFAULT_LINK == "linux" and Physics().link == PROFILES["linux"]
    assert step_ms("Spinning-v0", 40, link="linux") == step_ms("Spinning-v0", 40) > 180
    assert 110 < step_ms("Spinning-v0", 40, link="mac") < 150


@pytest.mark.parametrize("streaming", [False, True])
def test_an_episode_depends_on_its_seed_only(streaming: bool) -> None:
    """So a resumed run meets the link that it would have met."""
    env, other = (
        made("Spinning-v0", seed=seed, link="bad-room", streaming=streaming) for seed in (0, 1)
    )
    other.rollout(7)
    episodes = []
    for one in (env, other):
        seed_episode(one, 5)
        torch.manual_seed(0)
        episodes.append(one.rollout(30)["next", "observation"])
        one.close()
    assert torch.equal(*episodes)


def test_unknown_and_superfluous_links_are_told() -> None:
    with pytest.raises(UnknownNameError, match="no link 'windows'; choose mac, linux, bad-room"):
        EnvOptions(link="windows")
    with pytest.raises(DescriptionError, match="omit realtime, physics, link, scene and fault"):
        bricksrl.make("Walker-v0", hub="ble", link="mac")
    with pytest.raises(DescriptionError, match="simulated without a robot"):
        bricksrl.make("WalkerSim-v0", link="mac")


def test_random_physics_draws_one_of_two_links() -> None:
    rng = np.random.default_rng(0)
    drawn = [RandomPhysics().sample(rng).link for _ in range(40)]
    assert set(drawn) == set(DRAWN_LINKS) == {PROFILES["mac"], PROFILES["linux"]}


def test_given_link_stays_when_physics_are_drawn() -> None:
    env = made("Spinning-v0", seed=0, link="bad-room", randomize=True)
    for _ in range(3):
        env.reset()
        assert env.twin.link == PROFILES["bad-room"]
    env.close()


def test_run_keeps_its_link_and_evaluates_over_it() -> None:
    config = TrainConfig("Spinning-v0", "sac", episodes=2, link="mac")
    assert TrainConfig.from_dict(config.to_dict()).link == "mac"
    origin = Origin("Spinning-v0", config.env_options, "sac", 0, is_offline=False)
    assert evaluation_options(origin, "Spinning-v0").link == "mac"
    assert evaluation_options(origin, "Spinning-v0", link="linux").link == "linux"
    assert (
        evaluation_options(origin, "RunAway-v0").link
        is None
        is evaluation_options(origin, "Spinning-v0", hub="ble").link
    )


def test_line_follow_streams() -> None:
    env = made("LineFollow-v0", seed=0)
    env.rollout(20)
    assert isinstance(env._connection.link, StreamingLink)
    env.close()
    assert step_ms("LineFollow-v0", 30) < 110, "an exchange for each step would take 135 ms"


def test_walker_walks_with_shorter_steps_as_long() -> None:
    long, short = get_task("Walker-v1"), get_task("Walker-v1", step_ms=100)
    assert (long.max_steps, short.max_steps) == (100, 250) and short.interface.settle.time_ms == 100
    walked = torch.zeros(250, 8)
    walked[:, 7] = 5.0  # 50 mm/s
    assert short.reward(walked[0], walked[0, :4], walked[0]).item() == pytest.approx(5.0 / 20.0), (
        "per millimetre"
    )
    assert short.success(walked) and not long.success(walked[:100]), "20 mm/s in steps of 250 ms"
    for wrong in (0, 25_001, 100.5, "100"):
        with pytest.raises(DescriptionError, match="step_ms"):
            get_task("Walker-v1", step_ms=wrong)
