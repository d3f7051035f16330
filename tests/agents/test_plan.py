from __future__ import annotations

import math
from itertools import count

import pytest
import torch

from bricksrl.agents.plan import Plan

CHUNK = 4


def acted(executed: int, ensemble: float | None, steps: int, *batch: int) -> list[torch.Tensor]:
    """The actions of a plan whose chunk of call ``c`` has the actions (c, 0), (c, 1), ..."""
    calls = count()

    def predict() -> torch.Tensor:
        call = torch.full((CHUNK,), float(next(calls)))
        return torch.stack((call, torch.arange(float(CHUNK))), -1).expand(*batch, CHUNK, 2)

    plan = Plan(executed, ensemble)
    return [plan.next(predict) for _ in range(steps)]


@pytest.mark.parametrize("executed", [1, 2, 4])
def test_a_chunk_is_carried_out_until_the_next_one_is_due(executed: int) -> None:
    found = torch.stack(acted(executed, None, 8)).tolist()
    assert found == [[step // executed, step % executed] for step in range(8)]


def test_chunks_that_overlap_are_averaged_the_oldest_with_the_most_weight() -> None:
    found = acted(1, 0.5, 7)[6]
    weights = [math.exp(-0.5 * i) for i in range(CHUNK)]  # of the calls 3, 4, 5 and 6, which are 3, 2, 1 and 0 steps old
    for place, values in enumerate(((3, 4, 5, 6), (3, 2, 1, 0))):
        wanted = sum(w * value for w, value in zip(weights, values, strict=True)) / sum(weights)
        assert float(found[place]) == pytest.approx(wanted)


def test_rarer_chunks_overlap_less() -> None:
    calls = torch.stack(acted(2, 0.0, 6))[:, 0].tolist()
    assert calls == [0, 0, 0.5, 0.5, 1.5, 1.5]


def test_a_plan_that_is_forgotten_starts_anew() -> None:
    plan = Plan(3, 0.0)
    first, second = torch.zeros(CHUNK, 1), torch.ones(CHUNK, 1)
    plan.next(lambda: first)
    plan.forget()
    assert plan.next(lambda: second) == 1.0
    assert plan.next(lambda: first) == 1.0  # the new chunk goes on; none is due


@pytest.mark.parametrize("ensemble", [None, 0.1])
def test_many_robots_act_as_one(ensemble: float | None) -> None:
    one, many = acted(2, ensemble, 6), acted(2, ensemble, 6, 3, 2)
    assert many[0].shape == (3, 2, 2)
    for single, batch in zip(one, many, strict=True):
        torch.testing.assert_close(batch, single.expand(3, 2, 2))
