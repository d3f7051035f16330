"""Memory of a hub: what programs occupy, and that it runs out."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hub_programs import output

from brickhub.robot import HubKind, Robot

FILL = """
class Point:
    def __init__(self, x, y):
        self.x = x
        self.y = y

def fill(kept):
    try:
        while True:
            kept.append({item})
    except MemoryError:
        return len(kept)

print(fill([]))
"""


@pytest.mark.parametrize(
    ("item", "firmware"),
    [
        ("5", 65536),
        ("0.5 * len(kept)", 16384),
        ("(len(kept), 5)", 16384),
        ("[1, 2, 3]", 10414),
        ("[len(kept), [0.5]]", 5717),
        ("'abc' + str(len(kept))", 8192),
        ("{'a': 1, 'b': 2}", 10411),
        ("{len(kept)}", 10414),
        ("bytearray(100)", 2986),
        ("bytes(50)", 4574),
        ("Point(1, 2)", 10413),
        ("lambda: kept", 10410),
        ("[0] * 50", 1525),
        ("(len(kept) * 2.5, 'x' * (30 + len(kept) % 2))", 4574),
    ],
)
def test_memory_runs_out_as_in_the_firmware(
    item: str, firmware: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The firmware's code with 400 KiB of memory; a list that grows needs a piece twice as long as
    itself there."""
    monkeypatch.setattr(
        HubKind.PRIME, "model", replace(HubKind.PRIME.model, program_bytes=400 * 1024)
    )
    count = int(output(FILL.replace("{item}", item)))
    assert 0.97 * firmware <= count <= 1.4 * firmware


def test_program_goes_on_with_freed_memory() -> None:
    source = """
kept = []
for turn in range(3):
    try:
        while True:
            kept.append(bytearray(1000))
    except MemoryError as error:
        print(200 < len(kept) < 300, "memory allocation failed, allocating" in str(error))
        kept.clear()
"""
    assert output(source) == "\n".join(["True True"] * 3)


@pytest.mark.parametrize(
    ("kind", "fits", "fits_not"),
    [(HubKind.PRIME, 260, 275), (HubKind.TECHNIC, 30, 33), (HubKind.CITY, 18, 20)],
)
def test_each_hub_has_its_memory(kind: HubKind, fits: int, fits_not: int) -> None:
    source = (
        "from pybricks.tools import wait\nkept = [bytearray(1000) for _ in range({})]\n"
        "for _ in range(3):\n    wait(10)"
    )
    robot = Robot("it", kind)
    assert output(source.format(fits), robot=robot) == ""
    with pytest.raises(MemoryError, match="memory allocation failed"):
        output(source.format(fits_not), robot=robot)


LONG_OBJECTS = ["bytearray(300000)", "'x' * 300000", "[0] * 70000", "(0,) * 70000"]
LONG_TEXTS = [
    "','.join(['x' * 1000] * 300)",
    "'%300000d' % 5",
    "'%.300000d' % 5",
    "'{:300000}'.format(5)",
    "f'{5:>300000}'",
]
LONG_BYTES = [
    "bytes(300000)",
    "bytes(map(bool, range(300000)))",
    "bytearray(range(300000))",
    "bytearray().extend(range(300000))",
]
LONG_SETS = ["set(range(70000))", "{1}.union(range(70000))"]
LONG_DICTS = ["dict(zip(range(70000), range(70000)))", "dict.fromkeys(range(70000))"]
LONG_LISTS = [
    "list(range(70000))",
    "tuple(map(abs, range(70000)))",
    "sorted(range(70000))",
    "[i for i in range(70000)]",
]


LONG_OTHERS = [
    "[].extend(range(70000))",
    "','.join(map(str, range(70000)))",
    "__import__('ustruct').pack('300000s', b'')",
]


@pytest.mark.parametrize(
    "expression",
    [
        *LONG_OBJECTS,
        *LONG_TEXTS,
        *LONG_BYTES,
        *LONG_SETS,
        *LONG_DICTS,
        *LONG_LISTS,
        *LONG_OTHERS,
        "[]\na += range(70000)",
    ],
)
def test_no_hub_has_memory_for_long_objects(expression: str) -> None:
    with pytest.raises(MemoryError, match="memory allocation failed, allocating [23]"):
        output(f"a = {expression}")


def test_values_that_fit_are_made_as_before() -> None:
    source = """
a = [1]
b = a
a += range(2)
b += (5,)
print(a, ','.join(str(i) for i in range(3)), b'-'.join([b'1', b'2']), bytes(i for i in range(2)), bytes(2), bytes(b'5'))
print('%.9999999s' % 'text', '{:.999999}'.format('text'))
try:
    a += 5
except TypeError as error:
    print(error)
try:
    ','.join(5)
except TypeError as error:
    print(error)
"""  # noqa: E501
    lines = ["[1, 0, 1, 5] 0,1,2 b'1-2' b'\\x00\\x01' b'\\x00\\x00' b'5'", "text text"]
    assert output(source).splitlines() == [*lines, *["'int' object isn't iterable"] * 2]


def test_statistics_follow_local_variables_generators_and_attributes() -> None:
    source = """
import gc

class Box:
    pass

def used(function):
    before = gc.mem_free()
    return before - function()

def local():
    kept = bytearray(1600)
    return gc.mem_free()

def generated():
    def generate():
        kept = bytearray(1600)
        yield kept
        yield None
    generator = generate()
    next(generator)
    return gc.mem_free()

def stored():
    box = Box()
    box.kept = bytearray(1600)
    return gc.mem_free()

for function in (local, generated, stored):
    print(1600 <= used(function) <= 1900)
print(gc.mem_free() + gc.mem_alloc() > 265000, gc.mem_alloc() < 2000)
"""
    assert output(source) == "True\n" * 3 + "True True"


@pytest.mark.parametrize(
    "body", ["items.append([])", "items = [items, i]", "items.append(bytearray(10**5))"]
)
def test_memory_runs_out_in_a_for_loop(body: str) -> None:
    with pytest.raises(MemoryError):
        output(f"items = []\nfor i in range(10**9):\n    {body}")
