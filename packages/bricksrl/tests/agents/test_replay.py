"""Replay buffers: successors, n-step sums, chunks, images, states."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tensordict import TensorDict

from bricksrl.agents.offline.imitation import recorded_memory
from bricksrl.agents.replay.augmentation import ShiftImages
from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.replay.memory_state import load_memory_state, memory_state
from bricksrl.envs.specs import ImageShape
from bricksrl.errors import DescriptionError

GAMMA = 0.9


def numbered(
    first: int,
    count: int,
    *,
    done: tuple[int, ...] = (),
    fell: tuple[int, ...] = (),
    lost: tuple[int, ...] = (),
) -> Any:
    """Transitions ``[count]`` numbered in observation, action and reward."""
    number = torch.arange(first, first + count)

    def among(which: tuple[int, ...]) -> torch.Tensor:
        return torch.isin(number, torch.tensor(which, dtype=torch.int64))[:, None]

    value = number[:, None].float()
    after = {
        "observation": value + 0.5,
        "reward": value,
        "terminated": among(fell),
        "done": among((*done, *fell, *lost)),
    }
    after["link_lost"] = among(lost)
    return TensorDict(
        {"observation": value, "action": value.repeat(1, 2), "next": TensorDict(after, [count])},
        [count],
    )


def memory(capacity: int = 100, batch_size: int = 50, **kind: Any) -> TransitionReplayBuffer:
    return TransitionReplayBuffer(
        capacity, batch_size, ("observation",), **{"n_step": 2, "gamma": GAMMA, **kind}
    )


def followers(buffer: TransitionReplayBuffer) -> dict[int, int | None]:
    """The number of each transition's successor."""
    numbers = [int(one) for one in buffer[:]["observation"].flatten()]
    places = [int(place) for place in buffer._successor[: len(numbers)]]
    return {
        number: None if place == buffer._none else numbers[place]
        for number, place in zip(numbers, places, strict=True)
    }


def test_successors_span_calls() -> None:
    buffer = memory()
    for first in range(0, 8, 2):
        buffer.extend(numbered(first, 2, done=(3,)))
    assert followers(buffer) == {0: 1, 1: 2, 2: 3, 3: None, 4: 5, 5: 6, 6: 7, 7: None}


def test_successors_stay_within_copies() -> None:
    buffer = memory()
    for first in (0, 2):
        buffer.extend(
            torch.stack(
                [
                    numbered(first, 2, done=(2,)),
                    numbered(10 + first, 2),
                    numbered(20 + first, 2, done=(21,)),
                ]
            )
        )
    assert followers(buffer) == {
        0: 1,
        1: 2,
        2: None,
        3: None,
        10: 11,
        11: 12,
        12: 13,
        13: None,
        20: 21,
        21: None,
        22: 23,
        23: None,
    }


def test_lost_link_step_is_dropped_and_unlinks() -> None:
    buffer = memory()
    buffer.extend(torch.stack([numbered(0, 4, lost=(1,)), numbered(10, 4, lost=(13,))]))
    buffer.extend(torch.stack([numbered(4, 2), numbered(14, 2, lost=(15,))]))
    buffer.extend(torch.stack([numbered(6, 1), numbered(16, 1)]))
    assert followers(buffer) == {
        0: None,
        2: 3,
        3: 4,
        4: 5,
        5: 6,
        6: None,
        10: 11,
        11: 12,
        12: None,
        14: None,
        16: None,
    }


def test_all_lost_frames_only_unlink() -> None:
    buffer = memory()
    buffer.extend(numbered(0, 2))
    assert len(buffer.extend(numbered(2, 1, lost=(2,)))) == 0
    buffer.extend(numbered(3, 1))
    assert followers(buffer) == {0: 1, 1: None, 3: None}


def test_end_episodes_unlinks() -> None:
    buffer = memory()
    buffer.extend(numbered(0, 2))
    buffer.end_episodes()
    buffer.extend(numbered(2, 2))
    assert followers(buffer) == {0: 1, 1: None, 2: 3, 3: None}


@pytest.mark.parametrize("parts", [(3, 5), (5, 3, 5), (4, 4, 4), (1,) * 13, (2, 5, 5, 5)])
def test_full_buffer_overwrites_oldest_newest_has_no_successor(parts: tuple[int, ...]) -> None:
    buffer, made = memory(capacity=5), 0
    for count in parts:
        buffer.extend(numbered(made, count))
        made += count
    assert followers(buffer) == {
        **{number: number + 1 for number in range(made - 5, made - 1)},
        made - 1: None,
    }


def test_copies_overwrite_oldest() -> None:
    """With less than two steps of each copy, the last transitions are overwritten immediately."""
    buffer = memory(capacity=5)
    for step in range(6):
        buffer.extend(torch.stack([numbered(100 * copy + step, 1) for copy in range(3)]))
    assert followers(buffer) == {104: 105, 204: 205, 5: None, 105: None, 205: None}


def test_too_many_frames_raise() -> None:
    with pytest.raises(
        DescriptionError,
        match="6 transitions at once do not fit into a replay buffer of 5; give buffer_size "
        "6 or more",
    ):
        memory(capacity=5).extend(numbered(0, 6))


@dataclass
class Reference:
    """A list of transitions with predecessors."""

    capacity: int
    kept: list[int] = field(default_factory=list)
    next_of: dict[int, int] = field(default_factory=dict)
    last: dict[int, int | None] = field(default_factory=dict)

    def add(self, copy: int, number: int, *, done: bool, lost: bool) -> None:
        if lost:
            self.last[copy] = None
            return
        before = self.last.get(copy)
        if before is not None:
            self.next_of[before] = number
        self.kept.append(number)
        self.last[copy] = None if done else number

    def followers(self) -> dict[int, int | None]:
        kept = self.kept[-self.capacity :]
        return {number: self.next_of.get(number) for number in kept}


CALLS = st.lists(
    st.tuples(
        st.integers(1, 4),
        st.sets(st.integers(0, 11), max_size=3),
        st.sets(st.integers(0, 11), max_size=2),
        st.booleans(),
    ),
    min_size=1,
    max_size=8,
)


@settings(max_examples=50)
@given(capacity=st.integers(12, 30), copies=st.integers(1, 3), calls=CALLS)
def test_successors_equal_list_reference(
    capacity: int, copies: int, calls: list[tuple[int, set[int], set[int], bool]]
) -> None:
    buffer, reference, made = (
        memory(capacity=capacity),
        Reference(capacity),
        [1000 * copy for copy in range(copies)],
    )
    for count, done, lost, end in calls:
        parts = []
        for copy in range(copies):
            ends = tuple(made[copy] + one - 4 * copy for one in done)
            gaps = tuple(made[copy] + one - 4 * copy for one in lost)
            parts.append(numbered(made[copy], count, done=ends, lost=gaps))
            for number in range(made[copy], made[copy] + count):
                reference.add(copy, number, done=number in ends, lost=number in gaps)
            made[copy] += count
        buffer.extend(torch.stack(parts))
        if all(part["next", "link_lost"].all() for part in parts):
            reference.last.clear()
        if end:
            buffer.end_episodes()
            reference.last.clear()
    assert len(buffer) == min(capacity, len(reference.kept))
    if len(buffer):
        assert followers(buffer) == reference.followers()


def summed(
    number: int, n: int, followed: dict[int, int | None], fell: set[int]
) -> tuple[float, int, int]:
    """Reward sum, last number and step count from a number on."""
    reward, steps, at = float(number), 1, number
    while steps < n and at not in fell and followed[at] is not None:
        at = followed[at]  # type: ignore[assignment]
        reward += GAMMA**steps * at
        steps += 1
    return reward, at, steps


@settings(max_examples=40)
@given(
    n=st.integers(2, 6),
    done=st.sets(st.integers(0, 39), max_size=6),
    fell=st.sets(st.integers(0, 39), max_size=6),
    lost=st.sets(st.integers(0, 39), max_size=4),
    capacity=st.integers(20, 50),
)
def test_n_step_sums_equal_python_reference(
    n: int, done: set[int], fell: set[int], lost: set[int], capacity: int
) -> None:
    buffer = memory(capacity=capacity, n_step=n, batch_size=64)
    fell = fell - lost
    for first in range(0, 40, 10):
        buffer.extend(numbered(first, 10, done=tuple(done), fell=tuple(fell), lost=tuple(lost)))
    followed, batch = followers(buffer), buffer.sample()
    for row in batch:
        reward, last, steps = summed(int(row["observation"]), n, followed, fell)
        assert float(row["next", "reward"]) == pytest.approx(reward, rel=1e-5)
        assert float(row["next", "observation"]) == last + 0.5
        assert int(row["steps_to_next_obs"]) == int(row["next", "steps_to_next_obs"]) == steps
        assert bool(row["next", "terminated"]) == (last in fell)
        assert float(row["action"][0]) == float(row["observation"])


def test_one_step_has_no_step_count() -> None:
    buffer = memory(n_step=1)
    buffer.extend(numbered(0, 10))
    assert "steps_to_next_obs" not in buffer.sample().keys()  # noqa: SIM118  a TensorDict
    assert buffer.sample().batch_size == (50,)
    assert buffer.sample(7).batch_size == (7,)


def test_sampling_is_uniform() -> None:
    buffer = memory(capacity=5, n_step=1)
    for first in (0, 4):
        buffer.extend(numbered(first, 4))
    counts = torch.bincount(buffer.sample(5000)["observation"].flatten().long(), minlength=8)
    assert counts[:3].tolist() == [0, 0, 0]
    assert counts[3:].float().std() < 100.0


def test_recorded_chunks_repeat_last_action() -> None:
    frames = numbered(0, 12, done=(4,))
    expected = {
        0: [0, 1, 2, 3],
        2: [2, 3, 4, 4],
        4: [4, 4, 4, 4],
        5: [5, 6, 7, 8],
        9: [9, 10, 11, 11],
        11: [11, 11, 11, 11],
    }
    batch = recorded_memory(frames, 32, ("observation",), chunk=4).sample(300)
    assert batch["action"].shape == (300, 4, 2)
    found = {int(row["observation"]): row["action"][:, 0].int().tolist() for row in batch}
    assert {number: found[number] for number in expected} == expected
    assert frames["action"].shape == (12, 2)  # they stay as they were


def test_images_are_shifted_independently() -> None:
    images = torch.arange(16 * 16 * 3, dtype=torch.uint8).view(1, 16, 16, 3).repeat(8, 1, 1, 1)
    frames = numbered(0, 8)
    frames["image"], frames["next", "image"] = images, images.clone()
    shape = ImageShape("image", 16, 3, is_channels_last=True)
    plain, shifted = (TransitionReplayBuffer(8, 32, ("observation", "image")) for _ in range(2))
    shifted.append_transform(ShiftImages([shape], 2))
    for buffer in (plain, shifted):
        buffer.extend(frames)
    assert (plain.sample()["image"] == images[0]).all()
    batch = shifted.sample()
    assert batch["image"].dtype is torch.uint8
    ways = {bytes(image.flatten().tolist()) for image in batch["image"]}
    assert len(ways) > 10
    assert not torch.equal(batch["image"], batch["next", "image"])
    assert (batch["image"][:, 4:-4, 4:-4] != images[0, 4:-4, 4:-4]).any()


@pytest.mark.parametrize("memory_mapped", [False, True])
@pytest.mark.parametrize("made", [0, 3, 12])
def test_buffer_state_continues(made: int, memory_mapped: bool) -> None:
    one = memory(capacity=8, memory_mapped=memory_mapped)
    for first in range(made):
        one.extend(numbered(first, 1, done=(2, 7)))
    file = io.BytesIO()
    torch.save(memory_state(one), file)
    file.seek(0)
    state = torch.load(file, weights_only=True)
    assert sum(len(rows) for rows in state["rows"].values()) == min(made, 8) * len(state["rows"])
    other = memory(capacity=8)
    load_memory_state(other, state)
    for first in range(made, made + 6):
        for buffer in (one, other):
            buffer.extend(numbered(first, 1, done=(2, 7)))
    assert followers(one) == followers(other)
    batches = []
    for buffer in (one, other):
        torch.manual_seed(1)
        batches.append(buffer.sample())
    assert (batches[0] == batches[1]).all()


@pytest.mark.parametrize(("n_step", "in_file"), [(1, True), (3, True), (1, False)])
# a graphics card has no room for a million images
def test_only_samples_are_on_the_device(n_step: int, in_file: bool) -> None:
    buffer = memory(n_step=n_step, memory_mapped=in_file, device="meta")
    for first in (0, 4):
        buffer.extend(numbered(first, 4, done=(3,)))
    assert buffer[:]["next", "reward"].device.type == "cpu"
    assert buffer.sample()["next", "reward"].device.type == "meta"


@pytest.mark.parametrize("made", [0, 3, 12])
def test_buffer_state_replaces_content(made: int) -> None:
    one, other = memory(capacity=16), memory(capacity=16)
    for first in range(made):
        one.extend(numbered(first, 1, done=(2, 7)))
    other.extend(numbered(40, 9))
    load_memory_state(other, memory_state(one))
    for buffer in (one, other):
        buffer.extend(numbered(made, 2))
    assert len(other) == len(one)
    assert followers(one) == followers(other)
    assert torch.equal(one[:]["observation"], other[:]["observation"])


def test_buffer_state_that_does_not_fit_raises() -> None:
    full = memory(capacity=8)
    full.extend(numbered(0, 8))
    with pytest.raises(ValueError, match="8 transitions do not fit into a buffer of 4"):
        load_memory_state(memory(capacity=4), memory_state(full))


def test_buffer_state_is_a_copy() -> None:
    buffer = memory(capacity=4)
    buffer.extend(numbered(0, 4))
    state = memory_state(buffer)
    buffer.extend(numbered(4, 4))
    assert state["rows"]["observation"].flatten().tolist() == [0.0, 1.0, 2.0, 3.0]
    assert state["successor"].tolist() == [1, 2, 3, 4]
    assert state["last"].tolist() == [3]


def test_successors_are_kept_only_where_they_are_needed() -> None:
    """One-step returns need none, and a buffer may have millions of rows."""
    plain, of_three = memory(n_step=1), memory(n_step=3)
    for buffer in (plain, of_three):
        buffer.extend(numbered(0, 10))
    assert "successor" not in memory_state(plain) and "last" not in memory_state(plain)
    assert len(memory_state(of_three)["successor"]) == 10
