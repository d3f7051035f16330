"""The site in a browser: a hub that prints what it prints in a terminal, its errors, a robot;
programs that are kept, links, use without a network. All in one page, which takes long to start."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_page import ENDED, ENDLESS, open_program, run_program, stopped_after_s

from brickhub.virtual.run import run_file

if TYPE_CHECKING:
    from playwright.sync_api import Page

DATA = Path(__file__).parents[3] / "brickhub" / "tests" / "virtual" / "data"
HEAD = "from pybricks.tools import wait\n"
DRIVE = (
    "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Direction, Port\n"
    "from pybricks.robotics import DriveBase\n"
    "left, right = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A)\n"
    "DriveBase(left, right, 56, 130).straight({mm})\nprint(round(left.angle()))\n"
)


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


# The page has other programs beside the one that runs, so that what imports itself finds them.
SINGLE = [
    files["main.py"]
    for files in firmware_programs()
    if list(files) == ["main.py"] and "import main" not in files["main.py"]
]


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


def test_a_program_too_much_for_python_leaves_the_page_usable(page: Page) -> None:
    """So many brackets within each other that the browser's own stack is full."""
    _, _, state = run_program(page, f"x = {'(' * 30000}1{')' * 30000}\n")
    assert state in ("error", "failed")
    page.wait_for_selector("#state.ready, #state.error")
    assert run_program(page, "print('still here')\n")[1] == "still here\n"


def test_the_last_5000_lines_are_shown_and_all_are_saved(page: Page) -> None:
    _, shown, _ = run_program(page, "for n in range(12000):\n    print(n)\n")
    first, *others = map(int, shown.split())
    # What goes is a piece of up to 250 lines.
    assert 6750 <= first <= 7000
    assert others == list(range(first + 1, 12000))
    with page.expect_download() as saved:
        page.click("#save-output")
    assert saved.value.path().read_text().split() == [str(n) for n in range(12000)]


def test_lines_come_one_after_the_other_and_an_error_beside_them(page: Page) -> None:
    """As many as are shown, and then some: in the end the first ones are gone."""
    source = HEAD + "for n in range(5600):\n    print(n)\n    wait(5)\n1 / 0\n"
    _, shown, _ = run_program(page, source)
    first, *between, error = shown.strip().splitlines()
    assert error == "ZeroDivisionError: divide by zero"
    assert 350 <= int(first) <= 605
    assert between[:-2] == [str(n) for n in range(int(first) + 1, 5600)]
    # A block begins where a line ends, and the error is shown as one.
    blocks = page.eval_on_selector_all("#console .block", "all => all.map(one => one.textContent)")
    assert all(block.endswith("\n") for block in blocks)
    assert page.locator("#console .err").count() == 1


@pytest.mark.parametrize("source", ENDLESS)
def test_stop_ends_a_program_without_end(page: Page, source: str) -> None:
    # The limit is that of a computer whose cores run other tests; `test_stop_in_browser.py` has
    # the true one.
    assert stopped_after_s(page, source) < 1.0


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


def test_a_program_of_ev3_shows_a_brick_whose_buttons_lie_as_on_one(page: Page) -> None:
    open_program(page, "from pybricks.ev3devices import Motor\n")
    assert page.text_content("#hub .kind") == "EV3Brick"
    boxes = {}
    for button in ("left_up", "up", "left", "center", "right", "down"):
        box = page.locator(f'#hub [data-button="{button}"]').bounding_box()
        assert box is not None, button
        boxes[button] = box
    assert boxes["up"]["y"] < boxes["center"]["y"] < boxes["down"]["y"]
    assert boxes["left"]["x"] < boxes["center"]["x"] < boxes["right"]["x"]
    stopping = page.locator('#hub [aria-label$="which stops the program"]:visible')
    assert stopping.get_attribute("data-button") == "left_up"


def test_page_and_worker_share_memory_on_a_plain_file_server(page: Page) -> None:
    assert page.evaluate("crossOriginIsolated")


def test_a_robot_drives_and_is_drawn(page: Page) -> None:
    page.select_option("#robot", "two-wheeler")
    page.select_option("#world", "open floor")
    _, shown, state = run_program(page, DRIVE.format(mm=200))
    assert state == "finished"
    # 200 mm on wheels of 56 mm are 409 degrees.
    assert abs(int(shown) - 409) <= 3
    assert page.evaluate("Number(document.querySelector('#scene').dataset.frames)") >= 2
    page.select_option("#robot", "bench")


def test_a_run_is_looked_at_again(page: Page) -> None:
    run_program(page, "from pybricks.tools import wait\nwait(2000)\nprint('end')\n")
    assert page.input_value("#scrub") == page.get_attribute("#scrub", "max") == "2000"
    page.evaluate(
        """() => {
            const scrub = document.querySelector("#scrub");
            scrub.value = 500;
            scrub.dispatchEvent(new Event("input"));
        }"""
    )
    page.wait_for_selector("#clock:text('0.5 s')")


def test_a_link_holds_the_program(page: Page) -> None:
    """Which is looked at before it runs."""
    name = open_program(page, "print('from a friend: ä')\n", "friend.py")
    page.locator("#more summary").click()
    page.get_by_role("button", name="Copy a link to it").click()
    page.wait_for_selector("#note:not([hidden])")
    link = page.evaluate(
        """async () => {
            const { linkOf, programOf } = await import("./programs.js");
            const { files, current } = JSON.parse(localStorage["bricks-programs"]);
            const link = await linkOf({ name: current, source: files[current] });
            return [link.split("#")[0], await programOf(new URL(link).hash)];
        }"""
    )
    assert link == [page.url, {"name": name, "source": "print('from a friend: ä')\n"}]


def test_a_link_holds_a_large_program(page: Page) -> None:
    """Four hundred thousand letters that hardly become less."""
    assert page.evaluate(
        """async () => {
            const { linkOf, programOf } = await import("./programs.js");
            const parts = Array.from({ length: 40_000 }, () => Math.random().toString(36).slice(2, 12).padEnd(10, "x"));
            const source = parts.join("");
            const link = await linkOf({ name: "large.py", source });
            return (await programOf(new URL(link).hash)).source === source;
        }"""  # noqa: E501
    )


@pytest.mark.slow
def test_an_address_opens_an_example_and_runs_it(page: Page, address: str) -> None:
    other = page.context.new_page()
    other.goto(f"{address}#example=hello.py")
    other.wait_for_selector(ENDED)
    assert other.input_value("#programs") == "hello.py"
    assert other.input_value("#robot") == "bench"
    assert other.text_content("#console")
    other.close()


def test_programs_are_kept_and_the_site_works_without_a_network(page: Page) -> None:
    source = "print('kept')\n"
    name = open_program(page, source, "kept.py")
    listed = page.evaluate("fetch('files.json').then((answer) => answer.json())")["files"]
    # The page fetches the rest of the site when it is at work.
    page.evaluate(
        """async (names) => {
            const kept = async (name) => Boolean(await caches.match(new URL(name, location).href));
            for (const name of names) {
                while (!(await kept(name))) await new Promise((done) => setTimeout(done, 100));
            }
        }""",
        [file for file in listed if not file.endswith(".py")],
    )
    page.context.set_offline(True)
    try:
        page.reload()
        page.wait_for_selector("#state.ready")
        assert page.input_value("#programs") == name
        page.select_option("#rate", "fast")
        page.click("#run")
        page.wait_for_selector(ENDED)
        assert page.text_content("#console") == "kept\n"
    finally:
        page.context.set_offline(False)


def test_files_are_kept_for_this_folder_alone(page: Page, address: str) -> None:
    """A site in another folder of the same web space keeps its own."""
    kept = page.evaluate("caches.keys()")
    assert kept
    assert all(name.startswith(f"bricks {address} ") for name in kept)


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_screen(page: Page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_each_control_has_a_name(page: Page) -> None:
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input, textarea, summary")]
            .filter((element) => element.offsetParent !== null)
            .filter((element) => !(element.ariaLabel || element.textContent.trim()
                || element.labels?.length || element.title))
            .map((element) => element.outerHTML)"""
    )
    assert nameless == []


def test_where_there_is_no_web_serial_the_page_says_who_has_it(page: Page) -> None:
    page.evaluate("Object.defineProperty(navigator, 'serial', { configurable: true, value: null })")
    page.click("#connect-cable")
    said = page.text_content("#note") or ""
    page.evaluate("delete navigator.serial")
    assert "Firefox, Safari, phones and tablets do not" in said


@pytest.mark.parametrize("is_stopped_first", [False, True])
@pytest.mark.parametrize("source", [ENDLESS[0], ENDLESS[2]])
def test_another_robot_ends_the_program_and_the_page_is_ready(
    page: Page, source: str, is_stopped_first: bool
) -> None:
    open_program(page, source)
    page.select_option("#rate", "1")
    page.click("#run")
    page.wait_for_selector("#state.running")
    # At once, as by a program that presses: a person may do it within one picture.
    page.evaluate(
        """(isStoppedFirst) => {
            if (isStoppedFirst) document.querySelector("#stop").click();
            const robot = document.querySelector("#robot");
            robot.value = "two-wheeler";
            robot.dispatchEvent(new Event("change", { bubbles: true }));
        }""",
        is_stopped_first,
    )
    page.wait_for_selector("#state.stopped", timeout=20_000)
    page.select_option("#robot", "bench")
    assert run_program(page, "print('still here')\n")[1] == "still here\n"
