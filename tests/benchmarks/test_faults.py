"""Faults that a module can have."""

from __future__ import annotations

import pytest

from benchmarks.mutants import faults


def after(text: str) -> set[str]:
    """What takes the place of something in a module."""
    return {fault.after for fault in faults(text)}


def test_each_operator_has_its_faults() -> None:
    text = "def least(a, b):\n    return min(a, b) if a < b else a + 2\n"
    assert after(text) == {
        "max(a, b)",
        "a <= b",
        "a >= b",
        "a - 2",
        "3",
        "return None",
    }


@pytest.mark.parametrize(
    "text",
    [
        "@overload\ndef make(copies=1): ...\n",
        "@lru_cache(8)\ndef made(name): ...\n",
        "pairs = zip(a, b, strict=True)\n",
        "def told(number: Range(1, 2)): ...\n",
        "text = f'{1 + 2}'\n",
    ],
)
def test_what_makes_an_equal_program_is_not_drawn(text: str) -> None:
    assert not after(text)
