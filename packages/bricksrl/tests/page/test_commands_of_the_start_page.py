"""Commands of the start page: how they are started, shown and ended."""

from __future__ import annotations

import json
import os
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.page import start as start_page
from bricksrl.page.server import PageOptions
from bricksrl.page.start import ACTIONS, StartPage


class Process:
    """A command that runs until it is ended."""

    def __init__(self, words: Sequence[str]) -> None:
        self.words = list(words)
        self.code: int | None = None
        self.stdout = ()

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def poll(self) -> int | None:
        return self.code


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Process]:
    """Commands that were started."""

    def end(jobs: Sequence[Any], *_: float) -> None:
        for job in jobs:
            job.process.code = 0

    monkeypatch.setattr(start_page, "end_jobs", end)
    return []


@pytest.fixture
def page(started: list[Process], tmp_path: Path) -> Iterator[StartPage]:
    def launch(words: Sequence[str], folder: Path) -> Any:
        assert folder == tmp_path
        started.append(Process(words))
        return started[-1]

    (tmp_path / "mine.ldr").write_text("0 A robot", encoding="utf-8")
    page = StartPage(tmp_path, PageOptions("192.0.2.9"), launch)
    abilities = [{"name": "walk", "sentence": "walk", "reason": ""}]
    page._drawings.take("mine.ldr", [json.dumps({"abilities": abilities})])
    yield page
    page.close()


OWN_PAGE = ["--page-host", "192.0.2.9"]
COMMANDS: dict[str, tuple[str, list[str]]] = {
    "play": ("Walker-v1", ["play", "Walker-v1", "--page", *OWN_PAGE]),
    "drive": ("Walker-v1", ["drive", "Walker-v1", *OWN_PAGE]),
    "train": ("Park-v0", ["train", "Park-v0", "--page", *OWN_PAGE, "--seed", "0"]),
    "game": ("Tag-v0", ["team", "Tag-v0", "--page", *OWN_PAGE]),
    "class": ("runs", ["compare", "--class", "runs"]),
    "look": ("mine.ldr", ["learn", "mine.ldr", "--look", "--json"]),
    "teach": ("mine.ldr:walk", ["learn", "mine.ldr:walk", "--page", *OWN_PAGE, "--seed", "0"]),
    "build": ("walker", ["plan", "show", "walker", *OWN_PAGE]),
    "booklet": ("walker", ["plan", "steps", "walker", "--out", "None/1.pdf"]),
    "check virtual": ("Park-v0", ["hub", "check", "Park-v0", "--hub", "virtual", "--yes"]),
    "check ble": ("Park-v0", ["hub", "check", "Park-v0", "--hub", "ble", "--yes"]),
    "check usb": ("Park-v0", ["hub", "check", "Park-v0", "--hub", "usb", "--yes"]),
}
AT_WORK_BESIDE_OTHERS = {"train", "class", "look", "teach", "booklet"}


def test_each_button_of_the_start_page_starts_its_command(
    page: StartPage, started: list[Process]
) -> None:
    assert ACTIONS.keys() - COMMANDS.keys() == {"watch", "compare"}, "which need runs"
    for action, (value, words) in COMMANDS.items():
        page._jobs.clear()
        page._press(action, value)
        assert page.board.status[1]["message"] == ""
        assert started[-1].words == words, action


@pytest.mark.parametrize("action", COMMANDS)
def test_a_robot_takes_the_place_of_the_one_before(
    page: StartPage, started: list[Process], action: str
) -> None:
    page._press("drive", "Spinning-v0")
    page._press(action, COMMANDS[action][0])
    first, second = started
    assert (first.code is None) is (action in AT_WORK_BESIDE_OTHERS)
    assert second.code is None
    # A training, and what has no page, goes on when nobody looks any more.
    beside = {*AT_WORK_BESIDE_OTHERS, "check virtual", "check ble", "check usb"}
    assert ACTIONS[action].ends_alone is (action not in beside)


def test_jobs_of_the_start_page_are_numbered_and_the_newest_stands_first(
    page: StartPage, started: list[Process]
) -> None:
    page._press("train", "RunAway-v0")
    page._press("compare", [])
    assert page.board.status[1]["jobs"][0]["action"] == "compare"
    page._press("train", "Park-v0")
    started[1].code = 1
    page._tick()
    jobs = page.board.status[1]["jobs"]
    assert [(job["number"], job["action"], job["about"], job["code"]) for job in jobs] == [
        (3, "train", "Park-v0", None),
        (2, "compare", "", 1),
        (1, "train", "RunAway-v0", None),
    ]


def test_visitors_are_told_why_in_whole_sentences(
    page: StartPage, started: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    ada, ben = page.visitors.arrive("a", "Ada"), page.visitors.arrive("b", "Ben")
    page._press("drive", "Spinning-v0", ada)
    page._press("end", 1, ben)
    seat = "Spinning-v0 (job 1)"
    assert page.board.status[1]["questions"] == {seat: "Ben"}
    assert page.board.status[1]["holders"] == {seat: "Ada"}
    for nonsense in (None, [seat], [seat, True, True], ["other", True]):
        page._press("answer", nonsense, ada)
    assert started[0].code is None
    page._press("answer", [seat, True], ada)
    assert started[0].code == 0
    assert ada.note == "Spinning-v0 was ended for Ben, as you said yes."
    assert page.board.status[1]["jobs"][0]["why"] == "ended for Ben"
    assert page.board.status[1]["holders"] == page.board.status[1]["questions"] == {}
    monkeypatch.setattr(start_page, "_MAX_ROBOTS", 2)
    page._press("check ble", "Park-v0")
    page._press("drive", "Spinning-v0", ada)
    page._press("play", "Walker-v1", ben)
    room = "2 robots are at work already (somebody, Ada); end one of them, or ask for it"
    assert ben.note == room and len(started) == 3
    monkeypatch.setattr(start_page, "_MAX_ROBOTS", 6)
    page._press("check ble", "Park-v0", ben)
    assert ben.note == "somebody checks a hub; wait for its end, or ask for it"
    page._press("check usb", "Park-v0", ben)
    assert len(started) == 4, "another hub"
    page._press("play", "nothing", ben)
    assert ben.note.startswith("there is no environment 'nothing'; choose ")
    assert page.board.status[1]["message"] == ""
    page._press("fly", "Park-v0")
    assert page.board.status[1]["message"].startswith("there is no button 'fly'; choose play, ")
    page._press("end", 99)
    assert page.board.status[1]["message"] == ""


def test_play_whose_tabs_are_closed_says_why_it_ended(
    page: StartPage, started: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(start_page.time, "monotonic", lambda: now_s[0])
    ada = page.visitors.arrive("a", "Ada")
    page._press("play", "Walker-v1", ada)
    (job,) = page._jobs
    there = {"here": [], "asleep": False, "came": True}
    monkeypatch.setattr(start_page.Job, "visitors", lambda _job: there)
    page._end_deserted()
    assert job.empty_s is None, "it has no page yet"
    job.url = "http://127.0.0.1:9/?token=x"
    page._end_deserted()
    assert job.empty_s is None, "its owner is still at the start page"
    page.visitors.leave(ada, closed=True)
    for now_s[0], code in ((1001.0, None), (1006.0, None), (1006.1, 0)):
        page._end_deserted()
        assert started[0].code == code, now_s
    assert job.why == "ended, as all its tabs were closed"


def test_owner_who_is_at_the_robot_keeps_it(
    page: StartPage, started: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(start_page.time, "monotonic", lambda: now_s[0])
    ada = page.visitors.arrive("a", "Ada")
    page._press("play", "Walker-v1", ada)
    (job,) = page._jobs
    job.url = "http://127.0.0.1:9/?token=x"
    page.visitors.leave(ada, closed=True)
    there = {"here": [ada.key], "asleep": False, "came": True}
    monkeypatch.setattr(start_page.Job, "visitors", lambda _job: there)
    for now_s[0] in (1100.0, 1200.0):
        page._end_deserted()
        page._tick()
    assert ada.left_s == 1200.0 and started[0].code is None
    assert page.board.status[1]["holders"] == {"Walker-v1 (job 1)": "Ada"}


def test_folder_is_told_from_the_home_folder_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start_page.Path, "home", lambda: tmp_path)
    inner = tmp_path / "school" / "robots"
    inner.mkdir(parents=True)
    assert start_page._short(inner) == f"~/{Path('school/robots')}"
    monkeypatch.setattr(start_page.Path, "home", lambda: inner)
    assert start_page._short(tmp_path) == str(tmp_path.resolve())


def test_results_of_jobs_are_files_of_the_page(page: StartPage, tmp_path: Path) -> None:
    results = tmp_path / "results"
    results.mkdir()
    for name in ("3.png", "4.pdf"):
        (results / name).write_bytes(name.encode())
    page._results = results
    assert page.file("3.png") == ("image/png", b"3.png")
    assert page.file("4.pdf") == ("application/pdf", b"4.pdf")
    assert page.file("5.png") is None
    film = tmp_path / "runs" / "one" / "before_after.mp4"
    film.parent.mkdir(parents=True)
    assert page.file("runs/one/before_after.mp4") is None, "no run of ours"
    film.write_bytes(b"film")
    page._runs = lambda: [{"name": "one"}]  # type: ignore[method-assign]
    assert page.file("runs/one/before_after.mp4") == ("video/mp4", b"film")
    assert page.file("runs/one/report.html") is None, "not there yet"


def test_oldest_jobs_that_have_ended_are_left_out() -> None:
    class One:
        def __init__(self, letter: str) -> None:
            self.is_running = letter == "r"

    def jobs(running: str) -> list[Any]:
        return [One(letter) for letter in running]

    full = jobs("r" + "e" * 11)
    assert start_page.without_old(full) == full
    more = jobs("ere" + "r" * 11)
    assert start_page.without_old(more) == [more[1], *more[3:]], "12 are shown"
    one_more = jobs("ree" + "r" * 10)
    assert start_page.without_old(one_more) == [one_more[0], *one_more[2:]]


def test_address_of_a_job_s_page_is_read_from_its_lines() -> None:
    lines = ["making it\n", "live page: http://127.0.0.1:8091/?token=x\n", *["step \n"] * 70]
    process: Any = Process([])
    process.stdout = lines
    job = start_page.Job(3, "play", "Walker-v1", process)
    job.reader.join(10.0)
    assert job.url == "http://127.0.0.1:8091/?token=x"
    assert list(job.lines) == ["step"] * 60, "the last ones"
    assert job.described() == {
        "number": 3,
        "action": "play",
        "about": "Walker-v1",
        "url": job.url,
        "lines": ["step"] * 60,
        "code": None,
        "owner": "",
        "why": "",
    }


def test_visitors_of_a_job_are_asked_at_its_page(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    class Answer:
        def __enter__(self) -> Answer:
            return self

        def __exit__(self, *_: object) -> None:
            return None

        def read(self) -> bytes:
            return b'{"here": []}'

    def opened(address: str, timeout: float) -> Any:
        asked.append((address, timeout))
        return Answer()

    def refused(_address: str, timeout: float) -> Any:
        raise urllib.error.URLError(f"no answer in {timeout} s")

    job = start_page.Job(1, "play", "x", Process([]))  # type: ignore[arg-type]
    job.url = "http://127.0.0.1:8091/?token=x"
    ways: list[tuple[Callable[..., Any], dict[str, Any]]] = [(opened, {"here": []}), (refused, {})]
    for way, found in ways:
        monkeypatch.setattr(start_page, "_DIRECTLY", SimpleNamespace(open=way))
        assert job.visitors() == found
    assert asked == [("http://127.0.0.1:8091/visitors.json?token=x", 0.5)]


def test_command_is_started_in_a_group_of_its_own_with_its_input_to_end_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    started: list[Any] = []
    asked: list[tuple[str, ...]] = []

    def own_python(*words: str) -> tuple[list[str], dict[str, str]]:
        asked.append(words)
        return ["python", *words], {"HOME": "/home/ada"}

    monkeypatch.setattr(start_page, "own_python", own_python)
    monkeypatch.setattr(
        start_page.subprocess, "Popen", lambda command, **named: started.append((command, named))
    )
    start_page.launch(["play", "Walker-v1"], tmp_path)
    words = ("-u", "-m", "bricksrl.cli.job", "play", "Walker-v1")
    assert asked == [words]
    ((command, named),) = started
    assert command == ["python", *words]
    named.pop("creationflags")
    pipe = start_page.subprocess.PIPE
    assert named == {
        "cwd": tmp_path,
        "env": {"HOME": "/home/ada", "PYTHONIOENCODING": "utf-8"},
        "stdin": pipe,
        "stdout": pipe,
        "stderr": start_page.subprocess.STDOUT,
        "encoding": "utf-8",
        "errors": "replace",
        "start_new_session": True,
    }


class Deaf(Process):
    """A command that hears of no end, and notes how it is ended."""

    def __init__(self, log: list[Any], *, is_deaf: bool) -> None:
        super().__init__([])
        self.log = log
        self.pid = 7
        self.is_deaf = is_deaf
        self.stdin = SimpleNamespace(close=lambda: log.append("input ends"))

    def wait(self, timeout: float | None = None) -> None:
        self.log.append("wait" if timeout is None else ("wait", timeout))
        if timeout is not None and self.is_deaf:
            raise start_page.subprocess.TimeoutExpired("x", timeout)

    def kill(self) -> None:
        self.log.append("kill")


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="groups of processes are of POSIX")
@pytest.mark.parametrize("is_deaf", [False, True])
def test_command_that_does_not_end_in_time_is_killed_with_its_group(
    monkeypatch: pytest.MonkeyPatch, is_deaf: bool
) -> None:
    log: list[Any] = []
    monkeypatch.setattr(start_page.time, "monotonic", lambda: 100.0)
    monkeypatch.setattr(start_page, "kill_frozen", lambda pid: log.append(("frozen", pid)))
    monkeypatch.setattr(start_page.os, "killpg", lambda *about: log.append(("group", *about)))
    job = start_page.Job(1, "play", "x", Deaf(log, is_deaf=is_deaf))  # type: ignore[arg-type]
    job.ask_to_end()
    job.end_by(102.5)
    killed = [("frozen", 7), "kill", "wait"] if is_deaf else []
    group = ("group", 7, start_page.signal.SIGKILL)
    assert log == ["input ends", ("wait", 2.5), *killed, group]
    log.clear()
    job.end_by(90.0)
    assert log[0] == ("wait", 0.0), "what is late waits no more"
