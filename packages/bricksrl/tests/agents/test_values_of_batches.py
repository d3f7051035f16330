"""Parts of the losses of actors and critics, with numbers made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from small import make, steps
from tensordict import TensorDict
from torch import Tensor, nn

from bricksrl.agents.actor_critic import Critics, PolyakUpdate, on_base, squared_errors
from bricksrl.agents.networks import BatchNorm, Dropout, mlp
from bricksrl.agents.sac import location_and_scale
from bricksrl.agents.td3 import last_biased_layer
from bricksrl.errors import DescriptionError


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_next_value_counts_until_the_end_and_less_after_more_steps(agent: str) -> None:
    loss = make(agent, gamma=0.5).loss
    frames = steps(4)
    frames["next", "terminated"] = torch.tensor([[False], [True], [False], [True]])
    frames["next", "reward"] = torch.tensor([[1.0], [2.0], [3.0], [4.0]])
    batch = loss.encode(frames)
    assert batch.discount.tolist() == [0.5, 0.0, 0.5, 0.0]
    assert batch.reward.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert batch.base is None and batch.next_base is None
    assert torch.equal(batch.action, frames["action"])
    assert batch.features.requires_grad is batch.next_features.requires_grad is False
    frames["steps_to_next_obs"] = torch.tensor([[1], [1], [3], [2]])
    assert loss.encode(frames).discount.tolist() == [0.5, 0.0, 0.125, 0.0]


def test_actions_on_a_base_are_within_the_range() -> None:
    action = torch.tensor([0.5, -0.75, 0.25])
    assert on_base(action, None) is action
    base = torch.tensor([0.75, -0.5, -0.5])
    assert on_base(action, base).tolist() == [1.0, -1.0, -0.25]


def test_critics_are_asked_one_by_one() -> None:
    first = nn.Linear(3, 1, bias=False)
    second = nn.Linear(3, 1, bias=False)
    with torch.no_grad():
        first.weight.copy_(torch.tensor([[1.0, 0.0, 0.0]]))
        second.weight.copy_(torch.tensor([[0.0, 2.0, -1.0]]))
    critics = Critics([first, second])
    features = torch.tensor([[1.0, 2.0], [3.0, 4.0]])
    action = torch.tensor([[10.0], [20.0]])
    values = critics(features, action)
    assert values.tolist() == [[1.0, 3.0], [-6.0, -12.0]]
    target = torch.tensor([1.0, 1.0])
    # Means of 0 and 4, and of 49 and 169: their sum.
    assert float(squared_errors(values.detach(), target)) == 2.0 + 109.0


def test_targets_move_by_a_share_and_begin_as_their_networks() -> None:
    networks = [nn.Linear(2, 1), nn.Linear(2, 1)]
    targets = [nn.Linear(2, 1), nn.Linear(2, 1)]
    update = PolyakUpdate(*zip(networks, targets, strict=True), tau=0.25)
    for network, target in zip(networks, targets, strict=True):
        for parameter in network.parameters():
            parameter.data.fill_(4.0)
        for parameter in target.parameters():
            parameter.data.fill_(8.0)
    update.step()
    found = {value for target in targets for part in target.parameters() for value in part.view(-1)}
    assert {float(value.detach()) for value in found} == {7.0}
    assert {float(part.detach().view(-1)[0]) for part in networks[0].parameters()} == {4.0}
    update.init_()
    assert all(bool((part == 4.0).all()) for target in targets for part in target.parameters())


@pytest.mark.parametrize(("count", "wanted"), [(1, {1.0, 2.0, 3.0}), (2, {1.0, 2.0}), (3, {1.0})])
def test_target_is_the_least_of_the_critics_that_are_drawn(count: int, wanted: set[float]) -> None:
    loss: Any = make("sac").loss

    class Constant(nn.Module):
        def __init__(self, value: float) -> None:
            super().__init__()
            self.value = value

        def forward(self, x: Tensor) -> Tensor:
            return torch.full((len(x), 1), self.value)

    loss.target_critics = Critics([Constant(value) for value in (1.0, 2.0, 3.0)])
    loss.settings = SimpleNamespace(num_min_qs=count)
    batch: Any = SimpleNamespace(next_features=torch.zeros(2, 3))
    torch.manual_seed(0)
    found = {float(loss.next_qvalue(batch, torch.zeros(2, 1))[0]) for _ in range(60)}
    assert found == wanted


@pytest.mark.parametrize(
    ("gamma", "count", "terminated", "value"),
    [
        (0.9, 40, 0.0, -20.0),
        (0.9, 40, 0.5, -2.0 / 0.55),
        (0.9, 40, 1.0, -2.0),
        (0.999, 40, 0.0, -2000.0),
        (1.0, 40, 0.0, -80.0),
        (1.0, 4000, 0.0, -2000.0),
        (1.0, 40, 0.5, -4.0),
    ],
)
def test_critics_begin_at_the_value_of_the_mean_reward(
    gamma: float, count: int, terminated: float, value: float
) -> None:
    """A horizon is no longer than that of 0.999, nor than what was seen."""
    loss: Any = make("td3", gamma=gamma).loss
    ends = torch.arange(count)[:, None] < terminated * count
    after = {"reward": torch.full((count, 1), -2.0), "terminated": ends}
    loss.start_at_mean_value(TensorDict({"next": TensorDict(after, [count])}, [count]))
    for critic in (*loss.critics, *loss.target_critics):
        assert float(critic[-1].bias.detach()) == pytest.approx(value, rel=1e-3)


def test_last_layer_with_a_bias_is_found() -> None:
    first = nn.Linear(2, 2)
    second = nn.Linear(2, 1)
    unbiased = nn.Linear(2, 1, bias=False)
    assert last_biased_layer(nn.Sequential(first, nn.ReLU(), second)) is second
    assert last_biased_layer(nn.Sequential(first, nn.ReLU(), unbiased)) is first
    assert last_biased_layer(nn.Sequential(unbiased)) is None


@pytest.mark.parametrize(
    ("options", "kinds"),
    [
        ({}, [nn.Linear, nn.ReLU, nn.Linear, nn.ReLU, nn.Linear]),
        (
            {"norm": "layer", "dropout": 0.5},
            [nn.Linear, Dropout, nn.LayerNorm, nn.ReLU] * 2 + [nn.Linear],
        ),
        ({"norm": "rms"}, [nn.Linear, nn.RMSNorm, nn.ReLU] * 2 + [nn.Linear]),
        ({"norm": "batch"}, [nn.Linear, BatchNorm, nn.ReLU] * 2 + [nn.Linear]),
        ({"dropout": 0.5}, [nn.Linear, Dropout, nn.ReLU] * 2 + [nn.Linear]),
    ],
)
def test_layers_are_dropped_and_normalised_before_they_are_rectified(
    options: dict[str, Any], kinds: list[type]
) -> None:
    network = mlp(3, 2, (5, 4), **options)
    assert [type(layer) for layer in network] == kinds
    sizes = [layer.weight.shape for layer in network if isinstance(layer, nn.Linear)]
    assert sizes == [(5, 3), (4, 5), (2, 4)]
    assert {layer.p for layer in network if isinstance(layer, Dropout)} <= {0.5}


def test_batch_is_normalised_over_all_its_dimensions() -> None:
    x = torch.randn(4, 5, 3) * 7.0 + 2.0
    normalised = BatchNorm(3)(x)
    assert normalised.shape == x.shape
    assert normalised.mean((0, 1)).tolist() == pytest.approx([0.0] * 3, abs=1e-5)
    assert normalised.std((0, 1), correction=0).tolist() == pytest.approx([1.0] * 3, abs=1e-3)


def test_output_of_zero_has_a_scale_of_one_and_none_is_below_the_least() -> None:
    out = torch.tensor([[0.5, -0.25, 0.0, -50.0]])
    location, scale = location_and_scale(out, 0.1)
    assert location.tolist() == [[0.5, -0.25]]
    assert scale.flatten().tolist() == pytest.approx([1.0, 0.1])
    _, free = location_and_scale(out, 0.001)
    assert float(free[0, 1]) == pytest.approx(0.01, abs=1e-5), "as TorchRL's"


def test_batch_of_two_has_statistics() -> None:
    learner = make("td3", critic_norm="batch", batch_size=2)
    assert any(isinstance(module, BatchNorm) for module in learner.loss.critics.modules())
    with pytest.raises(DescriptionError) as raised:
        make("td3", critic_norm="batch", batch_size=1)
    assert str(raised.value) == (
        "a batch of 1 has no statistics; give a batch_size of 2 or more, or another norm"
    )
