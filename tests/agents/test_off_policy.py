from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest
import torch
from learning import LAYOUT, LEARNERS, TASK, assert_go_on_alike, fresh, learned, saved, small, tensors, transitions
from torch import Tensor

from bricksrl.agents import make_agent, preset
from bricksrl.agents.agent import Transition
from bricksrl.errors import CheckpointError, DescriptionError

CHANGES: dict[str, Any] = {
    "hidden": (16,),
    "learning_rate": 2e-2,
    "adam_beta": 0.7,
    "batch_size": 9,
    "gamma": 0.5,
    "tau": 0.5,
    "updates_per_step": 3,
    "actor_delay": 2,
    "angles": "raw",
    "goals": "plain",
    "hindsight": 0.0,
    "new_goals": 0.2,
    "replay_size": 10,
    "initial_alpha": 0.9,
    "min_scale": 2.0,
    "entropy": 0.0,
    "critics": 3,
    "target_critics": 1,
    "actor_value": "mean",
    "dropout": 0.5,
    "target_noise": 0.0,
    "target_noise_limit": 0.01,
    "momentum": 0.5,
    "expectile": 0.3,
    "temperature": 0.5,
    "min_q_weight": 3.0,
    "lagrange_threshold": 1.0,
    "sampled_actions": 3,
    "drawn_actions": 0,
    "imitation_updates": 2,
    "value_weight": 0.5,
    "precision": "bfloat16",
}
OPPOSITE = ("layer_norm", "actor_layer_norm")
ELSEWHERE = ("prefill_episodes", "exploration_noise")


@pytest.mark.parametrize(
    ("agent", "name"),
    [
        (agent, field.name)
        for agent in ("sac", "td3", "crossq", "iql", "cql", "td3bc")
        for field in fields(preset("default", agent))
        if field.name not in ELSEWHERE
    ],
)
def test_no_setting_is_dead(agent: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"bf16": True})  # what a processor has not, it does slowly
    usual = small(agent)
    value = not getattr(usual, name) if name in OPPOSITE else CHANGES[name]
    assert value != getattr(usual, name)
    before, after = tensors(learned(agent, usual)), tensors(learned(agent, small(agent, **{name: value})))
    assert not all(a.shape == b.shape and torch.equal(a, b) for a, b in zip(before, after, strict=False))
    assert all(torch.equal(a, b) for a, b in zip(before, tensors(learned(agent, usual)), strict=True))


@pytest.mark.parametrize("agent", LEARNERS)
def test_prefill_is_what_the_settings_say(agent: str) -> None:
    assert fresh(agent, small(agent, prefill_episodes=7)).prefill_episodes == 7


@pytest.mark.parametrize("agent", LEARNERS)
def test_without_experience_there_is_nothing_to_update(agent: str) -> None:
    assert fresh(agent).update() == {}


@pytest.mark.parametrize("agent", LEARNERS)
@pytest.mark.parametrize("replay_size", [1000, 22])
def test_state_survives_a_file_and_learning_goes_on_bit_for_bit(agent: str, replay_size: int) -> None:
    one = learned(agent, small(agent, replay_size=replay_size, actor_delay=2))
    other = fresh(agent, small(agent, replay_size=replay_size, actor_delay=2), seed=5)
    other.load_state_dict(saved(one))
    assert_go_on_alike(one, other, transitions(15))


@pytest.mark.parametrize("agent", LEARNERS)
def test_state_of_other_networks_is_refused(agent: str) -> None:
    state = learned(agent).state_dict()
    with pytest.raises(CheckpointError, match="does not fit this agent") as caught:
        fresh(agent, small(agent, hidden=(8,))).load_state_dict(state)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("agent", LEARNERS)
def test_acts_within_bounds_and_explores_around_the_best(agent: str) -> None:
    made = learned(agent)
    observation = transitions(1)[0].observation
    best = made.act(observation, explore=False)
    assert torch.equal(best, made.act(observation, explore=False))
    drawn = torch.stack([made.act(observation, explore=True) for _ in range(50)])
    assert drawn.std(0).min() > 0.02
    assert drawn.abs().max() <= 1.0


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_learns_the_action_that_pays(agent: str) -> None:
    made = fresh(agent, small(agent, gamma=0.0, hidden=(32, 32), batch_size=32, hindsight=0.0, new_goals=0.0))
    torch.manual_seed(2)
    for one in transitions(200):
        made.remember(Transition(one.observation, one.action, float(one.action[0] - one.action[1]), one.next_observation, False))
    for _ in range(250):
        made.update()
    best = torch.stack([made.act(one.observation, explore=False) for one in transitions(20)])
    assert best[:, 0].mean() > 0.6
    assert best[:, 1].mean() < -0.6


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_values_go_on_through_a_time_limit_and_end_at_a_termination(agent: str) -> None:
    def values(*, terminated: bool) -> Tensor:
        changes = {"gamma": 0.8, "learning_rate": 3e-3, "hindsight": 0.0, "new_goals": 0.0, "batch_size": 32}
        extra = {"tau": 0.1} if agent != "crossq" else {"momentum": 0.1}
        small_alpha = {} if agent == "td3" else {"initial_alpha": 1e-4}
        made = fresh(agent, small(agent, **changes, **extra, **small_alpha))
        for one in transitions(30):
            made.remember(Transition(one.observation, one.action, 1.0, one.next_observation, terminated, True))
        for _ in range(500 if agent == "crossq" else 200):  # CrossQ's values come slower
            made.update()
        observation, action = (torch.stack([getattr(one, name) for one in transitions(30)]) for name in ("observation", "action"))
        of_each: Tensor = made.critics(made.encoder(observation), action).detach().mean(0)  # type: ignore[attr-defined]
        return of_each

    assert (values(terminated=True) - 1.0).abs().max() < 0.3
    assert values(terminated=False).min() > 2.5


@pytest.mark.parametrize("agent", LEARNERS)
def test_the_actor_learns_in_every_nth_update(agent: str) -> None:
    made = learned(agent, small(agent, actor_delay=3), updates=2)
    untouched = {name: value.clone() for name, value in fresh(agent).actor.named_parameters()}
    assert all(torch.equal(value, untouched[name]) for name, value in made.actor.named_parameters())
    assert "actor_loss" in made.update()
    assert not any(torch.equal(value, untouched[name]) for name, value in made.actor.named_parameters())


def test_droq_learns_as_its_authors_have_it() -> None:
    made = fresh("droq", small("droq", updates_per_step=20, actor_delay=20))
    for one in transitions(30):
        made.remember(one)
    calls: list[tuple[int, bool]] = []
    learn = made.learn_in_turn
    made.learn_in_turn = lambda batches, *, actor: calls.append((len(batches), actor)) or learn(batches, actor=actor)  # type: ignore[method-assign, func-returns-value]
    made.update()
    assert calls == [(20, True)]


def test_more_noise_explores_more() -> None:
    observation = transitions(1)[0].observation

    def spread(noise: float) -> float:
        made = fresh("td3", small("td3", exploration_noise=noise))
        return float(torch.stack([made.act(observation, explore=True) for _ in range(50)]).std(0).mean())

    assert spread(0.0) == pytest.approx(0.0, abs=1e-6)
    assert spread(0.3) > 2 * spread(0.1) > 0.1


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_bfloat16_goes_on_bit_for_bit_too(agent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"bf16": True})
    one = learned(agent, small(agent, precision="bfloat16"))
    other = fresh(agent, small(agent, precision="bfloat16"), seed=5)
    other.load_state_dict(one.state_dict())
    assert_go_on_alike(one, other, transitions(30))


def test_a_processor_without_bfloat16_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    with pytest.raises(DescriptionError, match="no arithmetic in bfloat16"):
        fresh("sac", small("sac", precision="bfloat16"))


def test_settings_of_another_agent_are_refused() -> None:
    with pytest.raises(DescriptionError, match=r"TD3Settings, not SACSettings.*preset\('default', 'td3'\)"):
        make_agent("td3", LAYOUT, 4, preset("default", "sac"), TASK)
