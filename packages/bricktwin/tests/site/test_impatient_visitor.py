"""A visitor who presses whatever can be pressed, in any order and at once: in the end the page is
of use."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from in_page import HEAD, open_program, run_program

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROGRAMS = [
    "while True:\n    pass\n",
    "while True:\n    print('on and on')\n",
    HEAD + "for n in range(100):\n    print(n)\n    wait(10)\n",
    "1 / 0\n",
    "print('at once')\n",
]
CHOICES = {"#robot": ["bench", "two-wheeler", "scout"], "#rate": ["1", "5", "fast"]}
BUTTONS = [
    "#run",
    "#run",
    "#run",
    "#stop",
    "#stop",
    "#pause",
    "#step",
    "#teach-it",
    "[data-teach=learn]",
    "[data-teach=halt]",
    "[data-teach=again]",
    "[data-teach=try]",
    "[data-teach=best]",
    "[data-teach=close]",
    "[data-button=center]",
]
PRESS = """(selector) => {
    const button = document.querySelector(selector);
    if (!button.disabled && button.offsetParent) button.click();
}"""
CHOOSE = """([selector, value]) => {
    const choice = document.querySelector(selector);
    choice.value = value;
    choice.dispatchEvent(new Event("change", { bubbles: true }));
}"""


def act(page: Page, rng: random.Random) -> str:
    """Do one thing; returns what it was."""
    kind = rng.choice(["press", "press", "press", "choose", "open"])
    if kind == "open":
        source = rng.choice(PROGRAMS)
        open_program(page, source)
        return source
    if kind == "choose":
        selector = rng.choice(list(CHOICES))
        value = rng.choice(CHOICES[selector])
        page.evaluate(CHOOSE, [selector, value])
        return f"{selector} {value}"
    selector = rng.choice(BUTTONS)
    page.evaluate(PRESS, selector)
    return selector


@pytest.mark.parametrize(
    "seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 40))]
)
def test_whatever_is_pressed_the_page_is_of_use_in_the_end(page: Page, seed: int) -> None:
    rng = random.Random(seed)
    done = []
    for _ in range(20):
        done.append(act(page, rng))
        page.wait_for_timeout(rng.choice([0, 0, 0, 20, 200]))
    for selector in ("[data-teach=halt]", "[data-teach=close]", "#stop"):
        page.evaluate(PRESS, selector)
    page.evaluate(CHOOSE, ["#robot", "bench"])
    page.wait_for_selector("#run:enabled", timeout=30_000)
    ran = run_program(page, "print('still here')\n")
    assert ran[1:] == ("still here\n", "finished"), done
