"""Runs that go on after the link to the robot broke."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase
from test_train import Recorder, ctrl_c, rows
from toys import Cart

from bricksrl.agents import SACSettings
from bricksrl.envs.env import Connection, HubEnv
from bricksrl.envs.odometer import SonarOdometer
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import BricksError, HubError, HubTimeoutError
from bricksrl.hub.link import HubLink
from bricksrl.training import TrainConfig, session, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.twin.virtual_hub import VirtualHub

SMALL = SACSettings(hidden=(16, 16), batch_size=16, prefill_episodes=1)


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig("Cart", episodes=5, seed=4, settings=SMALL, run_dir=tmp_path / "run")


class LosingCart(Cart):
    """Its link breaks in step ``at`` of its third episode, and ``failures`` resets fail before it is back."""

    def __init__(self, at: int, failures: int) -> None:
        super().__init__()
        self.at, self.failures = at, failures

    def _reset(self, *args: object, **kwargs: object) -> TensorDictBase:
        if self.resets == 3 and self.failures:
            self.failures -= 1
            raise HubTimeoutError("the hub is not there; switch it on")
        return super()._reset()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        if (self.resets, self.step_count + 1) == (3, self.at):
            raise HubTimeoutError("the hub did not answer; switch it on")
        return super()._step(tensordict)


class Notes(Recorder):
    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        self.calls.append(f"lost {episode} after {length}")


def episodes_in_replay(run_dir: Path) -> list[int]:
    return load_checkpoint(run_dir / "checkpoint.bin")["agent"]["replay"]["episodes"].tolist()


def test_a_run_goes_on_after_the_gap_and_nothing_is_remembered_across_it(config, monkeypatch) -> None:
    monkeypatch.setattr(session, "_FIRST_PAUSE_S", 0.05)
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
    lengths = [episode.length for episode in result.episodes]
    expected = [number for number, length in enumerate(lengths) for _ in range(length)]
    assert episodes_in_replay(result.run_dir) == expected, "each episode's transitions by themselves, the broken one's too"


def test_an_episode_without_a_step_leaves_no_trace(config) -> None:
    result = train(config, env=LosingCart(1, failures=0))
    assert [episode.link_lost for episode in result.episodes] == [False] * 5
    assert len(episodes_in_replay(result.run_dir)) == result.episodes[-1].steps
    assert len(set(episodes_in_replay(result.run_dir))) == 5


def test_patience_ends(config, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(session, "_FIRST_PAUSE_S", 0.02)
    started_s = time.perf_counter()
    with pytest.raises(HubTimeoutError, match="not there"):
        train(replace(config, patience_s=0.3), env=LosingCart(3, failures=10**6))
    assert time.perf_counter() - started_s < 5
    assert [row["link_lost"] for row in rows(tmp_path / "run")] == ["0", "0", "1"]


class HopelessCart(Cart):
    """Its resets succeed and its steps do not."""

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        raise HubError("no step today")


def test_a_robot_that_answers_only_to_resets_ends_patience_too(config) -> None:
    with pytest.raises(HubError, match="no step"):
        train(replace(config, patience_s=0.3), env=HopelessCart())


def test_ctrl_c_ends_the_waiting(config, monkeypatch) -> None:
    monkeypatch.setattr(session, "_FIRST_PAUSE_S", 60.0)
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
    """Out of reach from its 25th write on until it has been opened twice more."""

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
def test_the_virtual_robot_comes_back_too(asynchronous: bool, tmp_path: Path) -> None:
    hub = Breaking(RUN_AWAY.robot, scene=RUN_AWAY.scene)
    link = HubLink(hub, RUN_AWAY.robot, RUN_AWAY.interface)
    env = HubEnv(RUN_AWAY, lambda _: Connection(link, hub.reset, SonarOdometer(RUN_AWAY.interface)), seed=0)
    config = TrainConfig("RunAway-v0", episodes=4, settings=SMALL, run_dir=tmp_path / "run", asynchronous=asynchronous)
    seen: dict[int, list[TensorDictBase]] = {}

    class Listener(Recorder):
        def on_transition(self, episode: int, step: int, phase: object, transition: TensorDictBase) -> None:
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
            assert torch.equal(one["next", "observation"], other["observation"]), "no transition leaps"
    assert len(episodes_in_replay(result.run_dir)) == sum(map(len, seen.values())) == result.episodes[-1].steps
