"""How often the heap is looked at: rarely for a program that does not grow, else soon."""

from __future__ import annotations

import pytest

from brickhub.robot import HubKind
from brickhub.virtual.micropython.memory import MEMORY_BYTES, Heap


class Grown(Heap):
    """A heap of which a test says how full it is."""

    used = 0

    def statistics(self) -> tuple[int, int]:
        return self.used, self.size_bytes - self.used


@pytest.fixture
def heap():
    before = MEMORY_BYTES.get()
    yield Grown(HubKind.PRIME.model)
    MEMORY_BYTES.set(before)


def test_a_program_that_does_not_grow_is_looked_at_less_and_less(heap: Grown) -> None:
    heap.used = 1000
    # The first look sees all that the program has as its growth.
    heap.check()
    waits = [heap.check() for _ in range(14)]
    assert waits[-1] == 1024
    for before, after in zip(waits, waits[1:], strict=False):
        assert after == min(2 * before, 1024)
    heap.used = 500
    assert heap.check() == 1024, "nor is one that shrinks"


def test_a_program_that_grows_is_looked_at_when_it_has_taken_a_quarter_of_what_is_free(
    heap: Grown,
) -> None:
    heap.check()
    while heap.check() < 64:
        pass
    # In 64 branches it has taken an eighth of what is free now: a quarter takes twice as many.
    heap.used = heap.size_bytes // 9
    assert heap.check() == 128
    # In 128 branches it has taken a quarter of what is free now.
    heap.used += (heap.size_bytes - heap.used) // 5
    assert heap.check() == 128
    # In 128 branches it has taken as much as is free now.
    heap.used += (heap.size_bytes - heap.used) // 2
    assert heap.check() == 32
    heap.used += (heap.size_bytes - heap.used) * 39 // 40
    assert heap.check() == 1, "never less than a branch"


@pytest.mark.parametrize(
    ("branches", "taken", "says"),
    [(1, 255, ""), (1, 256, "256"), (4, 1023, ""), (4, 1024, "256")],
)
def test_a_full_heap_has_room_for_a_message_after_a_large_object(
    heap: Grown, branches: int, taken: int, says: str
) -> None:
    """That is 256 bytes and more in a branch."""
    heap.used = heap.size_bytes - taken + 1
    while heap.check() < branches:
        pass
    heap._interval = branches
    heap.used = heap.size_bytes + 1
    with pytest.raises(MemoryError) as caught:
        heap.check()
    expected = f"memory allocation failed, allocating {says} bytes" if says else ""
    assert str(caught.value) == expected


def test_a_heap_may_be_full_to_the_last_byte(heap: Grown) -> None:
    heap.used = heap.size_bytes
    assert heap.check() >= 1
    heap.used += 1
    with pytest.raises(MemoryError):
        heap.check()
