"""The hub in a tab: what a program prints, its errors, its stop, whatever it does."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_page import ENDED, open_program, run_program

from brickhub.virtual.run import run_file

if TYPE_CHECKING:
    from playwright.sync_api import Page

DATA = Path(__file__).parents[3] / "brickhub" / "tests" / "virtual" / "data"
HEAD = "from pybricks.tools import wait\n"
STOP_S = 0.2


def firmware_programs() -> list[dict[str, str]]:
    """Programs whose output is that of the firmware, as files by name."""
    text = (DATA / "firmware_programs.txt").read_text(encoding="utf-8")
    programs = []
    for body in re.split(r"(?m)^=== .+\n", text)[1:]:
        _, *parts = re.split(r"(?m)^--- (.+)\n", body)
        files = dict(zip(parts[::2], parts[1::2], strict=True))
        del files["prints"]
        programs.append(files)
    return programs


def printed(folder: Path, files: dict[str, str], name: str = "main.py") -> str:
    """What a program prints in a terminal."""
    for file, source in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(source, encoding="utf-8")
    out, err = io.BytesIO(), io.StringIO()
    run_file(folder / name, stdout=out, stderr=err, time_limit_s=600)
    return out.getvalue().decode("utf-8", "replace") + err.getvalue()


SINGLE = [files["main.py"] for files in firmware_programs() if list(files) == ["main.py"]]


@pytest.mark.parametrize("number", range(20))
def test_prints_what_the_terminal_prints(page: Page, number: int, tmp_path: Path) -> None:
    source = SINGLE[number * len(SINGLE) // 20]
    name, shown, _ = run_program(page, source)
    assert shown == printed(tmp_path, {name: source}, name)


def test_an_error_is_shown_at_its_line(page: Page) -> None:
    source = HEAD + "print('before')\nwait(10)\nx = 1 / 0\nprint('after')\n"
    name, shown, state = run_program(page, source)
    assert state == "error"
    expected = f'File "{name}", line 4, in <module>\nZeroDivisionError: divide by zero\n'
    assert shown.endswith(expected)
    assert page.text_content("#error") == "Line 4: ZeroDivisionError: divide by zero"
    marked = page.locator(".cm-gutter-lint .cm-gutterElement").filter(has=page.locator("div"))
    assert marked.count() == 1
    assert page.locator(".cm-line", has_text="1 / 0").locator(".cm-lintRange-error").count() == 1


ODD = {
    "print(1\n": "SyntaxError: invalid syntax",
    "  x = 1\n": "IndentationError: unexpected indent",
    "def f(n):\n    return f(n + 1)\nf(0)\n": "RuntimeError: maximum recursion depth exceeded",
    "x = []\nwhile True:\n    x.append(b'x' * 10000)\n": "MemoryError",
    "import nothing\n": "ImportError: no module named 'nothing'",
    "\x00\n": "SyntaxError",
}


@pytest.mark.parametrize("source", ODD)
def test_odd_programs_get_the_hubs_own_words(page: Page, source: str) -> None:
    _, shown, state = run_program(page, source)
    assert state == "error"
    assert ODD[source] in shown
    assert run_program(page, "print('still here')\n")[1] == "still here\n"


@pytest.mark.realtime
@pytest.mark.parametrize(
    "source",
    [
        "while True:\n    pass\n",
        "while True:\n    print('on and on')\n",
        HEAD + "wait(1000000)\n",
        "x = 0\nfor i in range(10 ** 9):\n    x = i\n",
        "while True:\n    try:\n        wait(1)\n    except BaseException:\n        pass\n",
    ],
)
def test_stop_ends_a_program_without_end(page: Page, source: str) -> None:
    open_program(page, source)
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.wait_for_timeout(500)
    took_ms = page.evaluate(
        """async () => {
            const state = document.querySelector("#state"), start = performance.now();
            document.querySelector("#stop").click();
            while (state.textContent === "running") await new Promise(requestAnimationFrame);
            return performance.now() - start;
        }"""
    )
    assert page.text_content("#state") == "stopped"
    assert took_ms < 1000 * STOP_S
    assert (page.text_content("#console") or "").endswith("was stopped (SystemExit).\n")


def test_a_program_too_much_for_python_leaves_the_page_usable(page: Page) -> None:
    """So many brackets within each other that the browser's own stack is full."""
    _, _, state = run_program(page, f"x = {'(' * 30000}1{')' * 30000}\n")
    assert state in ("error", "failed")
    page.wait_for_selector("#state.ready, #state.error")
    assert run_program(page, "print('still here')\n")[1] == "still here\n"


def test_a_sensor_is_set_while_the_program_runs(page: Page) -> None:
    open_program(
        page,
        "from pybricks.pupdevices import ColorSensor\nfrom pybricks.parameters import Color, Port\n"
        "sensor = ColorSensor(Port.C)\n"
        "while sensor.color() != Color.RED:\n    pass\nprint('red')\n",
    )
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#state.running")
    page.get_by_role("button", name="red").click()
    page.wait_for_selector(ENDED)
    assert page.text_content("#console") == "red\n"


def test_buttons_are_held_as_long_as_the_finger(page: Page) -> None:
    open_program(
        page,
        "from pybricks.hubs import PrimeHub\nfrom pybricks.parameters import Button\n"
        "hub = PrimeHub()\nwhile Button.LEFT not in hub.buttons.pressed():\n    pass\n"
        "hub.display.char('L')\n"
        "while hub.buttons.pressed():\n    pass\nprint('let go')\n",
    )
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#state.running")
    left = page.get_by_role("button", name="Left button")
    left.hover()
    page.mouse.down()
    page.wait_for_selector("#hub .display[aria-label='Display: L']")
    assert page.text_content("#console") == ""
    page.mouse.up()
    page.wait_for_selector(ENDED)
    assert page.text_content("#console") == "let go\n"
