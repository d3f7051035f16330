"""Call stack of a hub: how deep a program's functions can call each other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hub_programs import Console, output

from brickhub.robot import BENCH, HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.memory import most_nested_calls
from brickhub.virtual.micropython.text import format_traceback
from brickhub.virtual.pybricks import modules

RECURSIVE = {
    "function": "def f(n):\n    return n and 1 + f(n - 1)",
    "with keywords": "def f(n):\n    return n and 1 + f(n=n - 1)",
    "two functions": (
        "def g(n):\n    return n and 1 + f(n - 1)\ndef f(n):\n    return n and 1 + g(n - 1)"
    ),
    "method": "class A:\n    def f(self, n):\n        return n and 1 + self.f(n - 1)\nf = A().f",
    "inner function": (
        "def outer():\n    def f(n):\n        return n and 1 + f(n - 1)\n    return f\nf = outer()"
    ),
}
DEEPEST = """
try:
    while True:
        n = 1 + f(n)
except RuntimeError as error:
    print(n, error)
"""


def deepest(source: str, hub: HubKind = HubKind.PRIME) -> str:
    """What a program prints that calls deeper and deeper, from a little above the end. A stack that
    ends before prints the start."""
    start = max(0, most_nested_calls(hub) - 5)
    return output(f"{source}\nn = {start}\n{DEEPEST}", robot=Robot("bench", hub))


@pytest.mark.parametrize("hub", HubKind)
def test_stack_holds_as_many_calls_as_that_of_the_hub(hub: HubKind) -> None:
    assert (
        deepest(RECURSIVE["function"], hub)
        == f"{most_nested_calls(hub) - 1} maximum recursion depth exceeded"
    )


def test_larger_stacks_hold_more_calls() -> None:
    calls = [
        most_nested_calls(hub)
        for hub in (HubKind.MOVE, HubKind.CITY, HubKind.PRIME, HubKind.TECHNIC, HubKind.ESSENTIAL)
    ]
    assert calls == sorted(calls) and calls[0] > 5 and calls[-1] < 200


def test_page_says_how_many() -> None:
    text = " ".join(
        (Path(__file__).parents[5] / "docs" / "virtual_hub.md").read_text(encoding="utf-8").split()
    )
    assert all(
        re.search(rf"\b{most_nested_calls(hub)} on an? {hub.value}\b", text, re.IGNORECASE)
        for hub in HubKind
    )


@pytest.mark.parametrize("source", RECURSIVE.values(), ids=RECURSIVE)
def test_every_kind_of_recursion_ends(source: str) -> None:
    assert deepest(source) == deepest(RECURSIVE["function"])


def test_methods_of_the_hub_are_called_on_a_full_stack() -> None:
    source = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
motor = Motor(Port.A)
class Turner:
    def run(self, n):
        motor.run(100)
        return n and self.run(n - 1)
n = 0
try:
    while True:
        Turner().run(n)
        n += 1
except RuntimeError:
    print(n)
"""
    assert int(output(source)) == most_nested_calls(HubKind.PRIME) - 1


def test_traceback_ends_where_the_call_is() -> None:
    machine = Machine(BenchBody(BENCH))
    console = Console(machine, {})
    with pytest.raises(RuntimeError) as caught:
        execute(
            "def f(n):\n    m = n + 1\n    f(m)\nf(0)\n",
            "main.py",
            modules(machine, console),
            console,
        )
    lines = format_traceback(caught.value, "main.py").splitlines()
    assert lines[1] == '  File "main.py", line 4, in <module>'
    assert set(lines[2:-1]) == {'  File "main.py", line 3, in f'}
    assert len(lines[1:-1]) == most_nested_calls(HubKind.PRIME)
    assert lines[-1] == "RuntimeError: maximum recursion depth exceeded"
