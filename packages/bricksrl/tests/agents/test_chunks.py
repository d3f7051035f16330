"""Action chunks, ACT and the diffusion policy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from small import ENV, dataset, make, settings
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.agents import make_learner, preset
from bricksrl.agents.learner import Learner
from bricksrl.agents.offline.act import ChunkPolicy, ChunkSettings

RHYTHM = torch.tensor([1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
"""Actions of an episode, or their opposites."""


class Silent(EnvBase):
    """Specs of an environment with two entries and two actions."""

    def __init__(self) -> None:
        super().__init__(batch_size=())
        self.observation_spec = Composite(observation=Bounded(-1.0, 1.0, (2,)))
        self.action_spec = Bounded(-1.0, 1.0, (2,))
        self.reward_spec = Unbounded((1,))

    def _reset(self, tensordict: Any = None, **_: Any) -> Any: ...
    def _step(self, tensordict: Any) -> Any: ...
    def _set_seed(self, seed: int | None) -> None: ...


def demonstrations(chunk: int, episodes: int = 40) -> Any:
    """Only the first observation shows the direction of the rhythm."""
    length = len(RHYTHM)
    signs = torch.tensor([1.0, -1.0]).repeat(episodes // 2)
    observation = torch.zeros(episodes, length, 2)
    observation[:, 0, 0] = signs
    action = (signs[:, None] * RHYTHM)[..., None] * torch.tensor([1.0, 0.5])
    done = torch.zeros(episodes, length, 1, dtype=torch.bool)
    done[:, -1] = True
    after = {
        "observation": observation,
        "reward": torch.zeros(episodes, length, 1),
        "terminated": done,
        "done": done,
    }
    shape = [episodes, length]
    frames = TensorDict(
        {"observation": observation, "action": action, "next": TensorDict(after, shape)}, shape
    )
    return dataset(frames.reshape(-1), chunk=chunk, batch_size=32)


def student(agent: str, updates: int, **changes: Any) -> Learner:
    usual = preset("default", agent)
    torch.manual_seed(5)
    learner = make_learner(agent, Silent(), replace(usual, **changes))
    learner.dataset = demonstrations(learner.chunk)
    learner.make_updates(updates)
    return learner


def performed(learner: Learner, *signs: float) -> Tensor:
    """Actions of an episode ``[steps, m]``, or of several robots ``[steps, robots, m]``."""
    learner.reset_policy()
    first = torch.tensor([[sign, 0.0] for sign in signs])
    first = first[0] if len(signs) == 1 else first
    seen = [first] + [torch.zeros_like(first)] * (len(RHYTHM) - 1)
    return torch.stack(
        [
            learner.exploit(TensorDict({"observation": one}, one.shape[:-1]))["action"]
            for one in seen
        ]
    )


def wanted(sign: float) -> Tensor:
    return sign * RHYTHM[:, None] * torch.tensor([1.0, 0.5])


ACT = {
    "width": 32,
    "feedforward": 64,
    "heads": 2,
    "learning_rate": 5e-3,
    "dropout": 0.0,
    "chunk": 6,
}


@pytest.fixture(scope="module")
def act() -> Learner:
    return student("act", 160, **ACT, executed=6, ensemble=None)


def test_act_learns_from_history(act: Learner) -> None:
    for sign in (1.0, -1.0):
        assert (performed(act, sign) - wanted(sign)).abs().mean() < 0.2
    bc = student("bc", 60, hidden=(32,), learning_rate=1e-2)
    assert (performed(bc, 1.0) - wanted(1.0)).abs().mean() > 0.4


def test_diffusion_learns_from_history() -> None:
    learner = student("diffusion", 600, chunk=6, executed=6, hidden=(128, 128), learning_rate=2e-3)
    for sign in (1.0, -1.0):
        assert (performed(learner, sign) - wanted(sign)).abs().mean() < 0.3


def test_chunk_policy_needs_reset_at_episode_start(act: Learner) -> None:
    performed(act, 1.0)
    act.exploit(TensorDict({"observation": torch.tensor([1.0, 0.0])}))
    assert torch.equal(performed(act, -1.0), performed(act, -1.0))
    act.exploit(TensorDict({"observation": torch.tensor([1.0, 0.0])}))
    went_on = torch.stack(
        [
            act.exploit(TensorDict({"observation": torch.tensor([-1.0, 0.0])}))["action"]
            for _ in range(3)
        ]
    )
    assert (went_on - wanted(1.0)[1:4]).abs().mean() < 0.2


def test_batched_chunks_equal_single_ones(act: Learner) -> None:
    together = performed(act, 1.0, -1.0, 1.0)
    for robot, sign in enumerate((1.0, -1.0, 1.0)):
        torch.testing.assert_close(together[:, robot], performed(act, sign), rtol=1e-4, atol=1e-5)


def test_executed_and_ensemble_change_actions(act: Learner) -> None:
    found = []
    for changes in (
        {"executed": 2, "ensemble": None},
        {"executed": 1, "ensemble": 0.0},
        {"executed": 1, "ensemble": 30.0},
    ):
        other = student("act", 0, **ACT, **changes)
        other.policy.load_state_dict(act.policy.state_dict())
        found.append(performed(other, 1.0))
        assert torch.equal(found[-1][0], performed(act, 1.0)[0])
    for place, one in enumerate(found[:2]):
        assert not torch.allclose(one, performed(act, 1.0), atol=0.02), place
    assert (found[2] - wanted(1.0)).abs().mean() < 0.2  # the oldest chunk has all the weight


def test_dropout_only_while_learning() -> None:
    for agent in ("act", "bc"):
        learner = make(agent, dropout=0.5)
        seen = torch.rand(5, 8) * 100.0
        acts = []
        for _ in range(2):
            learner.reset_policy()
            acts.append(learner.exploit(TensorDict({"observation": seen}, [5]))["action"])
        assert torch.equal(*acts)
        action = torch.rand(5, learner.chunk, 4) if learner.chunk else torch.rand(5, 4)
        batch = TensorDict({"observation": seen, "action": action}, [5])
        losses = []
        for _ in range(2):
            torch.manual_seed(4)
            torch.rand(len(losses))
            losses.append(float(learner.loss(batch)[learner.loss.out_keys[0]].detach()))  # type: ignore[misc]
        assert losses[0] != losses[1]


def test_actions_are_within_bounds() -> None:
    learner = student("act", 0, **ACT)
    with torch.no_grad():
        for parameter in learner.policy.parameters():
            parameter.mul_(20.0)
    assert performed(learner, 1.0).abs().max() == 1.0


class Told(torch.nn.Module):
    """A network that predicts what it is told."""

    chunk: torch.Tensor

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return self.chunk


@given(
    executed=st.integers(1, 5),
    chunk=st.integers(5, 8),
    ensemble=st.one_of(st.none(), st.floats(0.0, 3.0)),
    steps=st.integers(1, 20),
)
def test_chunk_policy_equals_list_reference(
    executed: int, chunk: int, ensemble: float | None, steps: int
) -> None:
    network = Told()
    policy = ChunkPolicy(
        torch.nn.Identity(),
        network,
        ChunkSettings(chunk=chunk, executed=executed, ensemble=ensemble),
    )
    seen, made = TensorDict({"observation": torch.zeros(1)}), []
    for step in range(steps):
        network.chunk = made_here = torch.rand(chunk, 2) * 2.0 - 1.0
        if step % executed == 0:
            made.append((step, made_here))
        due = [(start, one[step - start]) for start, one in made if step - start < chunk]
        due = due[-1:] if ensemble is None else due
        weights = torch.tensor([(-(ensemble or 0.0) * place) for place in range(len(due))]).exp()
        expected = sum(
            weight * action
            for weight, (_, action) in zip(weights / weights.sum(), due, strict=True)
        )
        torch.testing.assert_close(policy(seen)["action"], expected)
    policy.reset()
    network.chunk = torch.rand(chunk, 2)
    assert torch.equal(policy(seen)["action"], network.chunk[0])


def test_chunk_length_follows_settings() -> None:
    assert (make("act").chunk, make("diffusion").chunk) == (8, 4)
    assert not hasattr(make("sac"), "chunk")
    assert settings("act").executed == 1
    assert make("act", env=ENV).needs_dataset


def test_reset_reaches_the_policy_that_acts_on_another_device() -> None:
    learner = make("act", chunk=4, executed=4)
    learner.act_on("meta")
    predictions: list[int] = []
    learner.acting.network.register_forward_hook(lambda *_: predictions.append(1))
    for _ in range(2):
        learner.reset_policy()
        learner.exploit(TensorDict({"observation": torch.zeros(8, device="meta")}, []))
    assert len(predictions) == 2


@pytest.mark.parametrize("agent", ["act", "diffusion"])
def test_another_number_of_observations_begins_anew(agent: str) -> None:
    learner = make(agent)
    observations = torch.rand(3, ENV.observation_spec["observation"].shape[-1])
    for batch in (observations, observations[0], observations[:2], observations[:2]):
        action = learner.exploit(TensorDict({"observation": batch}, batch.shape[:-1]))["action"]
        assert action.shape[:-1] == batch.shape[:-1]
