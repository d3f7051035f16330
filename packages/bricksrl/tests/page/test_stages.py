"""Jobs of the start page, of several visitors, without a browser. A job is a process that ends when
its input does."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from bricksrl.page import start as start_page
from bricksrl.page.board import Board
from bricksrl.page.server import PageServer
from bricksrl.page.start import StartPage
from bricksrl.page.visitors import Visitor

pytestmark = pytest.mark.skipif(os.name != "posix", reason="cat is a program of POSIX")


def launch(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


@pytest.fixture
def page(tmp_path: Path) -> Iterator[StartPage]:
    page = StartPage(tmp_path, launch=launch)
    yield page
    page.close()
    assert not any(job.is_running for job in page._jobs)


@pytest.fixture
def people(page: StartPage) -> tuple[Visitor, Visitor]:
    return page.visitors.arrive("a", "Ada"), page.visitors.arrive("b", "Ben")


def running(page: StartPage) -> list[tuple[str, str]]:
    return [
        (job["about"], job["owner"]) for job in page.board.status[1]["jobs"] if job["code"] is None
    ]


def test_each_visitor_has_a_robot_of_its_own(
    page: StartPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    page._press("drive", "Spinning-v0", ada)
    page._press("play", "Walker-v1", ben)
    assert running(page) == [("Walker-v1", "Ben"), ("Spinning-v0", "Ada")]
    page._press("play", "Park-v0", ada)
    assert running(page) == [("Park-v0", "Ada"), ("Walker-v1", "Ben")], "one's own robot makes room"
    assert {*page.board.status[1]["holders"].values()} == {"Ada", "Ben"}


def test_owner_is_asked_before_a_robot_is_ended(
    page: StartPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    page._press("drive", "Spinning-v0", ada)
    number = page._jobs[0].number
    page._press("end", number, ben)
    (question,) = page.board.status[1]["questions"].items()
    assert running(page) and question[1] == "Ben"
    page._press("answer", [question[0], True], ben)
    assert running(page), "it is not for Ben to say"
    page._press("answer", [question[0], False], ada)
    assert running(page) and ben.note == "Ada says no."
    page._press("end", number, ben)
    page._press("answer", [question[0], True], ada)
    assert not running(page) and "Ben" in ada.note
    assert page.board.status[1]["jobs"][0]["why"] == "ended for Ben"


def test_robot_of_somebody_who_left_needs_no_question(
    page: StartPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    page._press("train", "RunAway-v0", ada)
    page.visitors.leave(ada, closed=True)
    ada.left_s -= 100.0
    page._press("end", page._jobs[0].number, ben)
    assert not running(page)


@pytest.mark.parametrize("is_frozen", [False, True])
def test_owner_who_is_at_the_robot_is_asked(
    page: StartPage,
    people: tuple[Visitor, Visitor],
    monkeypatch: pytest.MonkeyPatch,
    is_frozen: bool,
) -> None:
    """Also if the robot's page does not tell for a while."""
    ada, ben = people
    page._press("drive", "Spinning-v0", ada)
    page._jobs[0].url = "http://127.0.0.1:9/?token=x"
    there = {} if is_frozen else {"here": [ada.key], "asleep": False, "came": True}
    monkeypatch.setattr(start_page.Job, "visitors", lambda _job: there)
    page.visitors.leave(ada, closed=True)
    ada.left_s -= 100.0
    page._tick()
    page._end_deserted()
    page._press("end", page._jobs[0].number, ben)
    assert running(page) and page.board.status[1]["questions"]


def test_there_is_no_room_for_more_robots_than_are_allowed(
    page: StartPage, people: tuple[Visitor, Visitor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start_page, "_MAX_ROBOTS", 1)
    ada, ben = people
    page._press("drive", "Spinning-v0", ada)
    page._press("drive", "Spinning-v0", ben)
    assert len(running(page)) == 1 and "Ada" in ben.note and not ada.note


def test_one_visitor_at_a_time_checks_a_real_hub(
    page: StartPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    page._press("check ble", "RunAway-v0", ada)
    page._press("check ble", "RunAway-v0", ben)
    assert len(running(page)) == 1 and "Ada checks a hub" in ben.note
    page._press("check virtual", "RunAway-v0", ben)
    assert len(running(page)) == 2


def test_job_that_runs_is_never_dropped(page: StartPage) -> None:
    page._press("train", "RunAway-v0")
    first = page._jobs[0]
    for _ in range(start_page._MAX_JOBS + 3):
        page._press("drive", "Spinning-v0")
    assert first in page._jobs and len(page._jobs) == start_page._MAX_JOBS
    for _ in range(start_page._MAX_JOBS + 1):
        page._press("train", "RunAway-v0")
    assert len(page._jobs) == sum(job.is_running for job in page._jobs) == start_page._MAX_JOBS + 3


def test_deaf_jobs_end_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start_page, "_CLOSE_S", 0.5)
    page = StartPage(
        tmp_path,
        launch=lambda *_: subprocess.Popen(
            [sys.executable, "-c", "import time; time.sleep(99)"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ),
    )
    for _ in range(4):
        page._press("train", "RunAway-v0")
    start_s = time.monotonic()
    page.close()
    assert not any(job.is_running for job in page._jobs) and time.monotonic() - start_s < 1.9


def test_what_a_job_leaves_ends_with_it(tmp_path: Path) -> None:
    """A process of its group that is frozen hears of no end."""
    script = (
        "import subprocess, sys; print(subprocess.Popen(['sleep', '99']).pid, flush=True); "
        "sys.stdin.read()"
    )
    page = StartPage(
        tmp_path,
        launch=lambda *_: subprocess.Popen(
            [sys.executable, "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ),
    )
    page._press("train", "RunAway-v0")
    limit_s = time.monotonic() + 30.0
    while not page._jobs[0].lines:
        assert time.monotonic() < limit_s
        time.sleep(0.01)
    left = int(page._jobs[0].lines[0])
    os.kill(left, signal.SIGSTOP)
    page.close()
    while Path(f"/proc/{left}").exists() and " Z " not in Path(f"/proc/{left}/stat").read_text():
        assert time.monotonic() < limit_s
        time.sleep(0.01)


@pytest.mark.parametrize(("is_asleep", "ends_after_s"), [(False, 5.1), (True, 120.1)])
def test_play_ends_when_all_its_tabs_are_closed(
    page: StartPage,
    people: tuple[Visitor, Visitor],
    monkeypatch: pytest.MonkeyPatch,
    is_asleep: bool,
    ends_after_s: float,
) -> None:
    ada, _ = people
    for action, name in (("train", "RunAway-v0"), ("play", "Walker-v1")):
        page._press(action, name, ada)
    training, play = page._jobs
    training.url = play.url = "http://127.0.0.1:9/?token=x"
    there: dict[str, object] = {"here": ["somebody"], "asleep": False, "came": True}
    monkeypatch.setattr(start_page.Job, "visitors", lambda _job: there)
    now_s = [time.monotonic()]
    monkeypatch.setattr(start_page.time, "monotonic", lambda: now_s[0])
    page.visitors.leave(ada, closed=not is_asleep)
    page._end_deserted()
    there["here"] = []
    page._end_deserted()
    now_s[0] += ends_after_s - 0.2
    page._end_deserted()
    assert play.is_running
    now_s[0] += 0.3
    page._end_deserted()
    assert not play.is_running and "closed" in play.why and training.is_running


@pytest.mark.parametrize(("came", "ends_after_s"), [(True, 5.1), (False, 120.1)])
def test_tab_that_was_closed_at_once_ends_its_play_too(
    page: StartPage,
    people: tuple[Visitor, Visitor],
    monkeypatch: pytest.MonkeyPatch,
    came: bool,
    ends_after_s: float,
) -> None:
    """Between two looks at the play's page: it is not one that is still loading."""
    ada, _ = people
    page._press("play", "Walker-v1", ada)
    (play,) = page._jobs
    play.url = "http://127.0.0.1:9/?token=x"
    there = {"here": [], "asleep": False, "came": came}
    monkeypatch.setattr(start_page.Job, "visitors", lambda _job: there)
    now_s = [time.monotonic()]
    monkeypatch.setattr(start_page.time, "monotonic", lambda: now_s[0])
    page.visitors.leave(ada, closed=True)
    page._end_deserted()
    now_s[0] += ends_after_s - 0.2
    page._end_deserted()
    assert play.is_running
    now_s[0] += 0.3
    page._end_deserted()
    assert not play.is_running


def test_run_that_vanishes_does_not_end_the_refreshing(
    page: StartPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "runs" / "gone"
    run.mkdir(parents=True)
    (run / "config.json").symlink_to(tmp_path / "nowhere")
    assert page._runs() == []
    monkeypatch.setattr(start_page, "_REFRESH_S", 0.01)
    asked = []

    def fail() -> list[object]:
        asked.append(1)
        if len(asked) > 2:
            page._ended.set()
        raise OSError("gone")

    monkeypatch.setattr(page, "_runs_and_untrusted", fail)
    page._refresh()
    assert len(asked) == 3
    monkeypatch.undo()


def test_lines_of_a_job_are_read_whatever_is_in_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has an encoding of each country; what a library says may have any."""
    say = (
        "import os, sys; print('4 \\u00b1 1 \\u2192', flush=True); os.write(1, b'\\x81\\xff\\n'); "
        "print('end', flush=True); sys.stdin.read()"
    )
    monkeypatch.setattr(
        start_page,
        "own_python",
        lambda *_: (
            [sys.executable, "-c", say],
            {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        ),
    )
    page = StartPage(tmp_path)
    page._press("train", "RunAway-v0")
    (job,) = page._jobs
    limit_s = time.monotonic() + 30.0
    while len(job.lines) < 3 and time.monotonic() < limit_s:
        time.sleep(0.01)
    page.close()
    assert [job.lines[0], job.lines[2]] == ["4 \u00b1 1 \u2192", "end"]


def test_page_of_this_computer_is_asked_without_the_proxy(
    page: StartPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A school's, which would also learn its token."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    page._press("drive", "Spinning-v0")
    with PageServer(Board(), lambda *_: None, lambda: None) as other:
        page._jobs[0].url = other.url
        assert page._jobs[0].visitors() == {"here": [], "asleep": False, "came": False}
        other.visitors.leave(other.visitors.arrive("a", "Ada"), closed=True)
        assert page._jobs[0].visitors() == {"here": [], "asleep": False, "came": True}


@pytest.mark.parametrize(
    ("error", "is_told"), [(ConnectionResetError(), False), (RuntimeError("a bug"), True)]
)
def test_browser_that_is_gone_is_no_error(
    caplog: pytest.LogCaptureFixture, error: Exception, is_told: bool
) -> None:
    """The event loop of Windows tells of each."""
    with PageServer(Board(), lambda *_: None, lambda: None) as page:
        loop = page._loop
        assert loop is not None
        told = asyncio.run_coroutine_threadsafe(called(loop, error), loop)
        told.result(10)
    assert bool(caplog.records) is is_told


async def called(loop: asyncio.AbstractEventLoop, error: Exception) -> None:
    loop.call_exception_handler({"message": "a callback failed", "exception": error})
