"""Learning from a dataset: what `study` changes, for every agent that learns."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest
import torch
from learning import LAYOUT, LEARNERS, fresh, small, tensors, transitions

from bricksrl.agents import preset
from bricksrl.agents.agent import Transition, Transitions
from bricksrl.agents.off_policy import OffPolicyAgent
from bricksrl.errors import DataError


def stacked(steps: list[Transition]) -> Transitions:
    return Transitions(
        torch.stack([one.observation for one in steps]),
        torch.stack([one.action for one in steps]),
        torch.tensor([one.reward for one in steps]),
        torch.stack([one.next_observation for one in steps]),
        torch.tensor([one.terminated for one in steps]),
        torch.tensor([one.last for one in steps]),
    )


DATA = stacked(transitions(40))


def studied(agent: str, data: Transitions = DATA, **changes: Any) -> OffPolicyAgent:
    made = fresh(agent, small(agent, **changes)) if agent != "bc" else imitator(**changes)
    made.study(data)
    return made


def imitator(**changes: Any) -> OffPolicyAgent:
    return fresh("bc", replace(preset("default", "bc"), **{"hidden": (16, 16), "batch_size": 10, **changes}))


@pytest.mark.parametrize("agent", [*LEARNERS, "bc"])
def test_a_dataset_is_enough_to_learn(agent: str) -> None:
    one, other = (studied(agent) for _ in range(2))
    before = tensors(one)
    before = [value.clone() for value in before]
    for made in (one, other):
        torch.manual_seed(1)
        assert set(made.update(3)) <= set(made.loss_names)
    assert not all(torch.equal(a, b) for a, b in zip(before, tensors(one), strict=True))
    assert all(torch.equal(a, b) for a, b in zip(tensors(one), tensors(other), strict=True))


def test_a_dataset_is_as_good_as_the_same_experience() -> None:
    remembering = fresh("sac", small("sac"))
    for one in transitions(40):
        remembering.remember(one)
    studying = studied("sac")
    for made in (remembering, studying):
        torch.manual_seed(1)
        made.update(3)
    assert all(torch.equal(a, b) for a, b in zip(tensors(remembering), tensors(studying), strict=True))


def test_half_of_each_batch_comes_from_the_dataset() -> None:
    data = replace(DATA, reward=torch.full_like(DATA.reward, 7.0))
    made = studied("sac", data, hindsight=0.0, new_goals=0.0, batch_size=11)
    assert all((batch.reward == 7.0).all() for batch in made.draw_batches(3))
    made.remember(transitions(1)[0])
    for batch in made.draw_batches(3):
        assert batch.features.shape[0] == 11
        assert (batch.reward == 7.0).sum() == 5


def test_hindsight_stays_within_an_episode_of_the_dataset() -> None:
    n = len(LAYOUT)
    episode = torch.arange(40.0).div(5, rounding_mode="floor")
    data = replace(DATA, next_observation=episode[:, None].expand(40, n), observation=episode[:, None].expand(40, n))
    made = studied("sac", data, hindsight=1.0, new_goals=0.0, goals="plain", angles="raw", batch_size=64)
    goals, reached = ([pair[i] for pair in LAYOUT.goals] for i in range(2))
    encoded = made.encoder(data.observation)
    for batch in made.draw_batches(5):
        for row in batch.features:
            assert ((encoded[:, reached] == row[reached]) & (encoded[:, goals] == row[goals])).all(-1).any()


def test_the_dataset_is_no_part_of_the_state() -> None:
    assert "data" not in studied("sac").state_dict()
    assert len(studied("sac").state_dict()["replay"]["rows"]) == 0


@pytest.mark.parametrize(
    "data",
    [
        replace(DATA, observation=DATA.observation[:, 1:]),
        replace(DATA, action=DATA.action[:, 1:]),
        Transitions(*(getattr(DATA, field.name)[:0] for field in fields(DATA))),
    ],
)
def test_data_of_something_else_is_refused(data: Transitions) -> None:
    with pytest.raises(DataError, match="the agent needs 8 numbers observed and 4 given"):
        studied("sac", data)


BC_CHANGES: dict[str, Any] = {
    "hidden": (16,),
    "learning_rate": 2e-2,
    "adam_beta": 0.7,
    "batch_size": 9,
    "updates_per_step": 5,
    "angles": "raw",
    "goals": "plain",
    "layer_norm": False,
    "dropout": 0.5,
}


@pytest.mark.parametrize("name", [field.name for field in fields(preset("default", "bc"))])
def test_no_setting_of_bc_is_dead(name: str) -> None:
    def after(**changes: Any) -> list[torch.Tensor]:
        made = studied("bc", **changes)
        torch.manual_seed(1)
        made.update()
        return tensors(made)

    before, changed = after(), after(**{name: BC_CHANGES[name]})
    assert not all(a.shape == b.shape and torch.equal(a, b) for a, b in zip(before, changed, strict=False))


def test_bc_does_as_the_data_did_and_learns_from_nothing_else() -> None:
    made = imitator(hidden=(64, 64), batch_size=40, dropout=0.0)
    made.remember(transitions(1)[0])
    assert made.update() == {}
    made.study(DATA)
    made.update(400)
    found = torch.stack([made.act(observation, explore=False) for observation in DATA.observation])
    assert (found - DATA.action).square().mean() < 0.05
    observation = DATA.observation[0]
    assert torch.equal(made.act(observation, explore=True), made.act(observation, explore=False))
