"""Evaluations during training, best checkpoint, early stop, devices."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from test_training_loop import Recorder, assert_same_run, ctrl_c, rows
from torchrl.envs.utils import ExplorationType
from toys import Cart, LosingCart

from bricksrl.agents.learner import Learner
from bricksrl.agents.sac import SACSettings
from bricksrl.data import load
from bricksrl.data.dataset import Dataset
from bricksrl.data.integrity import check
from bricksrl.envs.rollout import play_episodes
from bricksrl.errors import BricksError, CheckpointError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.policies import load_policy
from bricksrl.training import (
    Callback,
    RunFolder,
    TrainConfig,
    load_learner,
    recording,
    resume,
    train,
)
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.learner_side import InLoopLearner
from bricksrl.training.reproducible import reproducible

SMALL = SACSettings(hidden=(8,), batch_size=8, prefill_episodes=1, updates_per_step=0.25)


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig(
        "Cart",
        episodes=6,
        seed=4,
        settings=SMALL,
        run_dir=tmp_path / "run",
        eval_every=2,
        eval_episodes=3,
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of `config` from its start to its end."""
    run_dir = tmp_path_factory.mktemp("whole") / "run"
    times = {"episodes": 6, "eval_every": 2, "eval_episodes": 3}
    train(TrainConfig("Cart", seed=4, settings=SMALL, run_dir=run_dir, **times), env=Cart())
    return run_dir


def test_evaluation_does_not_affect_learning(
    config: TrainConfig, whole: Path, tmp_path: Path
) -> None:
    train(replace(config, run_dir=tmp_path / "without", eval_every=0), env=Cart())
    told = [row.pop("evaluation") for row in rows(whole)]
    assert [bool(text) for text in told] == [False, True] * 3
    one, other = (
        [{**row, "evaluation": ""} for row in rows(path)] for path in (whole, tmp_path / "without")
    )
    assert one == other
    assert not (tmp_path / "without" / "best.bin").exists()


def test_best_checkpoint_is_kept(config: TrainConfig) -> None:
    result = train(config, env=Cart())
    found = {
        episode.episode: episode.evaluation
        for episode in result.episodes
        if episode.evaluation is not None
    }
    best = max(found, key=lambda episode: found[episode])
    assert load_checkpoint(result.run_dir / "checkpoint.bin")["best"] == found[best]
    assert load_learner(result.run_dir, Cart(), which="best").episodes == best
    with reproducible(0):
        learner = load_learner(result.run_dir, Cart(), which="best").learner
        again = list(play_episodes(Cart(), learner.exploit, 3, config.seed, kind="selection"))
    assert sum(score.return_ for score in again) / 3 == pytest.approx(found[best], abs=1e-5)
    load_policy(result.run_dir, Cart(), which="best")


def test_no_best_checkpoint_without_evaluations(config: TrainConfig) -> None:
    result = train(replace(config, eval_every=0, episodes=1), env=Cart())
    with pytest.raises(CheckpointError, match="no best checkpoint"):
        evaluate(result.run_dir, Cart(), which="best")


def test_stop_during_an_evaluation_ends_the_run(
    config: TrainConfig, whole: Path, tmp_path: Path
) -> None:
    """It does not wait for the last evaluation episode; the episode before is kept, and a resumed
    run makes the evaluation."""

    class Interrupted(Cart):
        def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
            if (self.resets, self.step_count) == (4, 2):
                ctrl_c()
            return super()._step(tensordict)

    env = Interrupted()
    result = train(config, env=env)
    assert (result.interrupted, len(result.episodes), env.resets) == (True, 2, 4)
    assert [episode.evaluation for episode in result.episodes] == [None, None]
    resume(tmp_path / "run", env=Cart())
    assert_same_run(whole, tmp_path / "run")
    assert recorded(tmp_path / "run") == recorded(whole)


def test_stop_during_the_last_evaluation_can_be_resumed(
    config: TrainConfig, tmp_path: Path
) -> None:
    env = Cart()
    stop = threading.Event()
    config = replace(config, episodes=2)

    class Stopping(Cart):
        def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
            if self.resets == 3:
                stop.set()
            return super()._step(tensordict)

    first = train(config, env=Stopping(), stop=stop)
    assert first.interrupted and len(first.episodes) == 2
    observer = Recorder()
    again = resume(config.run_dir, observer, env=env)
    assert not again.interrupted and again.episodes[-1].evaluation is not None and env.resets == 3
    assert [call for call in observer.calls if call.startswith("episode")] == ["episode 2"], (
        "told of once, when it is complete"
    )


def recorded(run_dir: Path) -> list[tuple[int | None, int, float, bool]]:
    return [
        (row.about.seed, row.length, row.return_, row.about.whole) for row in load(run_dir).rows
    ]


class Killed(BaseException):
    """Ends the run at once, without a checkpoint."""


BOUNDARIES = {
    "before the dataset": (recording.RunRecorder, "write"),
    "between the steps and the row of the dataset": (Dataset, "write_rows"),
    "between the row and the index of the dataset": (Dataset, "write_index"),
    "after the dataset": (InLoopLearner, "end_episodes"),
    "before the metrics": (RunFolder, "append"),
    "before the checkpoint": (InLoopLearner, "save"),
    "before the evaluation": (InLoopLearner, "finish"),
    "in the evaluation": (Learner, "exploit"),
    "after the evaluation": (RunFolder, "write_episodes"),
    "when all is kept": (Callback, "on_episode"),
}


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_episode_is_kept_once_wherever_the_run_is_killed(
    config: TrainConfig, boundary: str, whole_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the second episode or later, so that something is there already."""
    config = replace(config, episodes=4, eval_episodes=2)
    owner, name = BOUNDARIES[boundary]
    original = getattr(owner, name)
    calls = 0

    def killed(*arguments: Any, **named: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == (3 if name == "write_episodes" else 2):
            raise Killed
        return original(*arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, killed)
        with pytest.raises(Killed):
            train(config, Callback(), env=Cart())
    resume(config.run_dir, env=Cart())
    assert_same_run(whole_run, config.run_dir)
    assert recorded(config.run_dir) == recorded(whole_run)
    assert check(config.run_dir / "data") == []


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run"
    train(
        TrainConfig(
            "Cart", episodes=4, seed=4, settings=SMALL, run_dir=path, eval_every=2, eval_episodes=2
        ),
        env=Cart(),
    )
    return path


@pytest.mark.usefixtures("forked_children")
def test_asynchronous_run_keeps_the_policy_that_it_evaluated(
    config: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    acted: list[list[torch.Tensor]] = []

    def exploit(learner: Learner, tensordict: TensorDictBase) -> TensorDictBase:
        tensordict = learner._act(tensordict, ExplorationType.DETERMINISTIC)
        acted.append([tensor.clone() for tensor in learner.acting.state_dict().values()])
        return tensordict

    monkeypatch.setattr(Learner, "exploit", exploit)
    settings = replace(SMALL, updates_per_step=20.0)
    result = train(replace(config, asynchronous=True, episodes=2, settings=settings), env=Cart())
    saved = list(load_checkpoint(result.run_dir / "best.bin")["agent"]["policy"].values())
    assert acted and all(
        torch.equal(one, other)
        for weights in acted
        for one, other in zip(weights, saved, strict=True)
    )


def test_resumed_run_keeps_best_checkpoint(
    config: TrainConfig, whole: Path, tmp_path: Path
) -> None:
    train(config, Recorder((5, 2), ctrl_c), env=Cart())
    resume(tmp_path / "run", env=Cart())
    assert_same_run(whole, tmp_path / "run")
    one, other = (load_learner(path, Cart(), which="best") for path in (whole, tmp_path / "run"))
    assert one.episodes == other.episodes


@pytest.mark.parametrize(
    ("stop_at", "eval_every", "ends"),
    [(-100.0, 2, 2), (-100.0, 0, 6), (-100.0, 4, 4), (100.0, 2, 8)],
)
def test_run_stops_at_target_return(
    config: TrainConfig, stop_at: float, eval_every: int, ends: int
) -> None:
    result = train(replace(config, episodes=8, stop_at=stop_at, eval_every=eval_every), env=Cart())
    assert (len(result.episodes), result.interrupted) == (ends, False)


class Worthless(Cart):
    """All its rewards are 0."""

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        return super()._step(tensordict).set("reward", torch.zeros(1))


def test_evaluation_of_zero_reaches_target_of_zero(config: TrainConfig) -> None:
    assert len(train(replace(config, stop_at=0.0), env=Worthless()).episodes) == 2


class Costly(LosingCart):
    """Each step costs 1, so an episode that a lost link cuts off looks good. It never falls."""

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        state = super()._reset()
        self.position_mm = torch.full((1,), 1000.0)
        return state

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        return super()._step(tensordict).set("reward", -torch.ones(1))

    def _is_lost(self) -> bool:
        return self.step_count >= 2 and self.resets <= 7


def test_episodes_with_lost_link_do_not_reach_target_return(config: TrainConfig) -> None:
    result = train(replace(config, episodes=14, eval_every=0, stop_at=-5.0), env=Costly(8))
    whole = [episode for episode in result.episodes if not episode.link_lost]
    assert (
        len(result.episodes) == 14
        and len(whole) == 7
        and {episode.return_ for episode in whole} <= {-8.0}
    )


def test_stopped_run_stays_stopped(config: TrainConfig) -> None:
    first = train(replace(config, stop_at=-100.0), env=Cart())
    again = resume(first.run_dir, env=Cart())
    assert (len(again.episodes), again.interrupted) == (2, False)


class Untrusty(LosingCart):
    """Its link breaks in the second step of the first evaluation, the third episode."""

    def _is_lost(self) -> bool:
        return (self.resets, self.step_count + 1) == (3, 2)


def test_evaluation_goes_on_after_a_lost_link(config: TrainConfig) -> None:
    told = []

    class Listener(Callback):
        def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
            told.append(episode)

    result = train(replace(config, episodes=4), Listener(), env=Untrusty(2))
    assert [episode.evaluation is None for episode in result.episodes] == [True, False, True, False]
    assert not any(episode.link_lost for episode in result.episodes) and told == []
    recorded = [(row.length, row.about.whole) for row in load(result.run_dir).rows]
    assert recorded == [(episode.length, True) for episode in result.episodes]


def test_unavailable_device_raises(config: TrainConfig, tmp_path: Path) -> None:
    absent = "mps" if torch.cuda.is_available() else "cuda"
    for name in (absent, "abacus"):
        with pytest.raises(
            RunError, match=f"there is no device '{name}' here; choose cpu.* or auto"
        ):
            train(replace(config, device=name), env=Cart())
    assert list(tmp_path.iterdir()) == []


def test_auto_selects_best_device(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    train(replace(config, device="auto", episodes=3), env=Cart())
    train(replace(config, episodes=3, run_dir=tmp_path / "cpu"), env=Cart())
    assert_same_run(tmp_path / "run", tmp_path / "cpu")


class Seeded(Cart):
    """It notes the seeds of its episodes."""

    def __init__(self) -> None:
        super().__init__()
        self.seeds: list[int] = []

    def _set_seed(self, seed: int | None) -> None:
        self.seeds.append(seed or 0)
        super()._set_seed(seed)


@pytest.mark.parametrize("seed", [0, 1000])
def test_no_seed_lets_an_evaluation_meet_other_episodes_of_the_run(
    config: TrainConfig, seed: int
) -> None:
    trained, evaluated = Seeded(), Seeded()
    result = train(replace(config, seed=seed, eval_every=1, episodes=4), env=trained)
    for number in (0, 1000):
        evaluate(result.run_dir, evaluated, episodes=4, seed=number, save=False)
    training = {seed for seed in trained.seeds if seed < 2**31}
    selection = {seed for seed in trained.seeds if seed >= 2**31}
    assert len(training) == 4 and len(selection) == config.eval_episodes
    assert all(2**31 <= seed < 3 * 2**30 for seed in selection)
    assert len({*evaluated.seeds}) == 8 and all(
        3 * 2**30 <= seed < 2**32 for seed in evaluated.seeds
    )


def test_evaluation_follows_from_the_seeds_of_run_and_evaluation(
    config: TrainConfig, tmp_path: Path
) -> None:
    """Runs with one seed meet the same episodes, so that agents can be compared in pairs; others
    meet others."""
    returns = {}
    for agent, seed in (("random", 1), ("random", 2), ("sac", 1)):
        run = train(
            TrainConfig("Cart", agent, episodes=1, seed=seed, run_dir=tmp_path / f"{agent}{seed}"),
            env=Cart(),
        ).run_dir
        env = Seeded()
        returns[agent, seed] = evaluate(run, env, episodes=2, save=False).returns, env.seeds
        assert evaluate(run, Cart(), episodes=2, save=False).returns == returns[agent, seed][0]
    assert returns["random", 1][1] == returns["sac", 1][1] != returns["random", 2][1]
    assert returns["random", 1][0] != returns["random", 2][0]
