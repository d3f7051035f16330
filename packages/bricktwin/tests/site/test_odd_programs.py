"""Odd programs: each gets the hub's own words or is stopped, and leaves the page usable."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_page import run_program
from test_in_browser import printed
from test_stop_in_browser import STOP_S, stopped_after_s

if TYPE_CHECKING:
    from playwright.sync_api import Page

HUB = "from pybricks.hubs import PrimeHub\nhub = PrimeHub()\n"
MOTOR = "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
WAIT = "from pybricks.tools import wait, multitask, run_task\n"
TASK = f"{WAIT}async def f():\n    while True:\n        await wait(0)\n"

WORDS = [
    # What is no program.
    "print(1\n",
    "  x = 1\n",
    "if True:\nx = 1\n",
    "if True:\n    x = 1\n  y = 2\n",
    "x = 'abc\n",
    "x = '''abc\n",
    "\x00\n",
    "def f(:\n    pass\n",
    "return 1\n",
    "break\n",
    "x = = 2\n",
    "1 = x\n",
    "def f():\n    nonlocal x\n",
    "class A:\n\tx = 1\n        y = 2\n",
    "print('\U0001f600' * 10)\n",
    "x = '\\ud800'\nprint(x)\n",
    "print('no end of line')",
    "",
    # What is not there, or not so.
    "import nothing\n",
    "import os\nos.remove('main.py')\n",
    "from pybricks.hubs import NoHub\n",
    "open('/etc/passwd')\n",
    "None.x\n",
    "unknown\n",
    "int('x')\n",
    "[][1]\n",
    "{}['a']\n",
    "1 / 0\n",
    "raise ValueError('odd')\n",
    "raise SystemExit\n",
    "raise KeyboardInterrupt\n",
    "assert False, 'odd'\n",
    "raise 3\n",
    "class A:\n    def __repr__(self):\n        1 / 0\nprint(A())\n",
    "try:\n    1 / 0\nfinally:\n    unknown\n",
    "exec('1 / 0')\n",
    "eval('(')\n",
    "del print\nprint(1)\n",
    f"{MOTOR}Motor(Port.Z)\n",
    f"{MOTOR}a = Motor(Port.A)\nb = Motor(Port.A)\n",
    f"{HUB}hub.display.char('too long')\n",
    f"{HUB}hub.system.shutdown()\n",
    f"{WAIT}wait('x')\n",
    "print(input())\n",
    # Too deep, too much.
    "def f(n):\n    return f(n + 1)\nf(0)\n",
    "def f():\n    g()\ndef g():\n    f()\nf()\n",
    "class A:\n    def __getattr__(self, name):\n        return getattr(self, name)\nA().x\n",
    "x = []\nwhile True:\n    x.append(b'x' * 10000)\n",
    "x = bytearray(10 ** 9)\n",
    "x = 'x' * 10 ** 9\n",
    "x = [0] * 10 ** 9\n",
    "x = {}\nwhile True:\n    x[len(x)] = 'x' * 1000\n",
    "for n in range(3000):\n    print('line', n)\n",
    f"x = {'[' * 100}{']' * 100}\n",
]
"""Programs that print in the tab what they print in a terminal."""

TOO_DEEP = [
    f"x = {'(' * 5000}1{')' * 5000}\n",
    f"x = {'[' * 30000}{']' * 30000}\n",
    f"x = {'-' * 30000}1\n",
    f"x = {'not ' * 30000}1\n",
    f"x = {'lambda: ' * 5000}1\n",
    f"x = {'1 + ' * 50000}1\n",
    "".join(f"{' ' * n}if 1:\n" for n in range(200)) + f"{' ' * 200}pass\n",
    "x = []\nfor n in range(100000):\n    x = [x]\nprint(x)\n",
    "x = []\nfor n in range(100000):\n    x = [x]\nprint(x == x, len(str(x)))\n",
]
"""Programs too deep for a parser or a stack: the hub's words, or the page's own."""

ENDLESS = [
    "print(sum(n % 7 for n in range(10 ** 9)))\n",
    "x = 2\nwhile True:\n    x = (7 * x + 1) % 1009\n",
    "def f():\n    while True:\n        yield 1\nfor x in f():\n    pass\n",
    "while True:\n    try:\n        1 / 0\n    except Exception:\n        pass\n",
    "while True:\n    print('x' * 10000)\n",
    f"{TASK}run_task(multitask(f(), f()))\n",
    f"{HUB}while True:\n    hub.display.number(1)\n    hub.light.off()\n",
    f"{MOTOR}m = Motor(Port.A)\nwhile True:\n    m.run(100)\n    m.angle()\n",
]


def words(text: str) -> str:
    """What is printed, without what depends on the version of Python, which is another one in the
    tab: how many levels of its own a call through a built-in function takes, and sizes of its
    objects to the byte."""
    once = re.sub(r"(  File .+, in \w+\n)\1+", r"\1", text)
    return re.sub(r"allocating \d+ bytes", "allocating bytes", once)


def check_usable(page: Page) -> None:
    """A program still runs as it should."""
    _, *ended = run_program(page, "print('still here')\n")
    assert (ended, page.text_content("#note")) == (["still here\n", "finished"], "")


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(WORDS)))
def test_words_are_the_hubs_own(page: Page, number: int, tmp_path: Path) -> None:
    source = WORDS[number]
    name, shown, state = run_program(page, source)
    assert state in ("error", "finished", "stopped")
    assert words(shown) == words(printed(tmp_path, {name: source}, name))
    check_usable(page)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(TOO_DEEP)))
def test_too_deep_a_program_leaves_the_page_usable(page: Page, number: int) -> None:
    _, shown, state = run_program(page, TOO_DEEP[number])
    note = page.text_content("#note") or ""
    assert state in ("error", "finished") or "too much for this browser" in note
    assert "Traceback" in shown or state != "error"
    page.wait_for_selector("#state.ready, #state.error, #state.finished")
    check_usable(page)


@pytest.mark.slow
def test_what_one_program_piled_up_ends_no_later_one(page: Page) -> None:
    """Lists a hundred thousand deep, which take more stack to be removed than a browser has."""
    for source in 3 * TOO_DEEP[-2:]:
        _, shown, _ = run_program(page, source)
        assert "MemoryError" in shown, "it has begun, and has ended by what it did itself"
        page.wait_for_selector("#state.ready, #state.error, #state.finished")
    check_usable(page)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("number", range(len(ENDLESS)))
def test_an_endless_program_is_stopped(page: Page, number: int) -> None:
    assert stopped_after_s(page, ENDLESS[number]) < STOP_S
    check_usable(page)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_stop_that_python_does_not_hear_ends_its_worker(page: Page) -> None:
    """A built-in function of Python's own asks nobody whether it should stop."""
    assert stopped_after_s(page, "print('begin')\nmax(range(10 ** 9))\n") < 2 * STOP_S
    # Another worker starts; the page says what came of the program nevertheless.
    page.wait_for_timeout(8000)
    assert page.text_content("#state") == "stopped"
    check_usable(page)
