from __future__ import annotations

import io

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bricksrl.agents.image_replay import ImageReplay, Rows

SIDE = 4


def moment(number: int) -> tuple[torch.Tensor, torch.Tensor]:
    """An observation and an image that both say which one it is."""
    return torch.tensor([float(number)]), torch.full((SIDE, SIDE, 3), number % 256, dtype=torch.uint8)


def filled(replay: ImageReplay, lengths: list[int]) -> list[tuple[int, int]]:
    """Episodes of these lengths, numbered through; returns all steps, from the number before to the number after."""
    number, steps = 0, []
    for length in lengths:
        for place in range(length):
            before, after = moment(number), moment(number + 1)
            last = place == length - 1
            replay.add(before, torch.tensor([float(number)]), float(-number), after, terminated=last, last=last)
            steps.append((number, number + 1))
            number += 1
        number += 1
    return steps


def pairs(rows: Rows) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in zip(rows.observation, rows.next_observation, strict=True)}


@given(st.lists(st.integers(1, 9), min_size=1, max_size=12), st.integers(2, 25))
def test_a_step_is_drawn_as_it_was_until_it_is_overwritten(lengths: list[int], capacity: int) -> None:
    torch.manual_seed(0)
    replay = ImageReplay(capacity, SIDE, 1, 1)
    steps = filled(replay, lengths)
    moments = sum(length + 1 for length in lengths)
    kept = {step for step in steps if step[0] >= moments - capacity}
    assert len(replay) == len(kept)
    if not kept:
        return
    rows = replay.draw(400)
    assert pairs(rows) == kept
    for seen, images in ((rows.observation, rows.image), (rows.next_observation, rows.next_image)):
        assert (images == (seen % 256)[:, :, None, None]).all()
    assert torch.equal(rows.reward, -rows.observation[:, 0])
    assert torch.equal(rows.action, rows.observation)
    lasts = {after for before, after in steps if (after, after + 1) not in steps}
    assert [int(after) in lasts for after in rows.next_observation] == rows.terminated.tolist()


def test_7500_steps_of_the_arm_take_less_than_200_mb() -> None:
    replay = ImageReplay(7_750, 64, 3, 3)
    seen = torch.zeros(3), torch.zeros(64, 64, 3, dtype=torch.uint8)
    for step in range(1, 7_501):
        replay.add(seen, torch.zeros(3), -1.0, seen, terminated=False, last=step % 30 == 0)
    assert len(replay) == 7_500
    assert 90e6 < replay.bytes_used < 100e6


@pytest.mark.parametrize("capacity", [100, 9])
def test_it_goes_on_from_a_file_within_an_episode(capacity: int) -> None:
    one, other = ImageReplay(capacity, SIDE, 1, 1), ImageReplay(capacity, SIDE, 1, 1)
    filled(one, [3, 5])
    one.add(moment(50), torch.zeros(1), 0.0, moment(51), terminated=False, last=False)
    file = io.BytesIO()
    torch.save(one.state_dict(), file)
    file.seek(0)
    other.load_state_dict(torch.load(file, weights_only=True))
    drawn = []
    for replay in (one, other):
        replay.add(moment(51), torch.zeros(1), 0.0, moment(52), terminated=False, last=True)
        torch.manual_seed(1)
        drawn.append(replay.draw(200))
    assert all(torch.equal(a, b) for a, b in zip(*(vars(rows).values() for rows in drawn), strict=True))
    assert (51, 52) in pairs(drawn[0])


def test_a_broken_link_leaves_no_step_across_the_gap() -> None:
    replay = ImageReplay(50, SIDE, 1, 1)
    replay.add(moment(1), torch.zeros(1), 0.0, moment(2), terminated=False, last=False)
    replay.end_episode()
    replay.add(moment(7), torch.zeros(1), 0.0, moment(8), terminated=False, last=False)
    assert pairs(replay.draw(100)) == {(1, 2), (7, 8)}
