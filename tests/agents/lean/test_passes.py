"""Gradients by hand against those of autograd, over shapes and options."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from bricksrl.agents.lean.flat import Flat, Learned
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import StackedMLP

SHAPES: dict[str, Any] = {
    "hidden": st.lists(st.integers(1, 9), min_size=1, max_size=3).map(tuple),
    "in_size": st.integers(1, 7),
    "out_size": st.integers(1, 5),
    "k": st.integers(1, 4),
    "rows": st.integers(2, 11),
    "seed": st.integers(0, 1000),
}
NORMS = st.sampled_from(({}, {"layer_norm": True}, {"batch_norm": 0.3}, {"layer_norm": True, "batch_norm": 0.1}))


def network(in_size: int, hidden: tuple[int, ...], out_size: int, k: int, **options: Any) -> StackedMLP:
    """One whose normalisations have moved away from what they start as."""
    made = StackedMLP(in_size, hidden, out_size, k=k, **options)
    for tensor in [*made.parameters(), *made.buffers()]:
        tensor.data += 0.3 * torch.rand_like(tensor)
    return made


def by_autograd(made: StackedMLP, x: Tensor, slope: Tensor, seed: int) -> tuple[Tensor, list[Tensor], Tensor]:
    """Outputs and gradients as `torch.autograd` has them."""
    torch.manual_seed(seed)
    x = x.expand(len(slope), *x.shape).clone().requires_grad_()
    out = made(x)
    *gradients, of_x = torch.autograd.grad(out, [*made.parameters(), x], slope)
    return out.detach(), gradients, of_x


@settings(max_examples=60)
@given(**SHAPES, dropout=st.sampled_from((0.0, 0.1, 0.5)), norms=NORMS, training=st.booleans())
def test_forward_and_backward_equal_autograds(
    hidden: tuple[int, ...],
    in_size: int,
    out_size: int,
    k: int,
    rows: int,
    seed: int,
    dropout: float,
    norms: dict[str, Any],
    training: bool,
) -> None:
    torch.manual_seed(seed)
    made = network(in_size, hidden, out_size, k, dropout=dropout, **norms).double().train(training)
    other = copy.deepcopy(made)
    x, slope = torch.randn(rows, in_size, dtype=torch.float64), torch.randn(k, rows, out_size, dtype=torch.float64)
    expected, gradients, of_x = by_autograd(other, x, slope, seed)
    with torch.no_grad():
        learned = Learned(made, learning_rate=1.0)
        way = Pass(made, rows, learned, training=training)
        torch.manual_seed(seed)
        torch.testing.assert_close(way.forward(x), expected, rtol=1e-6, atol=1e-8)
        back = way.backward(slope.clone(), inputs=True)
    torch.testing.assert_close(back, of_x, rtol=1e-6, atol=1e-8)
    ours = [learned.gradient(parameter) for parameter in made.parameters()]
    torch.testing.assert_close(ours, gradients, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(dict(made.named_buffers()), dict(other.named_buffers()))


@settings(max_examples=40)
@given(**SHAPES, dropout=st.sampled_from((0.0, 0.3)), norms=NORMS)
def test_back_through_one_network_for_each_sample_is_back_through_all_with_slopes_for_that_one(
    hidden: tuple[int, ...],
    in_size: int,
    out_size: int,
    k: int,
    rows: int,
    seed: int,
    dropout: float,
    norms: dict[str, Any],
) -> None:
    torch.manual_seed(seed)
    made = network(in_size, hidden, out_size, k, dropout=dropout, **norms).double().eval()
    nets, slope = torch.randint(k, (rows,)), torch.randn(rows, out_size, dtype=torch.float64)
    of_each = torch.zeros(k, rows, out_size, dtype=torch.float64)
    of_each[nets, torch.arange(rows)] = slope
    with torch.no_grad():
        way = Pass(made, rows, Learned(made, learning_rate=1.0), training=False)
        way.forward(torch.randn(rows, in_size, dtype=torch.float64))
        expected = way.backward(of_each, weights=False, inputs=True).sum(0)
        torch.testing.assert_close(way.backward_through(nets, slope), expected, rtol=1e-6, atol=1e-8)


def test_samples_of_a_batch_that_is_normalised_have_no_way_back_of_their_own() -> None:
    with torch.no_grad():
        made = network(4, (8,), 1, 2, batch_norm=0.1)
        way = Pass(made, 5, Learned(made, learning_rate=1.0))
        way.forward(torch.randn(5, 4))
        with pytest.raises(RuntimeError, match="of its own"):
            way.backward_through(torch.zeros(5, dtype=torch.int64), torch.ones(5, 1))


@pytest.mark.parametrize("norms", [{}, {"layer_norm": True}, {"batch_norm": 0.2}])
def test_a_second_pass_over_the_same_memory_is_as_good_as_the_first(norms: dict[str, Any]) -> None:
    made = network(4, (8, 6), 2, 3, **norms).eval()
    with torch.no_grad():
        learned = Learned(made, learning_rate=1.0)
        way = Pass(made, 5, learned, training=False)
        for _ in range(2):
            way.forward(torch.randn(5, 4))
            way.backward(torch.randn(3, 5, 2), inputs=True)
    x, slope = torch.randn(5, 4), torch.randn(3, 5, 2)
    expected, gradients, of_x = by_autograd(made, x, slope, 0)
    with torch.no_grad():
        torch.testing.assert_close(way.forward(x), expected)
        torch.testing.assert_close(way.backward(slope, inputs=True), of_x)
    torch.testing.assert_close([learned.gradient(parameter) for parameter in made.parameters()], gradients)


def test_some_of_the_networks_alone() -> None:
    made = network(4, (8, 6), 2, 3, layer_norm=True)
    x = torch.randn(5, 4)
    with torch.no_grad():
        learned = Learned(made, learning_rate=1.0)
        together = Pass(made, 5, learned).forward(x).clone()
        alone = Pass(made, 5, learned, nets=slice(1, 2))
        torch.testing.assert_close(alone.forward(x), together[1:2])
        alone.backward(torch.randn(1, 5, 2))
    for parameter in made.parameters():
        of_each = learned.gradient(parameter).flatten(1).abs().sum(1)
        assert of_each[1] > 0
        assert of_each[0] == of_each[2] == 0


def test_without_weights_only_the_inputs_get_a_gradient() -> None:
    made = network(4, (8,), 1, 2, layer_norm=True)
    x, slope = torch.randn(5, 4), torch.randn(2, 5, 1)
    _, _, of_x = by_autograd(made, x, slope, 0)
    with torch.no_grad():
        learned = Learned(made, learning_rate=1.0)
        way = Pass(made, 5, learned)
        way.forward(x)
        torch.testing.assert_close(way.backward(slope, weights=False, inputs=True), of_x)
    assert all((learned.gradient(parameter) == 0).all() for parameter in made.parameters())


@pytest.mark.parametrize("norms", [{"layer_norm": True}, {"batch_norm": 0.2}])
def test_bfloat16_is_near_float32(norms: dict[str, Any]) -> None:
    made = network(6, (32, 32), 1, 2, **norms)
    x, slope = torch.randn(64, 6), torch.randn(2, 64, 1)
    expected, gradients, of_x = by_autograd(made, x, slope, 0)
    with torch.no_grad():
        learned = Learned(made, learning_rate=1.0, dtype=torch.bfloat16)
        way = Pass(made, 64, learned)
        out = way.forward(x)
        back = way.backward(slope, inputs=True)
        assert out.dtype is back.dtype is torch.float32
        assert not torch.equal(out, Pass(made, 64).forward(x))
        ours = [learned.gradient(parameter) for parameter in made.parameters()]
        for mine, theirs in [(out, expected), (back, of_x), *zip(ours, gradients, strict=True)]:
            assert (mine.float() - theirs).norm() < 0.2 * theirs.norm()


def test_targets_have_no_gradients() -> None:
    made = network(4, (8,), 1, 2)
    with torch.no_grad():
        way = Pass(made, 5, Flat(made))
        way.forward(torch.randn(5, 4))
        assert way.backward(torch.ones(2, 5, 1), inputs=True).shape == (2, 5, 4)
