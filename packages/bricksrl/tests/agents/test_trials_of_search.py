"""Trials of policy search: their scores, what the hub is told of them, and linear feedback, with
numbers made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from small import ENV
from test_gait import frame, searcher
from torch import nn
from torchrl.envs.utils import ExplorationType, set_exploration_type
from toys import Cart

from brickhub.entry import Entry
from bricksrl.agents.search import gait, structures
from bricksrl.agents.search.gait import GaitSettings
from bricksrl.agents.search.structures import (
    StructuredActor,
    hub_structure,
    linear,
    make_structure,
)
from bricksrl.errors import DescriptionError, UnknownNameError


def test_trial_that_falls_late_counts_its_steps_where_that_was_asked_for() -> None:
    """Two steps of five with a reward of 2 each: 4 of what five could bring."""
    learner = searcher(trial_steps=5, settle_steps=1, falls_late=True)
    learner.remember(frame(2.0))
    learner.remember(frame(2.0, pitch=36.0))
    assert [trial.score for trial in learner.search.trials] == [0.8]
    learner.search.tell(-3.0)
    for _ in range(5):
        learner.remember(frame(1.0))
    assert learner.search.trials[-1].score == 1.0


@pytest.mark.parametrize(("pitch", "has_failed"), [(35.0, False), (-35.0, False), (-35.5, True)])
def test_robot_at_its_limit_has_not_fallen(pitch: float, has_failed: bool) -> None:
    learner = searcher(trial_steps=2, settle_steps=0)
    learner.search.tell(-7.0)
    learner.remember(frame(1.0, pitch=pitch))
    assert len(learner.search.trials) == (2 if has_failed else 1)
    learner.remember(frame(1.0))
    assert (learner.search.trials[-1].score == -7.0) is has_failed


def test_copies_have_one_score_together() -> None:
    learner = searcher(trial_steps=2, settle_steps=0)
    copies = torch.cat([frame(1.0), frame(4.0)])[:, None]
    learner.remember(copies)
    learner.remember(copies)
    assert [trial.score for trial in learner.search.trials] == [2.5]


def test_trial_with_a_gap_has_no_score() -> None:
    learner = searcher(trial_steps=2, settle_steps=0)
    learner.remember(frame(1.0))
    lost = frame(1.0)
    lost["next", "link_lost"] = torch.ones(1, 1, dtype=torch.bool)
    learner.remember(lost)
    assert learner.rewards == [] and not learner.search.trials
    learner.remember(frame(3.0))
    learner.remember(frame(3.0))
    assert [trial.score for trial in learner.search.trials] == [3.0]


def test_nothing_is_learned_between_two_trials() -> None:
    learner = searcher(trial_steps=2, settle_steps=0)
    learner.remember(frame(1.5))
    assert learner.learn() == {} and learner.updates == 0
    learner.remember(frame(1.5))
    metrics = learner.learn()
    assert float(metrics["trial_reward"]) == 1.5 and learner.updates == 1
    assert learner.learn() == {}


def test_settings_reach_the_search() -> None:
    learner = searcher(random_trials=4, optimism=1.25, caution=0.75)
    search: Any = learner.search
    assert (search.optimism, search.caution) == (1.25, 0.75)
    assert len(search._start) == 4, "trials before the first proposal"


def test_hub_is_told_the_numbers_within_their_ranges_and_the_steps_of_a_trial() -> None:
    learner = searcher(trial_steps=7, settle_steps=1, tilt_deg=20.0)
    policy = learner._hub_policy()
    single = hub_structure(learner.actor)
    assert single is not None
    assert policy.numbers == single.numbers and policy.source == single.hub_source()
    assert policy.tilt_deg == 20.0
    # What acts is a copy, which shares the numbers.
    parts: Any = learner.acting.modules()
    actor = next(part for part in parts if isinstance(part, StructuredActor))
    low = [entry.low for entry in single.numbers]
    high = [entry.high for entry in single.numbers]
    actor.is_trial = True
    actor.acted_by = torch.tensor([high[0] + 1e-3, low[1] - 1e-3])
    assert policy.next_trial() == ([high[0], low[1]], 7)
    actor.is_trial = False
    actor.acted_by = torch.tensor([0.25, 90.0])
    assert policy.next_trial() == ([0.25, 90.0], None), "its best, as long as a hub makes steps"


@pytest.mark.parametrize(
    ("accumulates", "max_steps", "reason"),
    [
        (False, 100, ""),
        (True, 100, "it observes what counts from the start of an episode"),
        (True, 10, ""),
    ],
)
def test_what_counts_on_counts_from_the_start_of_a_trial(
    monkeypatch: pytest.MonkeyPatch, accumulates: bool, max_steps: int, reason: str
) -> None:
    """Which is that of an episode, where a trial is as long."""
    learner: Any = searcher(trial_steps=10)
    channel = SimpleNamespace(accumulates=accumulates)
    task = SimpleNamespace(interface=SimpleNamespace(channels=(channel,)), max_steps=max_steps)
    known = SimpleNamespace(connect_to="the hub", task=task, by_steps_because="it streams")
    monkeypatch.setattr(gait, "interface_of", lambda env: known)
    monkeypatch.setattr(gait, "most_steps", lambda interface: 10)
    assert learner._by_steps_because(None) == reason
    monkeypatch.setattr(gait, "most_steps", lambda interface: 9)
    assert learner._by_steps_because(None) == "a hub makes 9 of these steps in a trial at most"
    known.connect_to = None
    assert learner._by_steps_because(None) == "it streams"


def test_settling_is_shorter_than_a_trial() -> None:
    assert GaitSettings(trial_steps=4, settle_steps=3).settle_steps == 3
    with pytest.raises(DescriptionError) as raised:
        GaitSettings(trial_steps=4, settle_steps=4)
    assert str(raised.value) == "settle_steps is 4; give fewer than the 4 of a trial"


def test_linear_feedback_is_a_matrix_and_an_offset() -> None:
    """A cart observes 0..1000 and -1..1, which are scaled to -1..1; one number is commanded."""
    structure = linear(Cart())
    assert structure.numbers == (
        Entry("weight_0_0", -1.0, 1.0),
        Entry("weight_0_1", -1.0, 1.0),
        Entry("weight_0_2", -1.0, 1.0),
    )
    observation = torch.tensor([[750.0, -1.0], [0.0, 0.5]])
    numbers = torch.tensor([[0.5, -0.25, 0.125], [1.0, 0.5, -0.5]])
    action = structure(observation, numbers)
    # 0.5 * 0.5 + 0.25 * 1 + 0.125, and -1 + 0.25 - 0.5.
    assert action.flatten().tolist() == pytest.approx([0.625, -1.25])


def test_linear_feedback_has_a_row_for_each_command() -> None:
    structure = linear(ENV)
    size = structure.encoder.size
    names = [entry.name for entry in structure.numbers]
    assert len(names) == 4 * (size + 1)
    assert names[0] == "weight_0_0" and names[-1] == f"weight_3_{size}"
    offsets = torch.zeros(4, size + 1)
    offsets[:, -1] = torch.tensor([0.1, 0.2, 0.3, 0.4])
    action = structure(torch.zeros(8), offsets.flatten())
    assert action.tolist() == pytest.approx([0.1, 0.2, 0.3, 0.4])


class Doubled(nn.Module):
    """Acts by its number, and by what is observed."""

    numbers = (Entry("all", -1.0, 1.0),)

    def forward(self, observation: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        return observation + 2.0 * numbers


def test_actor_acts_by_its_trial_or_by_the_best_within_the_range() -> None:
    actor = StructuredActor(Doubled(), torch.tensor([0.25]))
    assert not actor.is_trial
    actor.trial.fill_(0.4)
    with set_exploration_type(ExplorationType.RANDOM):
        acted = actor(torch.tensor([[0.0], [0.5]]))
    assert acted.flatten().tolist() == pytest.approx([0.8, 1.0])
    assert actor.is_trial and actor.acted_by.tolist() == pytest.approx([0.4])
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        acted = actor(torch.tensor([-2.0]))
    assert acted.tolist() == [-1.0]
    assert not actor.is_trial and actor.acted_by.tolist() == [0.25]
    assert hub_structure(actor) is None, "no hub knows it"
    assert hub_structure(Doubled()) is None
    single = SimpleNamespace(hub_source=lambda: "")
    known: Any = actor.structure
    known.single = single
    assert hub_structure(actor) is single  # type: ignore[comparison-overlap]


def test_structure_is_chosen_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(make_structure(Cart(), ""), structures.Linear)
    assert isinstance(make_structure(Cart(), "linear"), structures.Linear)
    with pytest.raises(UnknownNameError) as raised:
        make_structure(Cart(), "liner")
    assert str(raised.value) == (
        "there is no structure 'liner' (did you mean 'linear'?); choose oscillators, approach, "
        "upright, edge, linear or a file"
    )
    refusals = {
        "approach": "an approach observes one distance, and nothing else",
        "upright": "keeping upright is learned on a robot itself, without transforms",
        "edge": "an edge is followed on a robot itself, without transforms",
    }
    for name, message in refusals.items():
        with pytest.raises(DescriptionError) as refused:
            make_structure(Cart(), name)
        assert str(refused.value) == message


@pytest.mark.parametrize("name", ["approach", "upright", "edge", "oscillators"])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"task": None},
        {"keys": ["observation", "image"]},
        {"keys": ["embedding"]},
        {"keeps_actions": False},
    ],
)
def test_hub_acts_on_its_own_numbers_and_commands_alone(
    monkeypatch: pytest.MonkeyPatch, name: str, changes: dict[str, Any]
) -> None:
    """Neither without a task nor behind transforms, of which it knows nothing."""
    sensor = SimpleNamespace(name="light", kind=next(iter(structures.LINE_EDGES)))
    interface = SimpleNamespace(channels=(SimpleNamespace(sensor="light"),))
    robot = SimpleNamespace(sensors=(sensor,))
    usual = {
        "task": SimpleNamespace(interface=interface, entries=("distance",), robot=robot),
        "keys": ["observation"],
        "keeps_actions": True,
    }
    known = usual | changes
    layout = SimpleNamespace(keys=known["keys"], places={})
    monkeypatch.setattr(structures, "interface_of", lambda env: SimpleNamespace(task=known["task"]))
    monkeypatch.setattr(structures, "layout_of", lambda env: layout)
    monkeypatch.setattr(structures, "keeps_actions", lambda env: known["keeps_actions"])
    monkeypatch.setattr(structures, "steps_of", lambda env: 1)
    edge_of = lambda *given: SimpleNamespace(edge_pct=40.0)  # noqa: E731
    monkeypatch.setattr(structures, "edge_of", edge_of)
    single = SimpleNamespace(numbers=(), legs=())
    for module, function in (
        (structures.approach, "approach"),
        (structures.upright, "upright"),
        (structures.edge, "edge_following"),
        (structures.oscillators, "oscillators"),
    ):
        monkeypatch.setattr(module, function, lambda *given, **named: single)
    env: Any = None
    if changes:
        with pytest.raises(DescriptionError):
            structures.STRUCTURES[name](env)
    else:
        made: Any = structures.STRUCTURES[name](env)
        assert made.single is single


def test_approach_observes_one_distance_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    task = SimpleNamespace(interface=None, entries=("distance", "angle"))
    layout = SimpleNamespace(keys=["observation"])
    monkeypatch.setattr(structures, "interface_of", lambda env: SimpleNamespace(task=task))
    monkeypatch.setattr(structures, "layout_of", lambda env: layout)
    monkeypatch.setattr(structures, "keeps_actions", lambda env: True)
    env: Any = None
    with pytest.raises(DescriptionError, match="observes one distance, and nothing else"):
        structures.make_approach(env)
