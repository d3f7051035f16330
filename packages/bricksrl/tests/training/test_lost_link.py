"""Runs with lost links."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase
from test_training_loop import Recorder, ctrl_c, rows
from torchrl.envs.utils import ExplorationType, set_exploration_type
from toys import Cart, LosingCart

from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.agents import make_learner
from bricksrl.agents.ppo import PPOSettings
from bricksrl.agents.sac import SACSettings
from bricksrl.envs import connection
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import BricksError, HubError, HubTimeoutError
from bricksrl.training import RunResult, TrainConfig, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.learner_side import InLoopLearner
from bricktwin.twin.make_body import make_body

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("forked_children")]

SMALL = SACSettings(hidden=(16, 16), batch_size=16, prefill_episodes=1, n_step=2)


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig("Cart", episodes=5, seed=4, settings=SMALL, run_dir=tmp_path / "run")


class Notes(Recorder):
    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        self.calls.append(f"lost {episode} after {length}")


def remembered(run_dir: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(run_dir / "checkpoint.bin")["agent"]["memory"]["rows"]


def successors(run_dir: Path) -> list[int]:
    return load_checkpoint(run_dir / "checkpoint.bin")["agent"]["memory"]["successor"].tolist()


def assert_linked_within_episodes(result: RunResult) -> None:
    """Transitions are linked within each episode only, also in the broken one."""
    lengths, expected, nothing = (
        [episode.length for episode in result.episodes],
        [],
        SMALL.buffer_size,
    )
    for length in lengths:
        expected += [len(expected) + step + 1 for step in range(length - 1)]
        expected.append(nothing)
    assert successors(result.run_dir) == expected
    rows = remembered(result.run_dir)
    for place, following in enumerate(expected):
        if following != nothing:
            assert torch.equal(rows["next.observation"][place], rows["observation"][following])


def test_run_continues_after_lost_link_without_linking(config, monkeypatch) -> None:
    monkeypatch.setattr(connection, "_FIRST_PAUSE_S", 0.05)
    observer = Notes()
    started_s = time.perf_counter()
    result = train(config, observer, env=LosingCart(3, failures=4))
    assert time.perf_counter() - started_s >= 0.35, "0, then 0.05, 0.1 and 0.2 seconds"
    lost = [call for call in observer.calls if call.startswith("lost")]
    assert lost == ["lost 3 after 2", *["lost 4 after 0"] * 4]
    assert (len(result.episodes), result.interrupted) == (5, False)
    broken = result.episodes[2]
    assert (broken.length, broken.link_lost, broken.success) == (2, True, None)
    assert [row["link_lost"] for row in rows(result.run_dir)] == ["0", "0", "1", "0", "0"]
    assert_linked_within_episodes(result)


def test_episode_without_steps_is_dropped(config) -> None:
    result = train(config, env=LosingCart(1, failures=0))
    assert [episode.link_lost for episode in result.episodes] == [False] * 5
    assert len(result.episodes) == 5
    assert_linked_within_episodes(result)


def test_lost_robot_raises_after_patience(config, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(connection, "_FIRST_PAUSE_S", 0.02)
    started_s = time.perf_counter()
    with pytest.raises(HubTimeoutError, match="not there"):
        train(replace(config, patience_s=0.3), env=LosingCart(3, failures=10**6))
    assert time.perf_counter() - started_s < 5
    assert [row["link_lost"] for row in rows(tmp_path / "run")] == ["0", "0", "1"]


def test_lost_frame_completes_no_on_policy_batch() -> None:
    """Otherwise the batch would be overwritten before anybody learned from it."""
    torch.manual_seed(0)
    learner = make_learner("ppo", Cart(), PPOSettings(hidden=(8,), steps=4, batch_size=4, passes=3))
    side = InLoopLearner(learner, {"pace": {"asked": 0, "done": 0}, "collected": []})
    with set_exploration_type(ExplorationType.RANDOM), torch.no_grad():
        frames = Cart().rollout(5, learner.policy, break_when_any_done=False)
    frames["next", "link_lost"] = torch.tensor([False, False, False, True, False])[:, None]
    made = []
    for frame in frames.split(1):
        side.remember(frame)
        made.append(0 if frame["next", "link_lost"] else len(side.learn(1)))
    assert [count > 0 for count in made] == [False] * 4 + [True]
    assert learner.updates == 3


class HopelessCart(LosingCart):
    """Its resets succeed, its steps fail."""

    def _is_lost(self) -> bool:
        return True


def test_robot_answering_only_resets_exhausts_patience(config) -> None:
    with pytest.raises(HubTimeoutError, match="did not answer"):
        train(replace(config, patience_s=0.3), env=HopelessCart(1))


def test_ctrl_c_ends_wait_for_robot(config, monkeypatch) -> None:
    monkeypatch.setattr(connection, "_FIRST_PAUSE_S", 60.0)
    timer = threading.Timer(1.0, ctrl_c)

    class Starter(Recorder):
        def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
            if length:
                timer.start()

    started_s = time.perf_counter()
    result = train(config, Starter(), env=LosingCart(3, failures=10))
    timer.join()
    assert time.perf_counter() - started_s < 20
    assert (result.interrupted, len(result.episodes)) == (True, 3)


class Breaking(VirtualHub):
    """Out of reach from the 25th write until it was opened twice."""

    writes = opens = 0

    def open(self) -> None:
        self.opens += 1
        if self.opens == 2:
            raise HubError("the hub is not in sight; bring it nearer")
        super().open()

    def write(self, data: bytes) -> None:
        self.writes += 1
        if self.writes == 25:
            raise HubError("the connection was lost; bring the hub nearer")
        super().write(data)


@pytest.mark.parametrize("asynchronous", [False, True])
def test_virtual_robot_returns(asynchronous: bool, tmp_path: Path) -> None:
    hub = Breaking(make_body(RUN_AWAY.robot, scene=RUN_AWAY.scene))
    link = HubLink(hub, RUN_AWAY.robot, RUN_AWAY.interface)
    env = HubEnv(RUN_AWAY, lambda _: Connection(link, hub.reset), seed=0)
    config = TrainConfig(
        "RunAway-v0",
        episodes=4,
        settings=SMALL,
        run_dir=tmp_path / "run",
        asynchronous=asynchronous,
    )
    seen: dict[int, list[TensorDictBase]] = {}

    class Listener(Recorder):
        def on_transition(
            self, episode: int, step: int, phase: object, transition: TensorDictBase
        ) -> None:
            seen.setdefault(episode, []).append(transition.clone())

    observer = Listener()
    result = train(config, observer, env=env)
    env.close()
    assert hub.opens == 3
    broken = [episode for episode in result.episodes if episode.link_lost]
    assert len(broken) == 1 and 0 < broken[0].length < 20
    assert len(result.episodes) == 4
    for data in seen.values():
        for one, other in zip(data[:-1], data[1:], strict=True):
            assert torch.equal(one["next", "observation"], other["observation"]), (
                "no transition leaps"
            )
    assert (
        len(remembered(result.run_dir)["action"])
        == sum(map(len, seen.values()))
        == result.episodes[-1].steps
    )
