"""Action chunking: what it learns, what each option does, and that nothing comes over an episode's end."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives import ACTLoss

from bricksrl.agents import ACTSettings, make_agent, preset
from bricksrl.agents.agent import Transition, Transitions
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.offline_act import ACTAgent, Chunks
from bricksrl.errors import CheckpointError, DataError, DescriptionError, UnknownNameError
from bricksrl.training.reproducible import reproducible

LAYOUT = ObservationLayout((-1.0, 0.0), (1.0, 360.0), (False, True))
RHYTHM = torch.tensor([1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
"""What is to be done in an episode, or the opposite of it."""


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    with reproducible(3):
        yield


def demonstrations(episodes: int = 40, length: int = len(RHYTHM)) -> Transitions:
    """At the first step is shown which way around the rhythm goes, and nothing later on."""
    signs = torch.tensor([1.0, -1.0]).repeat(episodes // 2)
    first = torch.zeros(episodes, length)
    first[:, 0] = 1.0
    observation = torch.stack((signs[:, None] * first, torch.zeros(episodes, length)), -1).view(-1, 2)
    action = (signs[:, None] * RHYTHM[:length]).view(-1, 1).repeat(1, 2) * torch.tensor([1.0, 0.5])
    zero = torch.zeros(episodes * length)
    last = torch.zeros(episodes, length, dtype=torch.bool)
    last[:, -1] = True
    return Transitions(observation, action, zero, observation, zero.bool(), last.view(-1))


def agent(**changes: Any) -> ACTAgent:
    nets = {"width": 16, "feedforward": 16, "heads": 2}
    usual: dict[str, Any] = {**nets, "batch_size": 16, "chunk": 6, "executed": 6, "ensemble": None}
    torch.manual_seed(5)
    made = make_agent("act", LAYOUT, 2, replace(preset("default", "act"), **{**usual, **changes}))
    assert isinstance(made, ACTAgent)
    return made


def student(updates: int = 0, data: Transitions | None = None, **changes: Any) -> ACTAgent:
    made = agent(**changes)
    made.study(data or demonstrations())
    torch.manual_seed(1)
    if updates:
        made.update(updates)
    return made


def performed(made: Any, sign: float, steps: int = len(RHYTHM)) -> Tensor:
    """What an agent does in an episode ``[steps, m]``."""
    made.start_acting()
    seen = [torch.tensor([sign, 0.0])] + [torch.zeros(2)] * (steps - 1)
    return torch.stack([made.act(observation, explore=False) for observation in seen])


def wanted(sign: float) -> Tensor:
    return sign * RHYTHM[:, None] * torch.tensor([1.0, 0.5])


@pytest.fixture(scope="module")
def learned() -> ACTAgent:
    with reproducible(3):
        return student(300, width=32, feedforward=64, learning_rate=2e-3, dropout=0.0)


def test_it_learns_what_the_observation_of_the_moment_does_not_tell(learned: ACTAgent) -> None:
    for sign in (1.0, -1.0):
        assert (performed(learned, sign) - wanted(sign)).abs().mean() < 0.15
    bc = make_agent("bc", LAYOUT, 2, replace(preset("default", "bc"), hidden=(32, 32)))
    bc.study(demonstrations())  # type: ignore[attr-defined]
    for _ in range(200):
        bc.update()
    assert (performed(bc, 1.0) - wanted(1.0)).abs().mean() > 0.4


def test_it_has_to_be_told_where_an_episode_starts(learned: ACTAgent) -> None:
    performed(learned, 1.0, steps=2)
    assert torch.equal(performed(learned, -1.0), performed(learned, -1.0))
    performed(learned, 1.0, steps=2)
    went_on = torch.stack([learned.act(torch.tensor([-1.0, 0.0]), explore=False) for _ in range(3)])
    assert (went_on - wanted(1.0)[2:5]).abs().mean() < 0.15


def test_many_robots_at_once_act_as_one_by_one(learned: ACTAgent) -> None:
    learned.start_acting()
    signs = torch.tensor([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]])
    seen = [signs] + [torch.zeros(3, 2)] * 5
    together = torch.stack([learned.act(observation, explore=False) for observation in seen])
    for robot, sign in enumerate((1.0, -1.0, 1.0)):
        torch.testing.assert_close(together[:, robot], performed(learned, sign))


def test_actions_are_within_bounds() -> None:
    made = student()
    with torch.no_grad():
        made.actor.head.bias += torch.tensor([5.0, -5.0])
    assert performed(made, 1.0).unique().tolist() == [-1.0, 1.0]


@pytest.mark.parametrize("changes", [{"executed": 2}, {"executed": 1, "ensemble": 0.0}, {"executed": 1, "ensemble": 3.0}])
def test_how_a_chunk_is_carried_out_matters(learned: ACTAgent, changes: dict[str, Any]) -> None:
    other = agent(width=32, feedforward=64, **changes)
    other.load_policy_state(learned.policy_state())
    assert not torch.allclose(performed(other, 1.0), performed(learned, 1.0), atol=0.02)
    assert torch.equal(performed(other, 1.0)[0], performed(learned, 1.0)[0])


def test_the_oldest_chunks_alone_are_an_episode_by_heart(learned: ACTAgent) -> None:
    """Under a large weight what was meant at the start wins against what is thought of later, where nothing is seen."""
    old, new = (agent(width=32, feedforward=64, executed=1, ensemble=weight) for weight in (30.0, None))
    for made in (old, new):
        made.load_policy_state(learned.policy_state())
    assert (performed(old, 1.0) - wanted(1.0)).abs().mean() < 0.15
    assert (performed(new, 1.0) - wanted(1.0)).abs().mean() > 0.4


def test_the_loss_is_torchrls() -> None:
    made = student(3, dropout=0.0)
    features, action = torch.randn(5, made.encoder.size), torch.rand(5, 6, 2) * 2 - 1
    assert made.reader is not None

    def whole(features: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mean, log_variance = made.reader(features, action, torch.ones(5, 6, dtype=torch.bool))
        latent = mean + (0.5 * log_variance).exp() * torch.randn_like(mean)
        return made.actor(features, latent), mean, log_variance

    module = TensorDictModule(whole, ["observation", "action_chunk"], ["action_pred", "mu", "log_var"])
    torch.manual_seed(2)
    theirs = ACTLoss(module, kl_weight=10.0)(TensorDict({"observation": features, ("vla_action", "chunk"): action}, [5]))
    torch.manual_seed(2)
    distance, kl = made.losses(Chunks(features, action, torch.ones(5, 6, dtype=torch.bool)))
    torch.testing.assert_close(distance, theirs["loss_reconstruction"])
    torch.testing.assert_close(kl, theirs["loss_kl"])
    torch.testing.assert_close(distance + made.settings.kl_weight * kl, theirs["loss_act"])


def test_what_follows_an_episodes_end_is_nothing() -> None:
    """Steps are numbered; a chunk has its own ones in their order, and zeros from the end of its episode on."""
    data = demonstrations()
    number = torch.arange(len(data)).float()[:, None].expand(-1, 2)
    made = student(data=replace(data, observation=number / 1000.0, action=number + 1.0), chunk=4, executed=1, angles="raw")
    starts = set()
    for _ in range(30):
        chunks = made.draw()
        for action, known in zip(chunks.action[..., 0], chunks.known, strict=True):
            first = int(action[0]) - 1
            left = min(4, 6 - first % 6)
            assert known.tolist() == [True] * left + [False] * (4 - left)
            assert action.tolist() == [float(first + 1 + i) for i in range(left)] + [0.0] * (4 - left)
            starts.add(first % 6)
    assert starts == set(range(6))


@pytest.mark.parametrize("latent", [0, 4])
def test_padding_leaks_into_no_loss(latent: int) -> None:
    made = student(latent=latent, dropout=0.0)
    chunks = made.draw()
    assert not chunks.known.all()
    garbage = torch.where(chunks.known[..., None], chunks.action, 1e3)
    losses = []
    for action in (chunks.action, garbage):
        torch.manual_seed(4)
        losses.append(made.losses(replace(chunks, action=action)))
    torch.testing.assert_close(losses[0], losses[1], rtol=1e-5, atol=1e-6)
    (gradient,) = torch.autograd.grad(losses[0][0], made.actor.queries, retain_graph=True)
    assert gradient.abs().sum() > 0


def test_a_latent_tells_apart_what_was_meant() -> None:
    """The same is seen, and one of two things is done. The mean is neither: it takes a latent to learn both."""
    data = demonstrations()
    ways = torch.tensor([1.0, -1.0]).repeat_interleave(6).repeat(20)[:, None].expand(-1, 2)
    hidden = replace(data, observation=torch.zeros_like(data.observation), action=ways)

    def found(**more: Any) -> dict[str, float]:
        made = student(80, hidden, learning_rate=3e-3, dropout=0.0, **more)
        return made.update(10)

    free, pressed, none = found(latent=4, kl_weight=0.01), found(latent=4, kl_weight=100.0), found(latent=0)
    assert free["actor_loss"] < 0.3 < 0.7 < min(pressed["actor_loss"], none["actor_loss"])
    assert free["kl"] > 0.3 > 0.01 > pressed["kl"] > 0.0
    assert none["kl"] == 0.0


CHANGES: dict[str, Any] = {
    "learning_rate": 2e-2,
    "adam_beta": 0.7,
    "batch_size": 9,
    "updates_per_step": 5,
    "angles": "raw",
    "goals": "plain",
    "chunk": 7,
    "width": 32,
    "feedforward": 24,
    "heads": 4,
    "encoder_layers": 2,
    "decoder_layers": 2,
    "dropout": 0.5,
    "latent": 0,
    "kl_weight": 0.1,
    "weight_decay": 0.5,
}


@pytest.mark.parametrize("name", [field.name for field in fields(ACTSettings) if field.name not in ("executed", "ensemble")])
def test_no_setting_is_dead(name: str) -> None:
    layout = replace(LAYOUT, goals=((0, 1),), wraps=(True, True))

    def after(**changes: Any) -> list[Tensor]:
        torch.manual_seed(5)
        made = make_agent("act", layout, 2, replace(agent().settings, **changes))
        assert isinstance(made, ACTAgent)
        made.study(demonstrations())
        torch.manual_seed(1)
        made.update()
        return list(made.policy_state().values())

    before, changed = after(), after(**{name: CHANGES[name]})
    assert len(before) != len(changed) or not all(
        a.shape == b.shape and torch.equal(a, b) for a, b in zip(before, changed, strict=True)
    )


def test_state_survives_a_file_and_learning_goes_on_bit_for_bit() -> None:
    one, other = student(3), student()
    file = io.BytesIO()
    torch.save(one.state_dict(), file)
    file.seek(0)
    other.load_state_dict(torch.load(file, weights_only=True))
    for each in (one, other):
        torch.manual_seed(1)
        each.update(2)
    assert one.state_dict()["updates"] == 5
    for name, value in one.policy_state().items():
        assert torch.equal(value, other.policy_state()[name])
    assert torch.equal(performed(one, 1.0), performed(other, 1.0))
    with pytest.raises(CheckpointError, match="does not fit this agent"):
        agent(chunk=5, executed=1).load_state_dict(one.state_dict())


def test_it_learns_from_nothing_that_it_did() -> None:
    made = agent()
    made.remember(Transition(torch.zeros(2), torch.zeros(2), 1.0, torch.zeros(2), False))
    made.end_episode()
    assert made.update() == {}
    with pytest.raises(DataError, match="the agent needs 2 numbers observed and 2 given"):
        made.study(replace(demonstrations(), action=torch.zeros(240, 3)))


@pytest.mark.parametrize(
    "change",
    [
        {"chunk": 0},
        {"executed": 0},
        {"executed": 9},
        {"ensemble": -0.1},
        {"width": 0},
        {"heads": 3},
        {"feedforward": 0},
        {"encoder_layers": 0},
        {"decoder_layers": 0},
        {"dropout": 1.0},
        {"latent": -1},
        {"kl_weight": -1.0},
        {"weight_decay": -1.0},
        {"batch_size": 0},
    ],
)
def test_impossible_settings_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError, match=next(iter(change))):
        replace(ACTSettings(), **change)


def test_the_papers_are_its_authors() -> None:
    paper = preset("paper", "act")
    assert isinstance(paper, ACTSettings)
    assert (paper.learning_rate, paper.batch_size, paper.chunk, paper.kl_weight, paper.dropout) == (1e-5, 8, 100, 10.0, 0.1)
    assert (paper.encoder_layers, paper.decoder_layers, paper.feedforward, paper.width, paper.heads) == (4, 7, 3200, 512, 8)
    assert (paper.executed, paper.ensemble, paper.latent, paper.weight_decay) == (1, 0.01, 32, 1e-4)


def test_images_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="act cannot learn from images; choose one of"):
        preset("default", "act", images=True)
