"""Experiment trackers."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from toys import Cart

from bricksrl.agents.sac import SACSettings
from bricksrl.errors import DescriptionError, RunError
from bricksrl.training import TrainConfig, loggers, resume, train
from bricksrl.training.loggers import numbers

SMALL = SACSettings(hidden=(16, 16), batch_size=16, prefill_episodes=1)


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig("Cart", episodes=3, seed=4, settings=SMALL, run_dir=tmp_path / "run")


def test_tensorboard_equals_metrics(config: TrainConfig) -> None:
    pytest.importorskip("tensorboard")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # TensorBoard's own
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

        result = train(replace(config, log="tensorboard"), env=Cart())
        result = resume(result.run_dir, episodes=4, env=Cart())
        found = EventAccumulator(str(result.run_dir / "tensorboard"))
        found.Reload()
    assert set(found.Tags()["scalars"]) == {
        name for episode in result.episodes for name in numbers(episode)
    }
    returns = [(event.step, event.value) for event in found.Scalars("return")]
    assert returns == [
        (episode.steps, pytest.approx(episode.return_, rel=1e-5)) for episode in result.episodes
    ]
    assert len(found.Scalars("loss_qvalue")) == 3


def test_unknown_logger_raises(config: TrainConfig) -> None:
    with pytest.raises(
        DescriptionError, match="log is 'paper'; choose none, tensorboard, wandb or trackio"
    ):
        replace(config, log="paper")


def test_missing_logger_raises_and_leaves_no_files(
    config: TrainConfig, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(RunError, match="wandb is not installed"):
        train(replace(config, log="wandb"), env=Cart())
    assert list(tmp_path.iterdir()) == []


class Experiment:
    """Records calls as both packages' run objects do."""

    def __init__(self, **given: Any) -> None:
        self.given, self.logged, self.finished = given, [], False
        self.config = SimpleNamespace(update=lambda *args, **kwargs: None)

    def log(
        self, data: dict[str, float], step: int | None = None, commit: bool | None = None
    ) -> None:
        self.logged.append((data, step))

    def define_metric(self, *args: Any, **kwargs: Any) -> None:
        pass

    def finish(self) -> None:
        self.finished = True


def test_trackio_logs_locally(config: TrainConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    experiments = []

    def init(
        project: str,
        name: str | None = None,
        config: dict[str, Any] | None = None,
        resume: str = "never",
    ) -> Experiment:
        experiments.append(Experiment(project=project, name=name, config=config, resume=resume))
        return experiments[-1]

    module = ModuleType("trackio")
    module.init = init  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "trackio", module)
    monkeypatch.setattr("torchrl.record.loggers.trackio._has_trackio", True)
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: object())
    result = train(replace(config, log="trackio"), env=Cart())
    (experiment,) = experiments
    assert experiment.given["name"] == "run" and experiment.given["config"]["env"] == "Cart"
    returns = [(data["return"], step) for data, step in experiment.logged if "return" in data]
    assert returns == [(episode.return_, episode.steps) for episode in result.episodes]
    assert experiment.finished


@pytest.mark.parametrize(("key", "mode"), [("", "offline"), ("secret", "online")])
def test_wandb_stays_offline_without_an_account(
    config: TrainConfig, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, key: str, mode: str
) -> None:
    from torchrl.record.loggers import wandb as of_torchrl

    experiments = []

    def init(**given: Any) -> Experiment:
        experiments.append(Experiment(**given))
        return experiments[-1]

    module = ModuleType("wandb")
    module.init = init  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "wandb", module)
    monkeypatch.setattr(of_torchrl, "_has_wandb", True)
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: object())
    monkeypatch.setenv("HOME", str(tmp_path))  # no .netrc
    monkeypatch.setenv("NETRC", str(tmp_path / "none"))
    monkeypatch.delenv("WANDB_MODE", raising=False)
    monkeypatch.setenv("WANDB_API_KEY", key)
    result = train(replace(config, log="wandb"), env=Cart())
    (experiment,) = experiments
    assert experiment.given["mode"] == mode
    returns = [data["return"] for data, _ in experiment.logged if "return" in data]
    assert returns == [episode.return_ for episode in result.episodes]
    assert experiment.finished
