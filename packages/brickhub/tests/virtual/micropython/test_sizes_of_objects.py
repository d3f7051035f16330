"""Sizes of objects on the heap: those of MicroPython on 32 bits, in blocks of 16 bytes."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.robot import HubKind, Robot
from brickhub.virtual.micropython.memory import (
    MEMORY_BYTES,
    Heap,
    check_allocation,
    items_of,
    most_nested_calls,
)

HEAD = """
import gc
before = after = kept = 0
class Point:
    pass
def generate(a):
    b = a
    yield b
def plain():
    return 5
def with_default(a=(1, 2)):
    return a
def closure(a):
    return lambda: a
point = Point()
point.x = point.y = 1
"""


def size_of(expression: str) -> int:
    """Bytes by which the used memory grows if a variable keeps this."""
    source = f"before = gc.mem_alloc()\nkept = {expression}\nafter = gc.mem_alloc()\n"
    return int(output(f"{HEAD}{source}print(after - before)"))


@pytest.mark.parametrize(
    ("expression", "size"),
    [
        ("None", 0),
        ("True", 0),
        ("12345", 0),
        ("0.5", 16),
        ("b''", 16),
        ("bytes(1)", 32),
        ("bytes(16)", 32),
        ("bytes(17)", 48),
        ("bytearray(15)", 32),
        ("bytearray(16)", 32),
        ("bytearray(33)", 64),
        ("'x' * 15", 32),
        ("'x' * 16", 48),
        ("'x' * 31", 48),
        ("'x' * 32", 64),
        ("'\\u00e9' * 7", 32),
        ("'\\u00e9' * 8", 48),
        ("tuple(range(2))", 16),
        ("tuple(range(3))", 32),
        ("tuple(range(6))", 32),
        ("tuple(range(7))", 48),
        ("[]", 32),
        ("[1, 2, 3, 4]", 32),
        ("[1, 2, 3, 4, 5]", 48),
        ("[0] * 8", 48),
        ("[0] * 9", 64),
        ("{}", 16),
        ("{1: 2}", 32),
        ("{1: 2, 3: 4}", 32),
        ("{1: 2, 3: 4, 5: 6}", 48),
        ("{1, 2, 3, 4}", 32),
        ("{1, 2, 3, 4, 5}", 48),
        ("Point()", 16),
        ("[0.5, 0.25]", 64),
        ("(0.5,)", 32),
        ("{1: 0.5}", 48),
        ("{0.5}", 48),
        ("{0.5: 1}", 48),
        ("lambda: 5", 16),
        ("closure(5)", 48),
        ("lambda a=0.5: a", 32),
        ("[point, point]", 32),
    ],
)
def test_what_an_object_takes(expression: str, size: int) -> None:
    """By hand: an object of one block, and what it keeps elsewhere in whole blocks; a text has a
    zero byte at its end, a tuple two words before its items; integers stand in references."""
    assert size_of(expression) == size


@pytest.mark.parametrize("count", [5, 9, 17, 33, 64, 65])
def test_a_list_that_grows_doubles_its_slots(count: int) -> None:
    slots = 4
    while slots < count:
        slots *= 2
    source = f"""
items = []
before = gc.mem_alloc()
for number in range({count}):
    items.append(number)
print(gc.mem_alloc() - before)
"""
    printed = int(output(f"{HEAD}number = 0\n{source}"))
    assert printed == 4 * slots - 16


def test_names_of_the_program_take_a_pair_of_references() -> None:
    source = """
first = gc.mem_alloc()
a1 = a2 = a3 = a4 = 0
second = gc.mem_alloc()
b1 = b2 = b3 = b4 = b5 = b6 = b7 = b8 = 0
third = gc.mem_alloc()
print(second - first, third - second)
"""
    grown = [int(word) for word in output(f"{HEAD}first = second = third = 0\n{source}").split()]
    assert grown == [32, 64]


def test_each_object_counts_once() -> None:
    source = """
shared = bytearray(100)
before = gc.mem_alloc()
kept = [shared, shared, shared]
print(gc.mem_alloc() - before)
"""
    assert output(f"{HEAD}shared = 0\n{source}") == "32"


def test_a_heap_is_the_hubs_memory_without_the_collectors_tables() -> None:
    # A heap sets the memory of what runs next.
    before = MEMORY_BYTES.get()
    try:
        for kind in HubKind:
            heap = Heap(kind.model)
            whole_bytes = kind.model.memory_bytes - kind.model.stored_bytes
            tables_bytes = whole_bytes * 12 / 524
            assert heap.size_bytes == pytest.approx(whole_bytes - tables_bytes, abs=1)
            used, free = heap.statistics()
            assert used + free == heap.size_bytes
    finally:
        MEMORY_BYTES.set(before)


def test_an_allocation_may_be_as_large_as_the_memory() -> None:
    largest = MEMORY_BYTES.get()
    check_allocation(largest)
    with pytest.raises(MemoryError, match=f"memory allocation failed, allocating {largest + 1} by"):
        check_allocation(largest + 1)


def test_items_that_are_collected_end_where_the_memory_does() -> None:
    most = MEMORY_BYTES.get() // 4
    assert len(items_of(range(most))) == most
    with pytest.raises(MemoryError, match=f"allocating {4 * (most + 1)} bytes"):
        items_of(range(most + 1))
    # Nor do those that have no end at all.
    with pytest.raises(MemoryError, match=f"allocating {4 * (most + 1)} bytes"):
        items_of(iter(int, 1))


@pytest.mark.parametrize("kind", list(HubKind))
def test_calls_take_the_stack_that_is_left(kind: HubKind) -> None:
    model = kind.model
    used = most_nested_calls(kind) * (model.call_bytes + 40)
    one_more = used + model.call_bytes + 40
    free = model.stack_bytes - 1024 - 250
    assert used <= free
    assert one_more > free or most_nested_calls(kind) == 600


def test_a_program_that_fills_the_heap_slowly_has_no_room_for_a_message() -> None:
    """A hub prints how much it wanted only where that was much."""
    source = """
kept = []
try:
    while True:
        kept.append({})
except MemoryError as error:
    kept = None
    print(repr(str(error))[:26])
"""
    small_hub = Robot("it", HubKind.TECHNIC)
    little = source.replace("{}", "0.5 * len(kept)")
    much = source.replace("{}", "bytearray(2000)")
    assert output(little, robot=small_hub) == "''"
    assert output(much, robot=small_hub) == "'memory allocation failed,"


def test_statistics_of_the_garbage_collector() -> None:
    source = """
import gc, micropython
print(gc.isenabled(), gc.disable(), gc.isenabled(), gc.enable(), gc.isenabled(), gc.collect())
print(gc.threshold(), gc.threshold(100), gc.threshold(), gc.threshold(16), gc.threshold())
print(gc.threshold(15), gc.threshold(), gc.threshold(0), gc.threshold(), gc.threshold(-9), gc.threshold())
used, free = gc.mem_alloc(), gc.mem_free()
micropython.mem_info()
micropython.qstr_info()
print(used, free)
"""  # noqa: E501
    *switched, stack, total, blocks, names, numbers = output(source).splitlines()
    assert switched == [
        "True None False None True None",
        "-1 None 96 None 16",
        "None 0 None 0 None -1",
    ]
    used, free = map(int, numbers.split())
    assert stack == "stack: 0 out of 8192"
    words = total.replace(",", "").split()
    assert words[:2] == ["GC:", "total:"]
    shown_total, shown_used, shown_free = int(words[2]), int(words[4]), int(words[6])
    assert shown_total == shown_used + shown_free == used + free
    assert shown_free == pytest.approx(free, abs=64)
    assert blocks == (
        f" No. of 1-blocks: 0, 2-blocks: 0, max blk sz: 0, max free sz: {shown_free // 16}"
    )
    assert names == "qstr pool: n_pool=0, n_qstr=0, n_str_data_bytes=0, n_total_bytes=0"
