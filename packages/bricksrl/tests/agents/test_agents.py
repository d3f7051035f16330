"""All agents: acting, settings, states."""

from __future__ import annotations

import copy
import functools
import itertools
import pickle
from dataclasses import fields
from typing import Any, get_args

import pytest
import torch
from small import (
    ENV,
    IMITATING,
    LEARNING,
    REPLAYING,
    dataset,
    learned,
    make,
    rollout,
    same,
    saved,
    settings,
    steps,
    taught,
    tensors,
    weights,
)
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.agents import AGENTS, make_learner
from bricksrl.agents.learner import Learner
from bricksrl.agents.settings import Norm
from bricksrl.envs.specs import SpecsEnv, end_specs
from bricksrl.errors import CheckpointError, DescriptionError


@functools.cache
def known(agent: str) -> Learner:
    """A learner for tests that change nothing of it."""
    return make(agent) if agent == "random" else learned(agent)


def restarted(learner: Learner) -> Learner:
    learner.reset_policy()
    return learner


@pytest.mark.parametrize("agent", AGENTS)
def test_acts_on_single_and_batched_observations(agent: str) -> None:
    learner, seen = known(agent), steps(6)
    for state, shape in ((seen[0], (4,)), (seen, (6, 4)), (seen.view(2, 3), (2, 3, 4))):
        for way in ("exploit", "explore"):
            action = getattr(restarted(learner), way)(state)["action"]
            assert action.shape == shape
            assert not action.requires_grad
            assert action.abs().max() <= 1.0
    if agent not in ("random", "diffusion"):  # these draw
        many = restarted(learner).exploit(seen)["action"]
        alone = torch.stack([restarted(learner).exploit(one)["action"] for one in seen])
        torch.testing.assert_close(many, alone, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("agent", REPLAYING)
def test_exploration_is_around_the_best_action(agent: str) -> None:
    learner, seen = known(agent), steps(1)[0]
    best = learner.exploit(seen)["action"]
    assert torch.equal(best, learner.exploit(seen)["action"])
    drawn = torch.stack([learner.explore(seen)["action"] for _ in range(50)])
    assert drawn.std(0).min() > 0.02


def test_more_noise_explores_more() -> None:
    def spread(noise: float) -> float:
        learner, seen = make("td3", exploration_noise=noise), steps(1)[0]
        return float(
            torch.stack([learner.explore(seen)["action"] for _ in range(50)]).std(0).mean()
        )

    assert spread(0.0) == pytest.approx(0.0, abs=1e-6)
    assert spread(0.3) > 2 * spread(0.1) > 0.1


def test_random_is_uniform_and_learns_nothing() -> None:
    learner = make("random")
    actions = learner.exploit(steps(1)[0].expand(4000))["action"]
    assert actions.mean(0).abs().max() < 0.05
    assert actions.std(0) == pytest.approx(torch.full((4,), 3**-0.5), abs=0.02)
    learner.remember(steps(5))
    assert learner.learn() == {}
    learner.load_state_dict(learner.state_dict())


@pytest.mark.parametrize("agent", AGENTS)
def test_acting_changes_nothing(agent: str) -> None:
    learner = known(agent)
    before = weights(learner)
    for act in (learner.exploit, learner.explore):
        act(steps(20))
    assert same(before, weights(learner))


@pytest.mark.parametrize("agent", AGENTS)
def test_policy_copy_is_independent(agent: str) -> None:
    learner, seen = (learned(agent) if agent != "random" else make(agent)), steps(4)
    # it was made here
    for copied in (copy.deepcopy(learner.policy), pickle.loads(pickle.dumps(learner.policy))):  # noqa: S301
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            before = tensors(dict(copied.state_dict()))
            torch.manual_seed(1)
            one = copied(seen.select(*copied.in_keys))["action"]
            torch.manual_seed(1)
            assert torch.equal(one, restarted(learner).exploit(seen)["action"])
            for tensor in learner.policy.parameters():
                tensor.data += 0.1
            assert all(
                torch.equal(a, b)
                for a, b in zip(before, tensors(dict(copied.state_dict())), strict=True)
            )
            getattr(copied, "reset", lambda: None)()
            torch.manual_seed(1)
            assert torch.equal(copied(seen.select(*copied.in_keys))["action"], one)
        learner.policy.load_state_dict(copied.state_dict())


@pytest.mark.parametrize("agent", LEARNING)
def test_policy_state_restores_actions(agent: str) -> None:
    one, other, seen = known(agent), make(agent, seed=5), steps(4)
    state = one.policy_state()
    assert all(value.device.type == "cpu" and not value.requires_grad for value in state.values())
    other.policy.load_state_dict(state)
    actions = []
    for learner in (one, other):
        torch.manual_seed(1)
        actions.append(restarted(learner).exploit(seen)["action"])
    assert torch.equal(*actions)


def go_on(learner: Learner) -> list[Tensor]:
    """Continue with more frames and updates."""
    torch.manual_seed(1)
    if learner.needs_dataset:
        learner.dataset = dataset(chunk=learner.chunk)
    if learner.on_policy:
        ENV.set_seed(6)
        learner.remember(rollout(learner))
        learner.learn()
    else:
        for frame in steps(6):
            learner.remember(frame[None])
            learner.learn()
    return [*weights(learner), restarted(learner).exploit(steps(4))["action"]]


@pytest.mark.parametrize(
    ("agent", "buffer_size"),
    [*((agent, 1000) for agent in LEARNING), *((agent, 9) for agent in REPLAYING)],
)
def test_restored_state_continues_bit_identical(agent: str, buffer_size: int) -> None:
    changes = {
        "buffer_size": buffer_size,
        "actor_delay": 2,
        "n_step": 2,
        "updates_per_step": 0.7,
        "imitation_updates": 3,
    }
    changes |= {"updates_per_step": 2.0} if agent == "ppo" else {}
    one, other = _after_steps(make(agent, **changes)), make(agent, seed=5, **changes)
    other.load_state_dict(saved(one))
    assert same(weights(one), weights(other))
    assert same(go_on(one), go_on(other))


def _after_steps(learner: Learner) -> Learner:
    if learner.needs_dataset or learner.on_policy:
        return taught(learner)
    torch.manual_seed(2)
    for frame in steps(14):  # an odd number of updates, and a part of one
        learner.remember(frame[None])
        learner.learn()
    return learner


@pytest.mark.parametrize("agent", LEARNING)
def test_state_of_other_networks_raises(agent: str) -> None:
    changes = {"hidden": (8,), "width": 8, "heads": 2}
    with pytest.raises(CheckpointError, match="does not fit this agent") as caught:
        make(agent, **changes).load_state_dict(known(agent).state_dict())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"policy": {}},
        {"policy": 3},
        {"policy": None, "updates": "many"},
        {"updates": None},
        {"loss": {}},
        {"loss": 3},
        {"optimizer": {}},
        {"optimizer": {"state": {}, "param_groups": []}},
        {"memory": {}},
        {
            "memory": {
                "rows": {"observation": torch.zeros(3, 2)},
                "writer": {},
                "successor": torch.zeros(3),
                "last": None,
            }
        },
        {"memory": {"rows": 3}},
        {"memory": []},
    ],
)
@pytest.mark.parametrize("agent", ["sac", "tqc"])
def test_broken_state_raises(agent: str, wrong: dict[str, Any]) -> None:
    state = known(agent).state_dict()
    with pytest.raises(CheckpointError, match="does not fit this agent") as caught:
        make(agent).load_state_dict({**state, **wrong} if wrong else {})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("agent", LEARNING)
def test_state_has_plain_values(agent: str) -> None:
    def plain(value: Any) -> bool:
        if isinstance(value, dict):
            return all(isinstance(key, str | int) and plain(one) for key, one in value.items())
        if isinstance(value, list | tuple):
            return all(plain(one) for one in value)
        return value is None or isinstance(value, Tensor | int | float | str | bool)

    assert plain(known(agent).state_dict())


@pytest.mark.parametrize("agent", LEARNING)
def test_learner_is_on_the_given_device(agent: str) -> None:
    learner = make_learner(agent, ENV, settings(agent), "cpu:0")
    assert learner.device.type == "cpu"
    learner.load_state_dict(known(agent).state_dict())


CHANGES: dict[str, Any] = {
    "hidden": (12,),
    "learning_rate": 2e-2,
    "adam_beta": 0.7,
    "batch_size": 9,
    "gamma": 0.5,
    "tau": 0.5,
    "updates_per_step": 3.0,
    "actor_delay": 2,
    "angles": "raw",
    "goals": "plain",
    "hindsight": 0.0,
    "new_goals": 0.2,
    "buffer_size": 30,
    "n_step": 2,
    "alpha_init": 0.9,
    "min_scale": 2.0,
    "target_entropy": 0.0,
    "num_qs": 3,
    "num_min_qs": 1,
    "actor_q": "mean",
    "dropout": 0.5,
    "target_noise": 0.0,
    "target_noise_clip": 0.01,
    "momentum": 0.5,
    "quantiles": 7,
    "dropped": 2,
    "expectile": 0.3,
    "temperature": 0.5,
    "min_q_weight": 3.0,
    "lagrange_threshold": 1.0,
    "sampled_actions": 3,
    "drawn_actions": 0,
    "imitation_updates": 2,
    "value_weight": 0.5,
    "gae_lambda": 0.3,
    "steps": 6,
    "passes": 3,
    "clip_epsilon": 0.001,
    "entropy_coeff": 0.3,
    "max_grad_norm": 0.01,
    "chunk": 5,
    "width": 32,
    "feedforward": 24,
    "heads": 4,
    "encoder_layers": 2,
    "decoder_layers": 2,
    "latent": 4,
    "reset_every": 1,
    "critic_loss": "smooth-l1",
    "actor_dropout": 0.5,
    "kl_weight": 0.1,
    "weight_decay": 0.5,
    "denoising_steps": 5,
}
OPPOSITE = ("normalize", "start_value")
NORMS = ("critic_norm", "actor_norm")
ELSEWHERE = (
    *NORMS,
    "prefill_episodes",
    "exploration_noise",
    "network",
    "encoder",
    "shift_px",
    "mirror",
    "memory_mapped",
    "scale_rewards",
    "executed",
    "ensemble",
)
"""Settings with tests of their own."""
OF_DATASET = ("batch_size", "hidden")
"""Imitation settings that only affect the dataset, or nothing in ACT."""


@pytest.mark.parametrize(
    ("agent", "name"),
    [
        (agent, field.name)
        for agent in LEARNING
        for field in fields(settings(agent))
        if field.name not in ELSEWHERE and not (agent in IMITATING and field.name in OF_DATASET)
    ],
)
def test_every_setting_has_an_effect(agent: str, name: str) -> None:
    usual = getattr(settings(agent), name)
    value = not usual if name in OPPOSITE else CHANGES[name]
    if value == usual:
        value = "min" if name == "actor_q" else value * 0.5
    assert value != usual
    assert not same(_usual(agent), _with(agent, **{name: value}))


@pytest.mark.parametrize(
    ("agent", "name"),
    [(agent, name) for agent in LEARNING for name in NORMS if hasattr(settings(agent), name)],
)
def test_each_normalisation_learns_otherwise(agent: str, name: str) -> None:
    learned = [_with(agent, **{name: norm}) for norm in get_args(Norm)]
    assert not any(itertools.starmap(same, itertools.combinations(learned, 2)))
    assert not any(bool(tensor.isnan().any()) for of_one in learned for tensor in of_one)


def test_batch_of_one_is_not_normalised_by_itself() -> None:
    with pytest.raises(
        DescriptionError, match="a batch of 1 has no statistics; give a batch_size of 2 or more"
    ):
        make("td3", critic_norm="batch", batch_size=1)


@pytest.mark.parametrize("agent", LEARNING)
def test_equal_seeds_learn_equally(agent: str) -> None:
    assert same(_usual(agent), _with(agent))


@functools.cache
def _usual(agent: str) -> list[Tensor]:
    return _with(agent)


def _with(agent: str, **changes: Any) -> list[Tensor]:
    """Weights and number of updates after some learning with a changed setting."""
    changes = {"batch_size": 4, **changes} if agent == "ppo" else changes
    learner = make(agent, **changes)
    if learner.on_policy or learner.needs_dataset:
        taught(learner)
    else:
        torch.manual_seed(2)
        for frames in steps(40).split(20):
            learner.remember(frames)
        learner.learn(2)
    return [*weights(learner), torch.tensor([learner.updates_per_step, learner.frames_per_batch])]


def test_random_agent_of_images_alone_acts_in_any_batch() -> None:
    """An image has three dimensions, which are no batch."""
    spec = Composite(image=Bounded(0, 255, (8, 8, 3), dtype=torch.uint8))
    env = SpecsEnv(
        {
            "observation_spec": spec,
            "action_spec": Bounded(-1.0, 1.0, (2,)),
            "reward_spec": Unbounded((1,)),
            "done_spec": end_specs(),
        },
        None,
    )
    learner = make_learner("random", env)
    for batch in ((), (5,), (2, 3)):
        image = torch.zeros(*batch, 8, 8, 3, dtype=torch.uint8)
        action = learner.explore(TensorDict({"image": image}, batch))["action"]
        assert action.shape == (*batch, 2) and bool((action.abs() <= 1.0).all())
