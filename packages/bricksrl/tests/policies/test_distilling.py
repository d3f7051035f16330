"""How a network for a hub is taught: whose steps it sees, and what it is told of them."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from brickhub.entry import Entry
from brickhub.seed import derive_seed
from bricksrl.policies import hub_network
from bricksrl.policies.hub_network import HubNetwork

ENTRIES = [Entry("way", -50.0, 150.0, "mm"), Entry("turn", 0.0, 360.0, "deg", wraps=True)]


class Teacher:
    """Acts by a tenth of the way, and counts what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def __call__(self, state: Any) -> Any:
        return state

    def act(self, observation: Tensor) -> Tensor:
        self.asked.append(float(observation[0]))
        return observation[:1] / 10.0

    def reset(self) -> None:
        """It remembers nothing."""


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Episodes of three steps, by whom they were played, and their seeds."""
    episodes: list[Any] = []
    monkeypatch.setattr(hub_network, "seed_episode", lambda env, seed: episodes.append([seed]))

    def play(_env: Any, policy: Any, *, reset_policy: Any) -> Any:
        episodes[-1].append(policy)
        for step in range(3):
            observation = torch.tensor([10.0 * len(episodes) + step, 90.0])
            yield {"observation": observation, "action": torch.tensor([0.5])}

    monkeypatch.setattr(hub_network, "play", play)
    return episodes


def test_student_acts_after_the_first_round_and_the_policy_says_what_it_would_have_done(
    monkeypatch: pytest.MonkeyPatch, played: list[Any]
) -> None:
    """A round of four steps takes two episodes of three."""
    for name, value in (("ROUNDS", 3), ("STEPS", 4), ("UPDATES", 1)):
        monkeypatch.setattr(hub_network, name, value)
    torch.manual_seed(0)
    network = HubNetwork(ENTRIES, 1, (4,))
    held: list[Tensor] = []
    monkeypatch.setattr(HubNetwork, "hold", lambda self, observations: held.append(observations))
    teacher: Any = Teacher()
    env: Any = None
    hub_network.distil(env, teacher, network, 7)
    assert [seed for seed, _ in played] == [
        derive_seed(7, "distil", number) for number in range(1, 7)
    ]
    assert [policy is teacher for _, policy in played] == [True] * 2 + [False] * 4
    of_students = [10.0 * number + step for number in range(3, 7) for step in range(3)]
    assert teacher.asked == of_students
    (observations,) = held
    assert len(observations) == 18 and observations[:3, 0].tolist() == [10.0, 11.0, 12.0]
    for parameter in network.parameters():
        for value in parameter.flatten().tolist():
            assert value == pytest.approx(float(f"{value:.4g}"), rel=1e-6), "as it is written"


def test_rate_falls_to_nothing_within_a_round(
    monkeypatch: pytest.MonkeyPatch, played: list[Any]
) -> None:
    for name, value in (("ROUNDS", 2), ("STEPS", 3), ("UPDATES", 4)):
        monkeypatch.setattr(hub_network, name, value)
    rates: list[float] = []
    adam = torch.optim.Adam

    class Noted(adam):
        def step(self, closure: Any = None) -> Any:
            rates.append(self.param_groups[0]["lr"])
            return super().step(closure)

    monkeypatch.setattr(torch.optim, "Adam", Noted)
    env: Any = None
    teacher: Any = Teacher()
    hub_network.distil(env, teacher, HubNetwork(ENTRIES, 1, (4,)), 7)
    first = hub_network.LEARNING_RATE
    assert rates == pytest.approx([first, 0.75 * first, 0.5 * first, 0.25 * first] * 2)


def test_network_is_held_within_what_it_has_seen() -> None:
    network = HubNetwork(ENTRIES, 1, (4,))
    network.hold(torch.tensor([[10.0, 5.0], [-20.0, 350.0], [33.333333, 0.0]]))
    assert network.held == [(-20.0, 33.33)], "as it is written, and angles are not held"
    torch.manual_seed(0)
    network.round()
    with torch.no_grad():
        far = network(torch.tensor([[500.0, 90.0], [33.33, 90.0]]))
    assert torch.allclose(far[0], far[1], atol=1e-6)


def test_program_has_the_numbers_of_its_network() -> None:
    network = HubNetwork(ENTRIES, 1, (2,))
    with torch.no_grad():
        for layer, start in zip(network.layers, (0.5, -0.25), strict=True):
            layer.weight.copy_(torch.full_like(layer.weight, start))
            layer.bias.copy_(torch.full_like(layer.bias, start / 2))
    network.held = [(-20.0, 33.33)]
    source = network.hub_source()
    assert "    (0, 0.01, -0.5, -20, 33.33),\n" in source, "of -50 to 150 the middle is 50"
    assert "\nANGLES = ((1, 2),)  # indices" in source
    assert source.count("        (0.5, 0.5, 0.5, 0.25),\n") == 2
    assert source.count("        (-0.25, -0.25, -0.125),\n") == 1
