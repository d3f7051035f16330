"""Recording of runs."""

from __future__ import annotations

import itertools
import shutil
import threading
from pathlib import Path

import pytest
import torch
from toys import Cart, LosingCart

from bricksrl.agents import preset
from bricksrl.data import load
from bricksrl.data.integrity import check
from bricksrl.errors import RunError
from bricksrl.training import Callback, TrainConfig, resume, train


def config(run_dir: Path, episodes: int = 4, **more) -> TrainConfig:
    return TrainConfig(
        "Cart", episodes=episodes, run_dir=run_dir, settings=preset("default", "sac"), **more
    )


def test_run_records_dataset(tmp_path: Path) -> None:
    result = train(config(tmp_path / "run"), env=Cart())
    episodes = load(tmp_path / "run")
    assert [row.length for row in episodes.rows] == [episode.length for episode in result.episodes]
    assert [row.return_ for row in episodes.rows] == pytest.approx(
        [episode.return_ for episode in result.episodes], rel=1e-5
    )
    assert {row.about.policy for row in episodes.rows} == {"random", "sac"} and episodes.rows[
        0
    ].about.policy == "random"
    assert check(tmp_path / "run/data") == []


def test_record_false_writes_no_dataset(tmp_path: Path) -> None:
    train(config(tmp_path / "run", 2, record=False), env=Cart())
    assert not (tmp_path / "run/data").exists()


def test_interrupted_run_records_last_steps(tmp_path: Path) -> None:
    stop = threading.Event()

    class Impatient(Callback):
        def on_step(self, episode, step, phase) -> None:
            if (episode, step) == (2, 3):
                stop.set()

    result = train(config(tmp_path / "run"), Impatient(), env=Cart(), stop=stop)
    before = [(row.length, row.about.whole) for row in load(tmp_path / "run").rows]
    assert before == [(result.episodes[0].length, True), (3, False)]
    result = resume(tmp_path / "run", env=Cart())
    after = [(row.length, row.about.whole) for row in load(tmp_path / "run").rows]
    assert (
        after == [*before, *((episode.length, True) for episode in result.episodes[1:])]
        and len(after) == 5
    )


def test_paused_episode_is_not_whole(tmp_path: Path) -> None:
    class Pausing(Callback):
        def on_env(self, env) -> None:
            self.env = env

        def on_step(self, episode, step, phase) -> None:
            if (episode, step) == (1, 2):
                self.env.pause()
            elif (episode, step) == (1, 3):
                self.env.resume()  # before the evaluation

    train(
        TrainConfig(
            "RunAway-v0",
            "random",
            episodes=2,
            eval_every=1,
            eval_episodes=1,
            run_dir=tmp_path / "run",
        ),
        Pausing(),
    )
    abouts = [
        (row.length, row.about.whole, row.about.success) for row in load(tmp_path / "run").rows
    ]
    assert abouts[0] == (3, False, None) and abouts[1][1:] == (True, False)


@pytest.mark.parametrize(("first_by_hand", "asynchronous"), [(0, False), (3, False), (3, True)])
@pytest.mark.usefixtures("forked_children")
def test_on_policy_agent_refuses_intervention(
    tmp_path: Path, first_by_hand: int, asynchronous: bool
) -> None:
    steps = itertools.count()

    def driver(observation: torch.Tensor) -> torch.Tensor | None:
        return torch.ones(1) if next(steps) >= first_by_hand else None

    settings = preset("default", "ppo")
    ppo = TrainConfig(
        "Cart", "ppo", 2, run_dir=tmp_path / "run", settings=settings, asynchronous=asynchronous
    )
    with pytest.raises(RunError, match="learns from its own actions only"):
        train(ppo, env=Cart(), driver=driver)


def test_lost_episode_is_recorded_as_aborted(tmp_path: Path) -> None:
    result = train(config(tmp_path / "run", 4, patience_s=60.0), env=LosingCart(4, failures=1))
    recorded = [(row.length, row.about.whole) for row in load(tmp_path / "run").rows]
    assert recorded == [
        (episode.length, not episode.link_lost) for episode in result.episodes
    ] and recorded[2] == (3, False)


def test_record_that_lost_episodes_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    train(config(tmp_path / "run", 2), env=Cart())
    resume(tmp_path / "run", episodes=3, env=Cart())
    assert not caplog.records
    shutil.rmtree(tmp_path / "run/data")
    resume(tmp_path / "run", episodes=4, env=Cart())
    assert f"{tmp_path / 'run/data'} has 0 of the 3 episodes of this run" in caplog.text
    caplog.clear()
    resume(tmp_path / "run", episodes=5, env=Cart())
    assert not caplog.records, "it goes on with what is there now"


def test_agent_learns_from_intervention(tmp_path: Path) -> None:
    def driver(observation: torch.Tensor) -> torch.Tensor | None:
        return torch.tensor([0.125]) if observation[0] > 250 else None

    told = []

    class Listener(Callback):
        def on_transition(self, episode, step, phase, transition) -> None:
            told.append((float(transition["action"]), bool(transition["intervention"])))

    train(config(tmp_path / "run"), Listener(), env=Cart(), driver=driver)
    episodes = load(tmp_path / "run")
    by_hand = episodes.observation[:, 0] > 250
    assert torch.equal(episodes.intervention, by_hand) and by_hand.any() and not by_hand.all()
    assert (episodes.action[by_hand] == 0.125).all() and not (
        episodes.action[~by_hand] == 0.125
    ).any()
    assert told == list(zip(episodes.action[:, 0].tolist(), by_hand.tolist(), strict=True))
