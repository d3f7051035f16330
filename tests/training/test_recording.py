"""Every run keeps what it did."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import torch
from toys import Cart

from bricksrl.agents import preset
from bricksrl.data import load
from bricksrl.data.check import check
from bricksrl.errors import HubError
from bricksrl.training import Observer, TrainConfig, resume, train


def config(run_dir: Path, episodes: int = 4, **more) -> TrainConfig:
    return TrainConfig("Cart", episodes=episodes, run_dir=run_dir, settings=preset("default", "sac"), **more)


def test_a_run_leaves_a_dataset_of_all_it_did(tmp_path: Path) -> None:
    result = train(config(tmp_path / "run"), env=Cart())
    episodes = load(tmp_path / "run")
    assert [row.length for row in episodes.rows] == [episode.length for episode in result.episodes]
    assert episodes.returns().tolist() == pytest.approx([episode.return_ for episode in result.episodes], rel=1e-5)
    assert {row.about.policy for row in episodes.rows} == {"random", "sac"} and episodes.rows[0].about.policy == "random"
    assert check(tmp_path / "run/data") == []


def test_a_run_that_is_not_to_be_recorded_is_not(tmp_path: Path) -> None:
    train(config(tmp_path / "run", 2, record=False), env=Cart())
    assert not (tmp_path / "run/data").exists()


def test_an_interrupted_run_keeps_its_last_steps_and_goes_on(tmp_path: Path) -> None:
    stop = threading.Event()

    class Impatient(Observer):
        def on_step(self, episode, step, phase) -> None:
            if (episode, step) == (2, 3):
                stop.set()

    train(config(tmp_path / "run"), Impatient(), env=Cart(), stop=stop)
    assert [(row.length, row.about.whole) for row in load(tmp_path / "run").rows] == [(8, True), (3, False)]
    resume(tmp_path / "run", env=Cart())
    assert [(row.length, row.about.whole) for row in load(tmp_path / "run").rows] == [(8, True), (3, False), *[(8, True)] * 3]


def test_an_episode_that_lost_its_robot_is_kept_as_broken_off(tmp_path: Path) -> None:
    class Fragile(Cart):
        steps = 0

        def _step(self, tensordict):
            self.steps += 1
            if self.steps == 12:
                raise HubError("gone")
            return super()._step(tensordict)

    train(config(tmp_path / "run", 3), env=Fragile())
    assert [(row.length, row.about.whole) for row in load(tmp_path / "run").rows] == [(8, True), (3, False), (8, True)]


def test_a_human_takes_over_and_the_agent_learns_from_it(tmp_path: Path) -> None:
    def driver(observation: torch.Tensor) -> torch.Tensor | None:
        return torch.tensor([0.125]) if observation[0] > 250 else None

    told = []

    class Listener(Observer):
        def on_transition(self, episode, step, phase, transition) -> None:
            told.append((float(transition["action"]), bool(transition["intervention"])))

    train(config(tmp_path / "run"), Listener(), env=Cart(), driver=driver)
    episodes = load(tmp_path / "run")
    by_hand = episodes.observation[:, 0] > 250
    assert torch.equal(episodes.intervention, by_hand) and by_hand.any() and not by_hand.all()
    assert (episodes.action[by_hand] == 0.125).all() and not (episodes.action[~by_hand] == 0.125).any()
    assert told == list(zip(episodes.action[:, 0].tolist(), by_hand.tolist(), strict=True))
