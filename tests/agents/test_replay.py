from __future__ import annotations

import pytest
import torch

from bricksrl.agents.replay import ReplayRing


def ring(capacity: int, lengths: tuple[int, ...]) -> ReplayRing:
    """Episodes of these lengths; a row is its episode and its step."""
    made = ReplayRing(capacity, 2)
    for episode, length in enumerate(lengths):
        for step in range(length):
            made.add((torch.tensor([float(episode)]), torch.tensor([float(step)])), last=step == length - 1)
    return made


@pytest.mark.parametrize(
    ("capacity", "lengths"), [(20, (5, 4, 6)), (15, (5, 4, 6)), (7, (5, 4, 6)), (8, (8,)), (8, (11,)), (6, (6, 1))]
)
def test_what_comes_after_a_step_is_of_its_episode(capacity: int, lengths: tuple[int, ...]) -> None:
    made = ring(capacity, lengths)
    ends = torch.tensor([float(length) for length in lengths])
    places, steps = torch.arange(len(made))[:, None], torch.arange(9)
    there, known = made.after(places, steps)
    before, after = made.rows(places.expand(-1, 9)), made.rows(there.where(known, 0))
    assert torch.equal(known, before[..., 1] + steps < ends[before[..., 0].long()])
    assert torch.equal((after - before)[known], torch.stack((torch.zeros(9), steps), -1).expand_as(before)[known])


def test_later_is_drawn_from_what_comes_after() -> None:
    """A ring that holds but one episode does not go on from its end to its start."""
    made = ring(8, (8,))
    torch.manual_seed(0)
    places = torch.arange(8).repeat(50)
    ahead = made.later(places, 3) - places
    assert set(ahead.tolist()) == {0, 1, 2, 3}
    assert set(ahead[places == 7].tolist()) == {0}
