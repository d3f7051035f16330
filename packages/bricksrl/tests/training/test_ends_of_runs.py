"""What a run evaluates and catches up with, and where its steps come from; without playing."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_schedule_of_a_run import ONE, loop_of

from bricksrl.errors import HubError
from bricksrl.training import TrainConfig, loop
from bricksrl.training.fleet.fleet_robots import Fleet
from bricksrl.training.fleet.schedule import FleetRobots
from bricksrl.training.learner_side import LearningPace
from bricksrl.training.signals import InterruptedEpisodeError
from bricksrl.training.sources import Copies, OneRobot


class Learner:
    """A learner that finishes what is pending when it is waited for."""

    def __init__(self, pace: LearningPace, updates_per_step: float) -> None:
        self.pace = pace
        self.actor = SimpleNamespace(updates_per_step=updates_per_step, reset_policy="reset")
        self.saved: list[Any] = []
        self.waited: list[bool] = []

    def finish(self, go_on: Any) -> None:
        self.waited.append(go_on())
        if go_on():
            self.pace = LearningPace(self.pace.asked, self.pace.asked)

    def save(self, path: Path, state: Any) -> None:
        self.saved.append((path, state))


def run_with(learner: Learner, **config: Any) -> Any:
    made = loop_of(TrainConfig("RunAway-v0", **{"episodes": 9, **config}))
    made.learner = learner
    made.actor = learner.actor
    made.folder = SimpleNamespace(
        checkpoint_path=Path("last"), best_path=Path("best"), write_episodes=list
    )
    made.signals = SimpleNamespace(requested=False, held_back=nullcontext)
    made.told = []
    made.callback = SimpleNamespace(on_catching_up=made.told.append)
    made._state = lambda: "the state"
    made._saved_at = learner.pace
    made.episodes = [ONE]
    return made


@pytest.mark.parametrize(
    ("asked", "done", "told", "made"), [(10, 4, [15], 15), (10, 10, [], 0), (0, 0, [], 0)]
)
def test_pending_updates_are_made_after_the_robots_work(
    asked: int, done: int, told: list[int], made: int
) -> None:
    """Of 2.5 updates a step; the checkpoint is written anew, as it lacks them."""
    learner = Learner(LearningPace(asked, done), 2.5)
    run = run_with(learner)
    assert run._catch_up(learner.pace) == made
    assert run.told == told
    assert learner.saved == ([(Path("last"), "the state")] if made else [])
    assert learner.waited == ([True, False] if made else [True]), "the last one is only written"


def test_stopped_run_catches_up_with_nothing() -> None:
    learner = Learner(LearningPace(10, 4), 2.5)
    run = run_with(learner)
    run.signals.requested = True
    assert run._catch_up(learner.pace) == 0
    assert run.told == [] and learner.saved == [] and learner.waited == [False]


def test_run_without_an_episode_has_nothing_to_save() -> None:
    learner = Learner(LearningPace(10, 4), 1.0)
    run = run_with(learner)
    run.episodes = []
    assert run._catch_up(learner.pace) == 6 and learner.saved == []


def evaluated(
    monkeypatch: pytest.MonkeyPatch, returns: list[float], best: float | None, *, lost: bool = False
) -> tuple[Any, list[Any]]:
    """A run after an evaluation with these returns, and what it asked for."""
    asked: list[Any] = []

    def play_episodes(_env: Any, policy: Any, *how: Any, **named: Any) -> Any:
        asked.append((*how, named))
        for return_ in returns:
            yield SimpleNamespace(return_=return_)
        if lost:
            raise HubError("out of reach")

    monkeypatch.setattr(loop, "play_episodes", play_episodes)
    monkeypatch.setattr(loop, "unaffected", nullcontext)
    monkeypatch.setattr(loop, "reconnect_of", lambda env: None)
    learner = Learner(LearningPace(10, 10), 1.0)
    run = run_with(learner, eval_every=1, eval_episodes=3, seed=7)
    run.env = "the env"
    run.best = best
    run.is_evaluation_due = True
    run.written = []
    run.folder.write_episodes = lambda episodes: run.written.append(list(episodes))
    run._report = lambda: asked.append("reported")
    run._evaluate()
    return run, asked


@pytest.mark.parametrize(
    ("best", "is_best"), [(None, True), (1.5, True), (2.0, False), (2.5, False)]
)
def test_evaluation_that_is_better_than_all_before_is_kept(
    monkeypatch: pytest.MonkeyPatch, best: float | None, is_best: bool
) -> None:
    run, asked = evaluated(monkeypatch, [1.0, 2.0, 3.0], best)
    how = {"kind": "selection", "reset_policy": "reset"}
    assert asked == [(3, 7, how), "reported"]
    assert run.best == (2.0 if is_best else best)
    kept = [(Path("best"), "the state")] if is_best else []
    assert run.learner.saved == [*kept, (Path("last"), "the state")]
    assert run.episodes == [replace(ONE, evaluation=2.0)] and run.written == [run.episodes]
    assert not run.is_evaluation_due


def test_evaluation_whose_link_breaks_again_and_again_has_no_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, asked = evaluated(monkeypatch, [9.0], 2.0, lost=True)
    assert run.best == 2.0 and run.episodes == [ONE]
    assert run.learner.saved == [(Path("last"), "the state")]
    assert not run.is_evaluation_due and asked[-1] == "reported"


def test_stop_ends_an_evaluation_at_its_next_step() -> None:
    learner = Learner(LearningPace(), 1.0)
    run = run_with(learner)
    learner.actor.exploit = lambda state: ("best", state)
    assert run._exploit("seen") == ("best", "seen")
    run.signals.requested = True
    with pytest.raises(InterruptedEpisodeError):
        run._exploit("seen")


@pytest.mark.parametrize(
    ("changes", "batch_size", "specs", "is_recorded"),
    [
        ({}, (), {"observation"}, True),
        ({"record": False}, (), {"observation"}, False),
        ({}, (), {"image"}, False),
        ({}, (3,), {"observation"}, False),
        ({"data": "somewhere", "updates": 40}, (), {"observation"}, False),
    ],
)
def test_run_on_robots_is_recorded_where_a_dataset_holds_it(
    monkeypatch: pytest.MonkeyPatch,
    changes: dict[str, Any],
    batch_size: tuple[int, ...],
    specs: set[str],
    is_recorded: bool,
) -> None:
    monkeypatch.setattr(loop, "base_of", lambda env: env)
    monkeypatch.setattr(loop, "given_specs", lambda env: dict.fromkeys(specs))
    run = run_with(Learner(LearningPace(), 1.0), patience_s=7.0, hub="ble:A", **changes)
    run.env = SimpleNamespace(batch_size=batch_size)
    run.driver = "a human"
    source = run._make_source()
    assert type(source) is (Copies if batch_size else OneRobot)
    assert source.is_recorded is is_recorded
    assert (source.hub, source.patience_s, source.driver) == ("ble:A", 7.0, "a human")
    assert source.env is run.env and source.learner is run.learner
    assert source.next_episode == run._next_episode


def test_robots_of_a_fleet_are_a_source_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    fleet = Fleet.__new__(Fleet)
    monkeypatch.setattr(loop, "base_of", lambda env: fleet)
    monkeypatch.setattr(loop, "given_specs", lambda env: {"observation": None})
    run = run_with(Learner(LearningPace(), 1.0), robots=2)
    run.env = SimpleNamespace(batch_size=())
    run.driver = None
    assert type(run._make_source()) is FleetRobots
