"""What a study trains, counts and writes, without training."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.agents import preset
from bricksrl.errors import DescriptionError, DivergedError, RunError
from bricksrl.evaluation import tuning
from bricksrl.evaluation.tuning import BEST, Tuning, tune
from bricksrl.training import Episode, Phase

pytest.importorskip("optuna")


def test_value_of_a_trial_is_the_mean_of_its_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    returns = {0: -1.0, 1: -3.0, 2: -8.0}
    monkeypatch.setattr(tuning, "_train_and_evaluate", lambda about, settings, seed: returns[seed])
    about = Tuning("WalkerSim-v0", "td3", steps=77, seeds=3, episodes=4)
    told: list[tuple[Any, ...]] = []
    best = tune(about, tmp_path, 1, on_trial=lambda *trial: told.append(trial))
    assert told == [(0, -4.0, -4.0)]
    assert (best.settings, best.value, best.trials) == (preset("default", "td3"), -4.0, 1)
    data = json.loads((tmp_path / BEST).read_text())
    assert data == {
        "settings": json.loads(json.dumps(asdict(best.settings))),
        "provenance": {
            "found_by": "bricksrl tune WalkerSim-v0 --agent td3",
            "env": "WalkerSim-v0",
            "agent": "td3",
            "steps": 77,
            "seeds": 3,
            "episodes": 4,
            "trials": 1,
            "trial": 0,
            "return_mean": -4.0,
        },
    }


def test_best_trial_is_the_one_of_the_highest_return(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    returns = iter((-5.0, -1.0, -3.0))
    tried: list[Any] = []

    def score(_: Tuning, settings: Any, seed: int) -> float:
        tried.append(settings)
        return next(returns)

    monkeypatch.setattr(tuning, "_train_and_evaluate", score)
    told: list[Any] = []
    best = tune(
        Tuning("WalkerSim-v0", seeds=1), tmp_path, 3, on_trial=lambda *trial: told.append(trial)
    )
    assert told == [(0, -5.0, -5.0), (1, -1.0, -1.0), (2, -3.0, -1.0)]
    assert (best.settings, best.value, best.trials) == (tried[1], -1.0, 3)
    assert json.loads((tmp_path / BEST).read_text())["provenance"]["trial"] == 1
    assert len(set(map(str, tried))) == 3, "each trial has its own settings"


@pytest.mark.parametrize("agent", ["random", "bc"])
def test_what_does_not_learn_from_a_robot_is_not_tuned(tmp_path: Path, agent: str) -> None:
    with pytest.raises(RunError) as raised:
        tune(Tuning("WalkerSim-v0", agent), tmp_path, 1)
    assert str(raised.value) == (
        f"{agent} does not learn from a robot, and tuning gives it nothing else; choose another "
        "agent"
    )


def test_wrong_seed_or_cluster_is_refused_first(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="seed"):
        tune(Tuning("WalkerSim-v0"), tmp_path, 1, seed=-1)
    with pytest.raises(RunError, match="there is no 'rya' to run on"):
        tune(Tuning("WalkerSim-v0"), tmp_path, 1, on="rya")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("reason", "remedy"),
    [("database or disk is full", "make room on the disk"), ("broken", "restore that file")],
)
def test_storage_that_fails_says_what_to_do(tmp_path: Path, reason: str, remedy: str) -> None:
    from sqlalchemy.exc import OperationalError

    def use() -> None:
        with tuning._storage(tmp_path / "study.db"):
            raise OperationalError("select", {}, OSError(reason))

    with pytest.raises(RunError) as raised:
        use()
    assert str(raised.value) == (
        f"cannot use the study {tmp_path / 'study.db'} ({reason}); {remedy}, or choose another "
        "folder"
    )


ABOUT = Tuning("WalkerSim-v0", "sac", steps=100, seeds=1, episodes=6)


class Training:
    """A training whose episodes are told, and which ends where it is stopped."""

    def __init__(self, *ends: int) -> None:
        self.ends = ends
        self.config: Any = None
        self.played: list[Episode] = []

    def __call__(self, config: Any, callback: Any, *, stop: Any) -> Any:
        self.config = config
        config.run_dir.mkdir()
        for number, steps in enumerate(self.ends, 1):
            episode = Episode(number, Phase.TRAIN, steps, 1, 0.0, None)
            self.played.append(episode)
            callback.on_episode(episode, None)
            if stop.is_set():
                break
        return SimpleNamespace(interrupted=True, episodes=tuple(self.played))


@pytest.fixture
def evaluated(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is evaluated; its mean return is 7."""
    calls: list[Any] = []

    def evaluate(run_dir: Path, **named: Any) -> Any:
        assert run_dir.exists()
        calls.append(named)
        return SimpleNamespace(return_mean=7.0)

    monkeypatch.setattr("bricksrl.evaluation.evaluator.evaluate", evaluate)
    return calls


@pytest.mark.parametrize(("ends", "played"), [((60, 99, 100, 130), 3), ((60, 130, 140), 2)])
def test_training_ends_with_the_episode_that_reaches_the_steps(
    monkeypatch: pytest.MonkeyPatch,
    evaluated: list[Any],
    ends: tuple[int, ...],
    played: int,
) -> None:
    training = Training(*ends)
    monkeypatch.setattr("bricksrl.training.run.train", training)
    settings = preset("default", "sac")
    assert tuning._train_and_evaluate(ABOUT, settings, 3) == 7.0
    assert len(training.played) == played
    config = training.config
    assert (config.env, config.agent, config.seed) == ("WalkerSim-v0", "sac", 3)
    assert config.settings == settings and config.asynchronous is False
    assert config.episodes == 100, "an episode has at least one step"
    assert not config.run_dir.exists(), "nothing of it is kept"
    assert evaluated == [{"episodes": 6, "kind": "selection", "save": False}]


@pytest.mark.parametrize("ends", [(60, 99), ()])
def test_stop_of_the_user_ends_the_study(
    monkeypatch: pytest.MonkeyPatch, evaluated: list[Any], ends: tuple[int, ...]
) -> None:
    monkeypatch.setattr("bricksrl.training.run.train", Training(*ends))
    with pytest.raises(KeyboardInterrupt):
        tuning._train_and_evaluate(ABOUT, preset("default", "sac"), 0)
    assert evaluated == []


def test_diverged_training_has_no_value(monkeypatch: pytest.MonkeyPatch) -> None:
    def diverge(*_: Any, **__: Any) -> None:
        raise DivergedError("its weights are not finite")

    monkeypatch.setattr("bricksrl.training.run.train", diverge)
    found = tuning._train_and_evaluate(ABOUT, preset("default", "sac"), 0)
    assert found != found, "not a number"


def test_ranges_of_more_than_a_decade_are_searched_by_factors() -> None:
    ranges = {name: limits for name, limits in tuning._SPACE.items() if isinstance(limits, tuple)}
    assert {"learning_rate", "tau", "gamma", "dropout"} <= ranges.keys()
    for name, (low, high, is_logarithmic) in ranges.items():
        assert low < high
        assert is_logarithmic is (low > 0 and high / low > 10), name


def test_seeds_of_a_trial_are_trained_together_on_a_cluster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    returns = iter(([1.0, 5.0], [3.0, float("nan")]))

    @contextmanager
    def connected(address: str | None) -> Iterator[str]:
        asked.append(address)
        yield "the cluster"

    def map_on_cluster(ray: Any, function: Any, orders: Any) -> list[float]:
        asked.append((ray, function, [(about, seed) for about, _, seed in orders]))
        return next(returns)

    monkeypatch.setattr(tuning, "connected", connected)
    monkeypatch.setattr(tuning, "map_on_cluster", map_on_cluster)
    about = Tuning("WalkerSim-v0", "td3", seeds=2)
    told: list[Any] = []
    best = tune(about, tmp_path, 2, on="ray:there", on_trial=lambda *trial: told.append(trial))
    assert told == [(0, 3.0, 3.0), (1, None, 3.0)], "one that has diverged is of no value"
    assert (best.value, best.trials) == (3.0, 1)
    order = ("the cluster", tuning._train_and_evaluate, [(about, 0), (about, 1)])
    assert asked == ["there", order, order]
