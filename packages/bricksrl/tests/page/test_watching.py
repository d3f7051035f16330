"""A watched run is bit-identical to an unwatched one."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase

from bricksrl.data.collect import collect, random_policy
from bricksrl.data.recorder import Recorder
from bricksrl.data.schema import describe
from bricksrl.envs import get_task, make
from bricksrl.envs.env import HubEnv
from bricksrl.errors import StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import PageCallback
from bricksrl.training import RunFolder, TrainConfig, load_learner, train
from bricksrl.training.callbacks import Phase
from bricksrl.training.config import settings_for


def config(run_dir: Path) -> TrainConfig:
    settings = replace(settings_for("Walker-v1", "default", "sac"), hidden=(8,), batch_size=8)
    settings = replace(settings, prefill_episodes=1, updates_per_step=0.1)
    return TrainConfig("Walker-v1", episodes=2, seed=4, settings=settings, run_dir=run_dir)


def short() -> HubEnv:
    """The robot in episodes of a few steps."""
    env = make("Walker-v1")
    assert isinstance(env, HubEnv)
    env.task = replace(env.task, max_steps=30)
    return env


def test_watched_run_equals_unwatched(tmp_path: Path) -> None:
    train(config(tmp_path / "plain"), env=short())
    stop = threading.Event()
    with LivePage("Walker-v1", task=get_task("Walker-v1"), on_stop=stop.set) as page:
        watched = {"driver": page.driver, "stop": stop, "env": short()}
        train(config(tmp_path / "shown"), PageCallback(page, stop), **watched)
        news = page.board
        assert news.status[1]["state"] == "finished" and news.series["return"].count == 2
        assert news.series["reward"].count == sum(
            e.length for e in RunFolder(tmp_path / "shown").read_episodes()
        )
        assert callable(news.poses[1]) and news.poses[1]().shape[1] == 7
    env = make("Walker-v1")
    folders = [RunFolder(tmp_path / name) for name in ("plain", "shown")]
    returns = [[episode.return_ for episode in folder.read_episodes()] for folder in folders]
    assert returns[0] == returns[1]
    weights = [load_learner(folder.path, env).learner.policy.state_dict() for folder in folders]
    assert weights[0].keys() == weights[1].keys()
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


class Presses(PageCallback):
    """Presses Reset in the third step of the first episode."""

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        if (episode, step) == (1, 3):
            self._page._press("reset", None)
        super().on_step(episode, step, phase)


def test_page_reset_ends_episode_and_evaluation_continues(tmp_path: Path) -> None:
    settings = settings_for("RunAway-v0", "default", "random")
    config = TrainConfig(
        "RunAway-v0",
        "random",
        2,
        settings=settings,
        eval_every=1,
        eval_episodes=1,
        run_dir=tmp_path / "run",
    )
    stop = threading.Event()
    with LivePage("RunAway-v0", task=get_task("RunAway-v0"), on_stop=stop.set) as page:
        result = train(config, Presses(page, stop), driver=page.driver, stop=stop)
    first, second = result.episodes
    assert first.length == 4, "the step that follows is the last"
    assert second.length > 4 and not page.is_reset_requested
    assert all(episode.evaluation is not None for episode in result.episodes)


def test_page_reset_ends_recorded_episode(tmp_path: Path) -> None:
    env = make("RunAway-v0", seed=0)
    with (
        LivePage("RunAway-v0", task=env.task) as page,
        Recorder(tmp_path / "data", describe(env)) as recorder,
    ):
        page.attach(env)

        def on_frame(frame: TensorDictBase) -> None:
            if page._steps == 2 and not recorder.rows:
                page._press("reset", None)
            page.show_step_and_hold(frame)

        hooks = {"on_frame": on_frame, "on_episode": lambda _: page.begin()}
        first, second = collect(env, random_policy(env, 0), recorder, 2, name="random", **hooks)
    env.close()
    assert first.length == 4 and second.length > 4


def test_page_stop_ends_recording_of_simulation(tmp_path: Path) -> None:
    env = make("RoboArmSim-v0", seed=0)
    with (
        LivePage("RoboArmSim-v0", task=env.task) as page,
        Recorder(tmp_path / "data", describe(env)) as recorder,
    ):
        page.attach(env)
        page.stop()
        with pytest.raises(StoppedError):
            collect(
                env,
                random_policy(env, 0),
                recorder,
                1,
                name="random",
                on_frame=page.show_step_and_hold,
            )
    assert page._steps == 1


def test_stopped_run_can_be_resumed(tmp_path: Path) -> None:
    settings = settings_for("RunAway-v0", "default", "random")
    config = TrainConfig("RunAway-v0", "random", 50, settings=settings, run_dir=tmp_path / "run")
    stop = threading.Event()
    with LivePage("RunAway-v0", task=get_task("RunAway-v0"), on_stop=stop.set) as page:

        class Stops(PageCallback):
            def on_step(self, episode: int, step: int, phase: Phase) -> None:
                if (episode, step) == (2, 3):
                    threading.Thread(target=page.stop).start()
                super().on_step(episode, step, phase)

        result = train(config, Stops(page, stop), driver=page.driver, stop=stop)
        assert (
            page.board.status[1]["state"] == "finished"
            and "bricksrl resume" in page.board.status[1]["note"]
        )
    assert result.interrupted and 1 <= len(result.episodes) < 50
