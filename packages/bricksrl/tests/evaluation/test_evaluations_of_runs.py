"""What an evaluation plays and passes on, without playing."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_comparison import write_run

from brickhub.seed import evaluation_seed
from bricksrl.envs.rollout import EpisodeScore
from bricksrl.evaluation import evaluator
from bricksrl.evaluation.evaluator import EvaluationResult, evaluate
from bricksrl.training import TrainConfig
from bricktwin.twin.physics import Physics


class Stage:
    """An environment and a learner that only note what is done with them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[Any] = []
        self.loaded: list[Any] = []
        self.played: list[Any] = []
        self.done: list[Any] = []
        self.saved: list[EvaluationResult] = []
        self.env = SimpleNamespace(device="the device", close=self.close)
        self.task: Any = None
        self.actor = SimpleNamespace(
            act_on=lambda device: self.done.append(("act on", device)),
            exploit="exploit",
            reset_policy="reset",
        )
        monkeypatch.setattr(evaluator, "make", self.make)
        monkeypatch.setattr(evaluator, "load_learner", self.load)
        monkeypatch.setattr(evaluator, "play_episodes", self.play)
        monkeypatch.setattr(evaluator, "interface_of", lambda env: SimpleNamespace(task=self.task))
        monkeypatch.setattr(evaluator, "with_unit_actions", lambda env: env)

        def save(result: EvaluationResult) -> None:
            self.saved.append(result)

        monkeypatch.setattr(EvaluationResult, "save", save)

    def close(self, *, raise_if_closed: bool) -> None:
        assert raise_if_closed is False
        self.done.append("closed")

    def make(self, env_id: str, options: Any, **named: Any) -> Any:
        self.made.append((env_id, options, named))
        return self.env

    def load(self, run: Any, env: Any, *, which: str) -> Any:
        self.loaded.append((run, env, which))
        return SimpleNamespace(learner=self.actor, episodes=7)

    def play(self, env: Any, *how: Any, **named: Any) -> Any:
        self.played.append((env, *how, named))
        for number in range(2):
            yield EpisodeScore(float(number), 10, 0.5, None, {})


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    return Stage(monkeypatch)


CONFIG = TrainConfig("WalkerSim-v0", seed=5)


def run_of(tmp_path: Path, config: TrainConfig = CONFIG) -> Path:
    return write_run(tmp_path / "run", config, [1.0])


def test_environment_of_the_training_is_made_played_and_closed(
    tmp_path: Path, stage: Stage
) -> None:
    run = run_of(tmp_path)
    heard: list[Any] = []
    place: Any = "by hand"
    result = evaluate(
        str(run),
        episodes=2,
        seed=9,
        kind="selection",
        which="best",
        on_episode=lambda *episode: heard.append(episode),
        on_env=lambda env: stage.done.append(("begins", env)),
        place=place,
    )
    ((name, options, named),) = stage.made
    assert (name, options) == ("WalkerSim-v0", CONFIG.robot)
    assert named == {"copies": 2, "seed": 5, "place": "by hand"}
    assert stage.loaded == [(str(run), stage.env, "best")]
    drawn = evaluation_seed(5, 9)
    how = {"kind": "selection", "reset_policy": "reset"}
    assert stage.played == [(stage.env, "exploit", 2, drawn, how)]
    assert stage.done == [("begins", stage.env), ("act on", "the device"), "closed"]
    assert heard == [(1, 0.0), (2, 1.0)]
    assert stage.saved == [result]
    assert (result.run_dir, result.env, result.agent) == (str(run), "WalkerSim-v0", "sac")
    assert (result.hub, result.seed, result.trained_episodes) == ("virtual", 9, 7)
    assert (result.episodes, result.as_trained) == (2, True)


def test_defaults_of_an_evaluation(tmp_path: Path, stage: Stage) -> None:
    result = evaluate(run_of(tmp_path))
    ((_, _, episodes, drawn, named),) = stage.played
    assert (episodes, drawn, named["kind"]) == (5, evaluation_seed(5, 1000), "evaluation")
    assert stage.loaded[0][2] == "last" and result.seed == 1000
    assert stage.saved == [result]
    evaluate(tmp_path / "run", save=False)
    assert len(stage.saved) == 1


def test_environment_of_the_caller_stays_open(
    tmp_path: Path, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = SimpleNamespace(device=None)
    given: list[Any] = []

    def with_unit_actions(env: Any) -> Any:
        given.append(env)
        return scaled

    monkeypatch.setattr(evaluator, "with_unit_actions", with_unit_actions)
    env: Any = stage.env
    result = evaluate(run_of(tmp_path), env, episodes=2)
    assert given == [env] and not stage.made and stage.loaded[0][1] is scaled
    assert stage.done == [("act on", None)], "it is not closed"
    assert result.as_trained and result.env == "WalkerSim-v0"


@pytest.mark.parametrize(
    ("task", "env", "as_trained", "shown"),
    [
        (None, "WalkerSim-v0", True, "WalkerSim-v0"),
        ("WalkerSim-v0", "WalkerSim-v0", True, "WalkerSim-v0"),
        ("Own-v0", "WalkerSim-v0", False, "Own-v0"),
    ],
)
def test_environment_of_the_caller_is_known_by_its_task(
    tmp_path: Path, stage: Stage, task: str | None, env: str, as_trained: bool, shown: str
) -> None:
    run = run_of(tmp_path, replace(CONFIG, env=env))
    stage.task = None if task is None else SimpleNamespace(id=task)
    given: Any = stage.env
    result = evaluate(run, given)
    assert (result.as_trained, result.env) == (as_trained, shown)


@pytest.mark.parametrize(
    ("changes", "named", "copies"),
    [
        ({}, {}, 3),
        ({}, {"realtime": True}, 1),
        ({}, {"frame_stack": 2}, 1),
        ({"frame_skip": 2}, {}, 1),
        ({"agent": "act", "settings": None}, {}, 1),
        ({"env": "Walker-v0"}, {}, 1),
        ({"env": "Walker-v0"}, {"hub": "ble"}, 1),
    ],
)
def test_copies_are_played_side_by_side_where_nothing_remembers(
    tmp_path: Path, stage: Stage, changes: dict[str, Any], named: dict[str, Any], copies: int
) -> None:
    run = run_of(tmp_path, replace(CONFIG, **changes))
    evaluate(run, episodes=3, **named)
    assert stage.made[0][2]["copies"] == copies


@pytest.mark.parametrize(
    ("named", "as_trained"),
    [
        ({}, True),
        ({"realtime": True}, True),
        ({"physics": Physics(battery_v=7.0)}, True),
        ({"physics": Physics(battery_v=6.9)}, False),
        ({"randomize": True}, False),
        ({"link": "mac"}, False),
        ({"scene": "sumo"}, False),
        ({"fault": ("battery=6.5",)}, False),
        ({"robot": "walker"}, False),
        ({"env": "Walker-v1"}, False),
        ({"env": "Walker-v0"}, True),
    ],
)
def test_other_conditions_are_no_evaluation_of_the_training(
    tmp_path: Path, stage: Stage, named: dict[str, Any], as_trained: bool
) -> None:
    run = run_of(tmp_path, TrainConfig("Walker-v0", physics=Physics(battery_v=7.0)))
    given = dict(named)
    env = given.pop("env", None)
    assert evaluate(run, env, **given).as_trained is as_trained


def test_options_that_another_environment_lacks_are_named_once(
    tmp_path: Path, stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    options = {"step_ms": 300, "blocked_at_mm": 50.0}
    run = run_of(tmp_path, replace(CONFIG, env="WalkerSim-v1", options=options))
    with caplog.at_level(logging.WARNING):
        evaluate(run, "Spinning-v0")
    assert caplog.messages == [
        "Spinning-v0 has no step_ms, blocked_at_mm, which the training had; it is evaluated without"
    ]
    with caplog.at_level(logging.WARNING):
        evaluate(run, "Spinning-v0", options={})
        evaluate(run)
    assert len(caplog.messages) == 1, "whoever gives options has chosen them"


def test_environment_is_closed_when_the_robot_fails(tmp_path: Path, stage: Stage) -> None:
    def fail(_env: Any) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        evaluate(run_of(tmp_path), on_env=fail)
    assert stage.done == ["closed"] and not stage.saved
