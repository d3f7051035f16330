"""What runs in the worker, with a page that is played."""

from __future__ import annotations

import gc
import io
import json
import signal
import struct
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest

from brickhub.virtual.run import run_file
from bricktwin.robots import TWO_WHEELER
from bricktwin.site.tab import run
from bricktwin.twin.make_body import make_body

ROW = 8
SENSOR = (
    "from pybricks.pupdevices import ColorSensor\nfrom pybricks.parameters import Color, Port\n"
    "from pybricks.tools import wait\nsensor = ColorSensor(Port.C)\n"
)


class PlayedPage:
    """A page that lets time pass to ``allowed_ms`` first, then sends ``messages``, then allows all
    of it."""

    def __init__(self, allowed_ms: float = 1e9, messages: list[dict[str, object]] = []) -> None:  # noqa: B006
        self.allowed_ms = allowed_ms
        self.messages = messages
        self.events: list[dict[str, object]] = []
        self.rows: list[tuple[float, ...]] = []
        self.waited_ms: list[int] = []

    def frame(self) -> None:
        """No robot, no poses."""

    def post(self, events: str, rows: bytes) -> None:
        self.events += json.loads(events or "[]")
        self.rows += struct.iter_unpack(f"{ROW}f", rows)

    def take(self) -> str:
        if self.waited_ms and self.messages:
            sent, self.messages = self.messages, []
            return json.dumps(sent)
        return ""

    def may_go_on(self, time_ms: int) -> bool:
        if time_ms > self.allowed_ms and not self.waited_ms:
            self.waited_ms.append(time_ms)
            return False
        return True

    def text(self, *kinds: str) -> str:
        return "".join(str(event["text"]) for event in self.events if event["kind"] in kinds)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(run, "FOLDER", tmp_path / "programs")
    return tmp_path


def run_source(page: PlayedPage, source: str, **request: object) -> int:
    content = {"files": {"main.py": source}, "name": "main.py", "readings": [], **request}
    return run.run_in_tab(json.dumps(content), page)


def test_prints_and_fails_as_in_a_terminal(folder: Path) -> None:
    source = "print('ä', b'\\xff')\nimport part\nprint(part.X)\n1 / 0\n"
    files = {"main.py": source, "part.py": "X = 3\n"}
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    out, err = io.BytesIO(), io.StringIO()
    code = run_file(folder / "main.py", stdout=out, stderr=err)
    page = PlayedPage()
    assert run_source(page, source, files=files) == code == 1
    assert page.text("out").encode("latin-1") == out.getvalue()
    assert page.text("err") == err.getvalue()


def test_a_refused_run_says_why() -> None:
    page = PlayedPage()
    assert run_source(page, "print(1)\n", name="other.py") == run.REFUSED_EXIT_CODE
    assert page.text("err").startswith("error: ")


def test_frames_have_the_angle_of_each_motor() -> None:
    page = PlayedPage()
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "motor = Motor(Port.B)\nmotor.run_angle(500, 90)\nprint(motor.angle())\n"
    )
    assert run_source(page, source) == 0
    times_ms = [row[0] for row in page.rows]
    assert times_ms[1:-1] == [20.0 * number for number in range(1, len(times_ms) - 1)]
    assert round(page.rows[-1][2]) == int(page.text("out")) == 89
    # Nothing is on port A.
    assert page.rows[-1][1] != page.rows[-1][1]
    assert {"kind": "devices", "ms": 20, "devices": {"B": "Motor"}} in page.events


def test_readings_before_and_while_it_runs() -> None:
    source = SENSOR + "print(sensor.color())\nwait(500)\nprint(sensor.color())\n"
    changed = {"kind": "reading", "reading": ["C", "surface", [240, 100, 100]]}
    page = PlayedPage(200, [changed])
    assert run_source(page, source, readings=[["C", "surface", [0, 100, 100]]]) == 0
    assert page.text("out") == "Color.RED\nColor.BLUE\n"


def test_stop_ends_it_past_its_handlers() -> None:
    source = (
        SENSOR + "while True:\n    try:\n        wait(1)\n    except BaseException:\n        pass\n"
    )
    page = PlayedPage(100, [{"kind": "stop"}])
    assert run_source(page, source) == 0
    assert page.text("err") == "The program was stopped (SystemExit).\n"
    assert page.waited_ms == [120]


def test_files_of_the_program_are_handed_over() -> None:
    page = PlayedPage()
    assert run_source(page, "print('PB_OF:log.csv')\nprint('1, 2')\nprint('PB_EOF')\n") == 0
    assert [event for event in page.events if event["kind"] == "file"] == [
        {"kind": "file", "ms": 0, "name": "log.csv", "text": "1, 2\n"}
    ]


def test_needs_nothing_that_no_tab_has() -> None:
    """Packages of compiled code, and those for terminals and radios."""
    missing = ("bleak", "greenlet", "mujoco", "numpy", "packaging", "PIL", "prompt_toolkit")
    missing += ("scipy", "serial", "tyro")
    program = (
        f"import sys, types\nfor name in {missing}: sys.modules[name] = None\n"
        "from bricktwin.site.tab import mpy_cross\n"
        "mpy_cross.put_in_place(lambda name, source, options: (1, None, 'SyntaxError: odd'))\n"
        "import bricktwin.site.tab.run, bricktwin.site.tab.robot_file\n"
        "from brickhub.hub.program.compile import cross_compile\n"
        "print(cross_compile('x', 'main.py'))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.stdout == "(None, 'SyntaxError: odd')\n", done.stderr


@pytest.fixture
def stops_in_runs_only() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    run.heed_stops_in_runs_only()
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("stops_in_runs_only")
def test_a_stop_that_comes_late_ends_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """The program has ended, and the page does not know yet."""
    tell_written = run.tell_written

    def late(*given: object) -> None:
        signal.raise_signal(signal.SIGINT)
        tell_written(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(run, "tell_written", late)
    page = PlayedPage()
    assert run_source(page, "print('there')\n") == 0
    assert page.text("out", "err") == "there\n"


@pytest.mark.usefixtures("stops_in_runs_only")
def test_an_interrupt_ends_a_program_that_runs() -> None:
    page = PlayedPage(allowed_ms=100)
    page.take = lambda: signal.raise_signal(signal.SIGINT) or ""  # type: ignore[method-assign, func-returns-value]
    waits = "from pybricks.tools import wait\nwhile True:\n    wait(10)\n"
    assert run_source(page, waits) == run.STOPPED_EXIT_CODE
    assert page.text("err") == "The program was stopped (SystemExit).\n"


def test_a_stream_of_the_program_tells_the_page_and_says_how_much_it_took() -> None:
    told: list[tuple[str, str]] = []

    class Told:
        def tell(self, kind: str, text: str) -> None:
            told.append((kind, text))

    out, err = (run.ProgramOutput(Told(), kind) for kind in ("out", "err"))  # type: ignore[arg-type]
    assert out.write(b"ab\xff") == 3 and err.write("größe") == 5
    print("a", 1, file=err)
    assert told == [("out", "ab\xff"), ("err", "größe"), *(("err", part) for part in "a 1\n")]


GAUGE = """from brickhub.virtual.own_devices import OwnDevice, OwnMode
GAUGE = OwnDevice(200, (OwnMode("LEVEL", lambda time_s: [{level}]),))
"""
MEASURES = """# Port: A=gauge.py:GAUGE
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Port
print(PUPDevice(Port.A).read(0))
"""


def test_a_device_of_ones_own_is_another_file_of_the_page() -> None:
    for level in ("7", "8"):
        page = PlayedPage()
        files = {"main.py": MEASURES, "gauge.py": GAUGE.format(level=level)}
        assert run_source(page, MEASURES, files=files) == 0
        assert page.text("out") == f"({level},)\n", "as it is now"


@pytest.mark.parametrize(
    ("gauge", "says"),
    [
        (None, "names a file that is not on this page; open gauge.py, or write it"),
        ("1 / 0\n", "gauge.py:GAUGE cannot be loaded (ZeroDivisionError: "),
        (GAUGE.format(level="1 / 0"), "the function of mode LEVEL failed (ZeroDivisionError: "),
        ("GAUGE = 3\n", "gauge.py:GAUGE is no OwnDevice, OwnUart or OwnI2c; name one"),
    ],
)
def test_what_is_wrong_with_a_device_of_ones_own_is_said(gauge: str | None, says: str) -> None:
    page = PlayedPage()
    files = {"main.py": MEASURES} | ({} if gauge is None else {"gauge.py": gauge})
    assert run_source(page, MEASURES, files=files) != 0
    assert says in page.text("err")


class MeasuredPage(PlayedPage):
    """A page that keeps nothing, and measures each minute what Python holds."""

    def __init__(self) -> None:
        super().__init__()
        self.held: list[int] = []

    def post(self, events: str, rows: bytes) -> None:
        """Nothing is kept."""

    def may_go_on(self, time_ms: int) -> bool:
        if time_ms >= 60_000 * (len(self.held) + 1):
            gc.collect()
            self.held.append(tracemalloc.get_traced_memory()[0])
        return True


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_program_without_end_takes_no_more_memory() -> None:
    source = (
        "from pybricks.parameters import Direction, Port\n"
        "from pybricks.pupdevices import Motor\nfrom pybricks.robotics import DriveBase\n"
        "base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)\n"
        "while True:\n    base.curve(100, 360)\n    print(base.distance())\n"
    )
    content = {"files": {"main.py": source}, "name": "main.py", "readings": []}
    page = MeasuredPage()
    tracemalloc.start()
    try:
        run.run_in_tab(json.dumps({**content, "time_limit_s": 310}), page, make_body(TWO_WHEELER))
    finally:
        tracemalloc.stop()
    assert len(page.held) == 5
    # The first minute fills what is kept of what was last seen and said.
    assert max(page.held[1:]) - page.held[0] < 10_000
