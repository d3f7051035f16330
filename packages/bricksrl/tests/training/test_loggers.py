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
from bricksrl.training import Episode, Phase, TrainConfig, loggers, resume, train
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


def test_numbers_of_an_episode_are_logged_by_their_names() -> None:
    episode = Episode(3, Phase.TRAIN, 60, 20, -1.5, None, {"loss": 0.25}, 12.5)
    usual = {
        "return": -1.5,
        "episode": 3.0,
        "length": 20.0,
        "link_lost": 0.0,
        "seconds": 12.5,
        "loss": 0.25,
    }
    assert numbers(episode) == usual
    whole = replace(episode, success=True, updates_per_step=2.0, evaluation=0.0, link_lost=True)
    more = {"success": 1.0, "updates_per_step": 2.0, "evaluation": 0.0, "link_lost": 1.0}
    assert numbers(whole) == usual | more
    assert all(type(value) is float for value in numbers(whole).values())


@pytest.mark.parametrize(
    ("variables", "machine", "is_logged_in"),
    [
        ({}, None, False),
        ({}, "github.com", False),
        ({}, "api.wandb.ai", True),
        ({"WANDB_API_KEY": "secret"}, None, True),
        ({"WANDB_MODE": "online"}, None, True),
        ({"WANDB_MODE": "offline", "WANDB_API_KEY": "secret"}, "api.wandb.ai", False),
        ({"WANDB_MODE": "disabled"}, "api.wandb.ai", False),
        ({"WANDB_MODE": ""}, "api.wandb.ai", True),
    ],
)
def test_account_is_looked_for_where_wandb_does(
    monkeypatch: pytest.MonkeyPatch,
    variables: dict[str, str],
    machine: str | None,
    is_logged_in: bool,
) -> None:
    for name in ("WANDB_MODE", "WANDB_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)

    def netrc() -> Any:
        if machine is None:
            raise FileNotFoundError
        return SimpleNamespace(hosts={machine: ("user", None, "secret")})

    monkeypatch.setattr(loggers.netrc, "netrc", netrc)
    assert loggers._logged_in_to_wandb() is is_logged_in


class Log:
    """A tracker that notes what it is told."""

    def __init__(self, *ends: str) -> None:
        self.told: list[Any] = []
        self.experiment = SimpleNamespace()
        for name in ends:
            setattr(self.experiment, name, lambda name=name: self.told.append(name))

    def log_scalar(self, name: str, value: float, *, step: int) -> None:
        self.told.append((name, value, step))


@pytest.mark.parametrize(
    ("ends", "at_episode", "at_end"),
    [
        (("flush", "close"), ["flush"], ["close"]),
        (("finish", "close"), [], ["finish"]),
    ],
)
def test_tracker_is_flushed_and_finished(
    monkeypatch: pytest.MonkeyPatch,
    ends: tuple[str, ...],
    at_episode: list[str],
    at_end: list[str],
) -> None:
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: object())
    tracking = loggers.Tracking("tensorboard")
    tracking._log = log = Log(*ends)
    episode = Episode(1, Phase.TRAIN, 60, 20, -1.5, None)
    unknown: Any = None
    tracking.on_episode(episode, unknown)
    assert ("return", -1.5, 60) in log.told
    assert [told for told in log.told if isinstance(told, str)] == at_episode
    log.told.clear()
    tracking.on_end(unknown)
    assert log.told == at_end


@pytest.mark.parametrize(
    ("kind", "name"), [("tensorboard", "tensorboard"), ("wandb", "my run"), ("trackio", "my run")]
)
def test_tracker_has_the_name_and_the_config_of_the_run(
    config: TrainConfig, monkeypatch: pytest.MonkeyPatch, kind: str, name: str
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: object())
    monkeypatch.setattr(loggers, "_logged_in_to_wandb", lambda: False)
    get: Any = lambda *given, **named: asked.append((*given, named))  # noqa: E731
    monkeypatch.setattr("torchrl.record.loggers.get_logger", get)
    loggers.Tracking(kind).on_start(config, Path("runs/my run"), 0)
    ((asked_kind, folder, asked_name, named),) = asked
    assert (asked_kind, Path(folder), asked_name) == (kind, Path("runs/my run"), name)
    project = {"project": "bricksrl", "config": config.to_dict()}
    assert named["trackio_kwargs"] == project
    wandb = project | {"mode": "offline", "log_env_packages": False}
    assert named["wandb_kwargs"] == wandb
    monkeypatch.setattr(loggers, "_logged_in_to_wandb", lambda: True)
    loggers.Tracking(kind).on_start(config, Path("runs/my run"), 0)
    assert asked[1][-1]["wandb_kwargs"] == wandb | {"mode": "online"}


def test_missing_tracker_is_told_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loggers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(RunError) as raised:
        loggers.Tracking("trackio")
    assert str(raised.value) == (
        "trackio is not installed; run `pip install trackio`, or omit --log: metrics.csv is always "
        "written"
    )
