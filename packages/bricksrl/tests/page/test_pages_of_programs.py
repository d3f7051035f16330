"""Pages of programs: their console, how long they stay, and their stop."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.page import program as programs
from bricksrl.page.program import ProgramPage, Told


class Stream:
    def __init__(self) -> None:
        self.said: list[Any] = []

    def write(self, said: Any) -> int:
        self.said.append(said)
        return len(said)

    def flush(self) -> None:
        self.said.append("flushed")


def test_what_a_program_says_goes_to_its_stream_and_to_the_page() -> None:
    stream, shown = Stream(), list[str]()
    told = Told(stream, shown.append)
    assert told.write("a line\n") == 7
    assert told.write(b"4 \xc2\xb1 1 \xff") == 8
    told.flush()
    assert stream.said == ["a line\n", b"4 \xc2\xb1 1 \xff", "flushed"]
    assert shown == ["a line\n", "4 \u00b1 1 \ufffd"]


def test_console_of_a_program_keeps_the_end() -> None:
    page = ProgramPage("main.py")
    page.tell("first ")
    page.tell("second")
    assert page.board.status[1]["console"] == "first second"
    page.tell("x" * 7_999)
    assert page.board.status[1]["console"] == "d" + "x" * 7_999
    status = page.board.status[1]
    assert (status["title"], status["state"]) == ("main.py", "waiting")
    assert (status["speeds"], status["speed"]) == (["1x", "10x", "max"], "1x")
    assert status["subtitle"] == "a program on a virtual hub"


@pytest.mark.parametrize(
    ("watched_s", "ends_s"),
    [((), 2.0), ((0.0, 1.0), 4.0), ((1.0, 6.0), 9.0), ((0.0, 0.0), 3.0)],
)
def test_page_of_a_program_stays_while_somebody_looks_and_while_it_is_loaded_again(
    monkeypatch: pytest.MonkeyPatch, watched_s: tuple[float, ...], ends_s: float
) -> None:
    now_s = [0.0]

    class Page(ProgramPage):
        @property
        def is_watched(self) -> bool:
            return bool(watched_s) and watched_s[0] <= now_s[0] <= watched_s[1]

    def sleep(seconds: float) -> None:
        now_s[0] = round(now_s[0] + seconds, 6)

    monkeypatch.setattr(programs.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(programs.time, "sleep", sleep)
    page = Page("main.py")
    page.stay(2.0)
    assert now_s[0] == pytest.approx(ends_s, abs=0.21)
    status = page.board.status[1]
    assert (status["state"], status["controls"]) == ("finished", [])
    assert status["note"] == "The program has ended."


def test_stopped_program_stays_stopped_and_ctrl_c_ends_the_page(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(_seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(programs.time, "sleep", interrupted)
    page = ProgramPage("main.py")
    page.stop()
    page.stay(60.0)
    status = page.board.status[1]
    assert (status["state"], status["message"]) == ("stopped", "The program was stopped by hand.")


def test_page_of_programs_is_still_while_one_of_them_drives() -> None:
    page = ProgramPage("several")
    assert page.has_stopped()
    machines: list[Any] = [SimpleNamespace(is_driven=False), SimpleNamespace(is_driven=True)]
    page._machines = machines
    assert not page.has_stopped()
    machines[1].is_driven = False
    assert page.has_stopped()


def test_hand_of_a_visitor_who_leaves_lets_go(monkeypatch: pytest.MonkeyPatch) -> None:
    page = ProgramPage("main.py")
    pulls: list[Any] = []
    monkeypatch.setattr(page._view.hand, "pull", pulls.append)
    for name, value in (("pull", [1, 0.0, 0.0]), ("left", None), ("arrived", None)):
        page._press(name, value)
    assert pulls == [[1, 0.0, 0.0], None]
