"""Walker-v2: streamed steps with heading and last commands, and settings that a task brings."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import pytest
import torch

import bricksrl
from brickhub.hub.link.streaming import StreamingLink
from bricksrl.agents import preset
from bricksrl.envs.registry import _specs, get_task, list_envs, register
from bricksrl.errors import DescriptionError
from bricksrl.training.config import TrainConfig, settings_for
from bricktwin.twin.scene import Scene

TASK = get_task("Walker-v2")
FORWARD, HEADING, COMMANDS = 8, 7, slice(9, None)


def test_it_streams_and_observes_what_was_commanded() -> None:
    with closing(bricksrl.make("Walker-v2", seed=0)) as env:
        state, action = env.reset(), torch.tensor([-1.0, 1.0, 0.0, 0.5])
        assert not state["observation"][HEADING:].any()
        start_s = env.twin.now_s()
        for _ in range(20):
            state = env.step(state.set("action", action))["next"]
        assert isinstance(env._connection.link, StreamingLink)
        assert (env.twin.now_s() - start_s) / 20 < 0.11, (
            "an exchange for each step would take 185 ms"
        )
        assert state["observation"][COMMANDS].tolist() == [-100.0, 0.0, -50.0, -25.0]


def test_a_speed_is_worth_as_much_a_step_and_succeeds_as_in_walker_v1() -> None:
    first = get_task("Walker-v1")
    slow, fast = (torch.full((250, 13), share * 4.0) for share in (0.99, 1.01))  # of 40 mm/s
    assert TASK.reward(fast, fast[:, :4], fast) == pytest.approx(
        first.reward(fast, fast[:, :4], 2.5 * fast)
    )
    assert TASK.success(fast) and not TASK.success(slow)
    fallen = fast.clone()
    fallen[3, 5] = 61.0
    assert not TASK.success(fallen)


def test_heading_counts_from_where_the_robot_is_put_down(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.envs.registry._specs", dict(_specs))
    register(replace(TASK, id="PutAnywhere-v0", scene=Scene(heading_deg=(-180.0, 180.0))))
    gyro_deg = []
    with closing(bricksrl.make("PutAnywhere-v0", seed=0)) as env:
        for _ in range(2):
            state = env.reset()
            assert state["observation"][HEADING] == 0.0
            gyro_deg.append(env._connection.link.read().values[HEADING])
            turned_deg = 0.0
            for _ in range(300):  # how fast it turns is chaos
                # the left legs
                state = env.step(state.set("action", torch.tensor([-1.0, 1.0, -1.0, 1.0])))["next"]
                turned_deg = env.walk_metrics()["turned_deg"]
                if abs(turned_deg) > 10.0:
                    break
            assert abs(turned_deg) > 10.0
            assert state["observation"][HEADING] == pytest.approx(turned_deg, abs=3.0)
    assert abs(gyro_deg[1] - gyro_deg[0]) > 30.0


def test_an_agent_takes_those_settings_of_a_task_that_it_has() -> None:
    sac, td3, gait = (
        settings_for("Walker-v2", "default", agent) for agent in ("sac", "td3", "gait")
    )
    assert (sac.gamma, sac.n_step) == (td3.gamma, td3.n_step) == (0.95**0.4, 3)
    assert (sac.target_entropy, sac.min_scale) == pytest.approx((-0.542, 0.158), abs=1e-3)
    assert (gait.trial_steps, gait.settle_steps) == (25, 10)
    assert TrainConfig("Walker-v2").settings == sac
    assert settings_for("Walker-v2", "paper", "sac") == preset("paper", "sac")
    assert [env_id for env_id in list_envs() if get_task(env_id).settings] == [
        "Walker-v1",
        "Walker-v2",
    ]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gama": 0.9}, "TASK sets gama, which no agent has .did you mean 'gamma'?"),
        ({"gamma": 2.0}, "gamma is 2.0; give"),
    ],
)
def test_settings_that_nobody_can_take_are_refused(
    settings: dict[str, float], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "bricksrl.training.config.get_task", lambda _: replace(TASK, settings=settings)
    )
    with pytest.raises(DescriptionError, match=message):
        settings_for("TASK", "default", "sac")
