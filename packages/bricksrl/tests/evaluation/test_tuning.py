"""Hyperparameter search."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import pytest
import torch

from brickhub.files import only_writer
from bricksrl.agents import preset
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.agents.settings import Range, Settings
from bricksrl.errors import RunError, UnknownNameError
from bricksrl.evaluation import tuning
from bricksrl.evaluation.settings_text import read_settings
from bricksrl.evaluation.tuning import BEST, Tuning, tune

optuna = pytest.importorskip("optuna")


def test_tuning_resumes_and_best_can_be_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = Tuning("RoboArmSim-v0", "sac", steps=100, seeds=1)

    def score(_: Tuning, settings: object, seed: int) -> float:
        return -abs(settings.learning_rate - 2e-3)  # type: ignore[attr-defined]

    monkeypatch.setattr(tuning, "_train_and_evaluate", score)
    first = tune(about, tmp_path, 2)
    assert first.value >= -1e-3, "what there is was tried first"
    told: list[int] = []
    best = tune(about, tmp_path, 4, on_trial=lambda number, *_: told.append(number))
    assert told == [2, 3, 4, 5]
    assert best.trials == 6 and best.value >= first.value
    assert read_settings(tmp_path / BEST, preset("paper", "sac")) == best.settings
    assert json.loads((tmp_path / BEST).read_text())["provenance"]["trials"] == 6
    with pytest.raises(RunError, match="holds a study of steps 100; give the same"):
        tune(Tuning("RoboArmSim-v0", "sac", steps=200, seeds=1), tmp_path, 1)
    # best.json is the other's
    with pytest.raises(RunError, match="holds a study of RoboArmSim-v0 sac; choose another folder"):
        tune(Tuning("RoboArmSim-v0", "td3", steps=100, seeds=1), tmp_path, 1)


def test_only_one_of_several_commands_adds_the_default_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, enqueue = [], optuna.Study.enqueue_trial

    def begin(study: optuna.Study, values: dict[str, object]) -> None:
        with (
            pytest.raises(RunError, match="another program writes into"),
            only_writer(tmp_path, RunError),
        ):
            pass
        begun.append(len(study.trials))
        enqueue(study, values)

    monkeypatch.setattr(optuna.Study, "enqueue_trial", begin)
    monkeypatch.setattr(tuning, "_train_and_evaluate", lambda *_: 1.0)
    tune(Tuning("WalkerSim-v0", "sac", seeds=1), tmp_path, 1)
    assert begun == [0]


def test_a_trial_trains_and_evaluates(tmp_path: Path) -> None:
    best = tune(Tuning("RoboArmSim-v0", "td3", steps=30, seeds=1, episodes=1), tmp_path, 1)
    assert best.settings == preset("default", "td3")
    assert best.value < 0


def test_diverged_trial_does_not_end_the_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_updates, trials = ReplayLearner.make_updates, []

    def diverge(learner: ReplayLearner, count: int) -> dict[str, torch.Tensor]:
        metrics = make_updates(learner, count)
        if not trials:
            torch.nn.utils.vector_to_parameters(
                torch.full((10**6,), math.nan), learner.policy.parameters()
            )
        return metrics

    monkeypatch.setattr(ReplayLearner, "make_updates", diverge)
    small = {"hidden": ["8,8"], "batch_size": [8], "updates_per_step": [1.0]}
    for name, choices in small.items():
        monkeypatch.setitem(tuning._SPACE, name, choices)
    tuned = Tuning("RoboArmSim-v0", "td3", steps=104, seeds=1, episodes=1)
    best = tune(tuned, tmp_path, 2, on_trial=lambda number, value, _: trials.append(value))
    assert trials[0] is None and trials[1] == best.value < 0


def test_hopeless_trials_are_pruned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds_of: dict[float, list[int]] = {}

    def score(_: Tuning, settings: object, seed: int) -> float:
        seeds_of.setdefault(settings.learning_rate, []).append(seed)  # type: ignore[attr-defined]
        return -float(len(seeds_of))

    monkeypatch.setattr(tuning, "_train_and_evaluate", score)
    tune(Tuning("WalkerSim-v0", "crossq", seeds=2), tmp_path, 8)
    tried = list(seeds_of.values())
    assert tried[0] == [0, 1] and [0] in tried[5:]


def test_damaged_study_is_told(tmp_path: Path) -> None:
    (tmp_path / "study.db").write_text("no database")
    with pytest.raises(
        RunError,
        match=r"study.db \(file is not a database\); restore that file, or choose another folder",
    ):
        tune(Tuning("WalkerSim-v0", "sac"), tmp_path, 1)


def test_wrong_tuning_names_raise(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="WalkerSim-v0"):
        tune(Tuning("WalkerSmi-v0", "sac"), tmp_path, 1)
    with pytest.raises(UnknownNameError, match="pppo"):
        tune(Tuning("WalkerSim-v0", "pppo"), tmp_path, 1)


def test_tuning_resumes_after_unfinished_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes: list[float | Exception] = [
        BrokenPipeError(),
        optuna.TrialPruned(),
        optuna.TrialPruned(),
        -2.0,
        -1.0,
    ]

    def score(*_: object) -> float:
        outcome = outcomes.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(tuning, "_train_and_evaluate", score)
    about, told = Tuning("WalkerSim-v0", "sac", seeds=1), []
    with pytest.raises(BrokenPipeError):
        tune(about, tmp_path, 1)
    with pytest.raises(RunError, match="no trial of .* was finished; give more --trials"):
        tune(about, tmp_path, 1)
    assert not (tmp_path / BEST).exists()
    assert tune(about, tmp_path, 3, on_trial=lambda *trial: told.append(trial)).trials == 2
    assert told == [(2, None, None), (3, -2.0, -2.0), (4, -1.0, -1.0)]
    assert json.loads((tmp_path / BEST).read_text())["provenance"]["trial"] == 4


@dataclass(frozen=True)
class Own(Settings):
    """Settings of an algorithm of a user."""

    rate: float = 0.5
    share: Annotated[float, Range(0.0, 1.0)] = 0.4
    most: Annotated[float, Range(0.3, 9.0)] = 2.0
    none: float = 0.0
    debt: float = -2.0
    count: int = 3
    word: str = "so"


def test_floats_of_a_user_are_tuned_a_decade_to_both_sides_within_their_range() -> None:
    space = tuning._space(Own(), goals=True)
    own = {name: limits for name, limits in space.items() if name not in vars(Settings())}
    assert own == {
        "rate": (pytest.approx(0.05), 5.0, True),
        "share": (pytest.approx(0.04), 1.0, True),
        "most": (0.3, 9.0, True),
        "none": (0.0, 1.0, False),
        "debt": (-20.0, -0.2, False),
    }
    ours = tuning._space(preset("default", "sac"), goals=True)
    assert not {"buffer_size", "critic_loss", "reset_every"} & ours.keys()
    assert ours.keys() - tuning._space(preset("default", "sac"), goals=False).keys() == {
        "hindsight",
        "new_goals",
    }


@pytest.mark.parametrize(
    ("changes", "proposed"),
    [
        ({"hidden": (64, 64)}, {"hidden": "64,64"}),
        ({"hidden": (64,)}, None),
        ({"gamma": 0.9}, {"gamma": 0.9}),
        ({"gamma": 0.995}, {"gamma": 0.995}),
        ({"gamma": 0.5}, None),
        ({"gamma": 1.0}, None),
        ({"n_step": 3}, {"n_step": 3}),
        ({"n_step": 2}, None),
    ],
)
def test_settings_are_proposed_as_far_as_they_are_searched(
    changes: dict[str, Any], proposed: dict[str, Any] | None
) -> None:
    start = preset("default", "sac")
    settings = replace(start, **changes)
    usual = tuning._as_proposed(start, goals=False)
    (name,) = changes
    usual.pop(name, None)
    assert tuning._as_proposed(settings, goals=False) == usual | (proposed or {})
    if proposed is not None:
        space = tuning._space(start, goals=False)
        rest = {key: limits[0] for key, limits in space.items() if key not in proposed}
        made = tuning.propose(optuna.trial.FixedTrial(rest | proposed), start, goals=False)
        assert {name: getattr(made, name)} == changes
