"""Nominal bounds survive TorchRL's operations on specs."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import pytest
import torch
from torchrl.data import Bounded, Composite

from brickhub.entry import Entry
from bricksrl.envs.specs import NominalBounded


@pytest.fixture
def spec() -> NominalBounded:
    return NominalBounded.of(
        (Entry("held", 0.0, 10.0), Entry("free", -1.0, 1.0, limits=(-torch.inf, torch.inf)))
    )


def test_nominal_entries_accept_finite_numbers(spec: NominalBounded) -> None:
    assert spec.is_in(torch.tensor([5.0, 0.5]))
    assert spec.is_in(torch.tensor([5.0, -300.0]))
    assert spec.is_in(torch.tensor([[5.0, -300.0], [0.0, 300.0]]))
    assert not spec.is_in(torch.tensor([11.0, 0.5]))
    assert not spec.is_in(torch.tensor([5.0, torch.inf]))
    assert not spec.is_in(torch.tensor([5.0, torch.nan]))
    assert not spec.is_in(torch.tensor([5.0, 0.5], dtype=torch.float64))
    assert not spec.is_in(torch.tensor([5.0, 0.5, 0.5]))
    assert not spec.is_in(torch.tensor(5.0))


def test_bounds_are_used_for_sampling(spec: NominalBounded) -> None:
    assert spec.low.tolist() == [0, -1]
    assert spec.high.tolist() == [10, 1]
    drawn = spec.rand((1000,))
    assert (drawn >= spec.low).all() and (drawn <= spec.high).all()


def test_nominal_entries_are_not_projected(spec: NominalBounded) -> None:
    assert spec.project(torch.tensor([11.0, 300.0])).tolist() == [10.0, 300.0]


@pytest.mark.parametrize(
    ("operation", "inside", "outside"),
    [
        (lambda s: s.clone(), [5.0, 300.0], [11.0, 0.0]),
        (copy.deepcopy, [5.0, 300.0], [11.0, 0.0]),
        (lambda s: pickle.loads(pickle.dumps(s)), [5.0, 300.0], [11.0, 0.0]),  # noqa: S301
        (lambda s: s.to("cpu"), [5.0, 300.0], [11.0, 0.0]),
        (lambda s: s.expand(3, 2), [[5.0, 300.0]] * 3, [[11.0, 0.0]] * 3),
        (lambda s: s.expand((3, 2))[1], [5.0, 300.0], [11.0, 0.0]),
        (lambda s: s.expand(3, 2)[:2], [[5.0, 300.0]] * 2, [[11.0, 0.0]] * 2),
        (lambda s: s.unsqueeze(0), [[5.0, 300.0]], [[11.0, 0.0]]),
        (lambda s: s.unsqueeze(0).squeeze(0), [5.0, 300.0], [11.0, 0.0]),
        (lambda s: s.unsqueeze(0).squeeze(), [5.0, 300.0], [11.0, 0.0]),
        (lambda s: s.expand(3, 2).unbind(0)[2], [5.0, 300.0], [11.0, 0.0]),
        (
            lambda s: s.expand(6, 2).reshape(2, 3, 2),
            [[[5.0, 300.0]] * 3] * 2,
            [[[11.0, 0.0]] * 3] * 2,
        ),
        (
            lambda s: s.expand(6, 2).unflatten(0, (2, 3)),
            [[[5.0, 300.0]] * 3] * 2,
            [[[11.0, 0.0]] * 3] * 2,
        ),
        (lambda s: s.expand(2, 3, 2).flatten(0, 1), [[5.0, 300.0]] * 6, [[11.0, 0.0]] * 6),
        (lambda s: torch.stack([s, s.clone()]), [[5.0, 300.0]] * 2, [[11.0, 0.0]] * 2),
        (lambda s: Composite(a=s).expand(3)["a"], [[5.0, 300.0]] * 3, [[11.0, 0.0]] * 3),
        (lambda s: Composite(a=s).clone()["a"], [5.0, 300.0], [11.0, 0.0]),
    ],
)
def test_operations_keep_spec_class(
    spec: NominalBounded,
    operation: Callable[[NominalBounded], NominalBounded],
    inside: list[float],
    outside: list[float],
) -> None:
    result = operation(spec)
    assert type(result) is NominalBounded
    assert result.nominal.shape == result.shape
    assert result.is_in(torch.tensor(inside))
    assert not result.is_in(torch.tensor(outside))


def test_other_precision(spec: NominalBounded) -> None:
    double = spec.to(torch.float64)
    assert type(double) is NominalBounded
    assert double.is_in(torch.tensor([5.0, 300.0], dtype=torch.float64))
    assert type(spec) is NominalBounded and spec.dtype == torch.float32


def test_equality_compares_nominal_entries(spec: NominalBounded) -> None:
    assert spec == spec.clone()
    assert spec != NominalBounded.of((Entry("held", 0.0, 10.0), Entry("free", -1.0, 1.0)))
    assert spec != Bounded(spec.low, spec.high)
