"""Jobs of the start page, of several visitors, without a browser. A job is a process that ends when
its input does."""

from __future__ import annotations

import asyncio
import json
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
from bricksrl.page.visitors import Visitor, Visitors
from bricksrl.training.callbacks import Episode, Phase
from bricksrl.training.config import TrainConfig
from bricksrl.training.run_folder import RunFolder

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


def test_all_jobs_are_asked_to_end_before_one_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = []

    class Ending:
        def __init__(self, number: int) -> None:
            self.number = number

        def ask_to_end(self) -> None:
            done.append((self.number, "asked"))

        def end_by(self, deadline_s: float) -> None:
            done.append((self.number, deadline_s))

    monkeypatch.setattr(start_page.time, "monotonic", lambda: 100.0)
    start_page.end_jobs([Ending(1), Ending(2)], 3.0)  # type: ignore[list-item]
    assert done == [(1, "asked"), (2, "asked"), (1, 103.0), (2, 103.0)]


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


@pytest.mark.parametrize(
    ("action", "value"),
    [
        ("train", "my_task.py"),
        ("play", "runs/x"),
        ("watch", "../x"),
        ("compare", ["x"]),
        ("booklet", "/etc/passwd"),
        ("look", "/etc/passwd"),
        ("teach", "rover.ldr:walk"),
        ("check ble:X", "RunAway-v0"),
        ("check ble", None),
        ("drive", {"a": 1}),
        ("game", 3),
        ("shout", "Tag-v0"),
    ],
)
def test_values_that_the_page_does_not_know_start_nothing(
    action: str, value: object, tmp_path: Path
) -> None:
    def launch(*_: object) -> object:
        raise AssertionError("something was started")

    page = StartPage(tmp_path, launch=launch)
    page._press(action, value)
    status = page.board.status[1]
    assert status["message"] and not status["jobs"]
    page.close()


def test_each_environment_has_a_picture(tmp_path: Path) -> None:
    page = StartPage(tmp_path)
    for card in page.board.status[1]["cards"]:
        kind, data = page.file(f"{card['env']}.jpg")
        assert kind == "image/jpeg" and 3_000 < len(data) < 60_000
    plans = set(page.board.status[1]["plans"])
    assert plans == {"two-wheeler", "ev3-driver", "walker", "robo-arm"}
    # The repository has the booklets of all of them, which open without being drawn.
    assert set(page.board.status[1]["booklets"]) == plans
    kind, data = page.file("booklets/walker.pdf")
    assert kind == "application/pdf" and data.startswith(b"%PDF-")
    assert page.file("booklets/../walker.pdf") is None and page.file("walker.pdf") is None
    assert page.file("../start.py") is None and page.file("") == page.file("start.html")
    page.close()


def test_pupil_has_name_report_and_class_table(tmp_path: Path) -> None:
    """What is typed is one word of the command, whatever it is."""
    started = list[Sequence[str]]()

    def launch(words: Sequence[str], folder: Path) -> object:
        started.append(words)
        return subprocess.Popen([sys.executable, "-c", ""], stdout=subprocess.PIPE, text=True)

    page = StartPage(tmp_path, launch=launch)
    visitors = Visitors()
    for number, name in enumerate(("Anna", "--episodes 9", "x" * 41, "a\nb", "")):
        page._press("train", "RunAway-v0", visitors.arrive(f"browser {number}", name))
    names = [words[-1] for words in started if words[-1].startswith("--name")]
    assert names == ["--name=Anna", "--name=--episodes 9", "--name=" + "x" * 24, "--name=a b"]
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    folder = RunFolder(run)
    folder.write_config(TrainConfig(env="RunAway-v0", name="Anna"))
    folder.write_episodes([Episode(1, Phase.TRAIN, 10, 10, 13.3, None)])
    (run / "report.html").write_text("a report")
    scores = {
        "return_mean": 20.0,
        "return_std": 0.0,
        "episodes": 5,
        "trained_episodes": 1,
        "as_trained": True,
    }
    folder.evaluation_path.write_text(json.dumps(scores))
    page._press("class", "runs")
    assert started[-1] == ["compare", "--class", "runs"]
    (shown,) = page.board.status[1]["runs"]
    assert (shown["pupil"], shown["return"], shown["score"], shown["has_report"]) == (
        "Anna",
        20.0,
        "evaluation",
        True,
    )
    assert page.file("runs/one/report.html") == ("text/html; charset=utf-8", b"a report")
    for name in (
        "runs/one/config.json",
        "runs/../report.html",
        "runs/one/../one/report.html",
        "runs/two/report.html",
    ):
        assert page.file(name) is None
    page.close()


def test_job_is_described_with_its_end(page: StartPage, people: tuple[Visitor, Visitor]) -> None:
    ada, ben = people
    page._press("drive", "Spinning-v0", ada)
    page._press("train", "RunAway-v0")
    training, drive = page.board.status[1]["jobs"]
    assert (drive["number"], drive["action"], drive["about"]) == (1, "drive", "Spinning-v0")
    assert (drive["owner"], drive["code"], drive["why"]) == ("Ada", None, "")
    assert (training["number"], training["owner"], training["lines"]) == (2, "", [])
    page._press("end", 1, ada)
    assert page.board.status[1]["jobs"][1]["why"] == "", "one's own end needs no reason"
    page.visitors.leave(ada, closed=True)
    page._press("end", 2, ben)
    (training, drive) = page.board.status[1]["jobs"]
    assert (drive["code"], training["code"]) == (0, 0) and training["why"] == ""
    page._press("drive", "Spinning-v0", ada)
    ada.left_s -= 100.0
    page._press("end", 3, ben)
    assert page.board.status[1]["jobs"][0]["why"] == "ended by Ben"


def test_command_has_page_seed_and_file_as_its_action_needs(tmp_path: Path) -> None:
    started = list[Sequence[str]]()

    def note(words: Sequence[str], folder: Path) -> object:
        assert folder == tmp_path
        started.append(words)
        return subprocess.Popen([sys.executable, "-c", ""], stdout=subprocess.PIPE, text=True)

    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    RunFolder(run).write_config(TrainConfig(env="RunAway-v0"))
    RunFolder(run).write_episodes([])
    page = StartPage(tmp_path, launch=note)
    for action, value in (
        ("train", "RunAway-v0"),
        ("train", "Spinning-v0"),
        ("watch", "one"),
        ("compare", ["one"]),
        ("booklet", "walker"),
        ("check usb", "RunAway-v0"),
        ("game", "Tag-v0"),
    ):
        page._press(action, value)
        assert not page.board.status[1]["message"]
    host = ["--page-host", "127.0.0.1"]
    assert started == [
        ["train", "RunAway-v0", "--page", *host, "--seed", "1"],
        ["train", "Spinning-v0", "--page", *host, "--seed", "0"],
        ["play", "runs/one", "--page", *host],
        ["compare", "runs/one", "--out", "None/4.png"],
        ["plan", "steps", "walker", "--out", "None/5.pdf"],
        ["hub", "check", "RunAway-v0", "--hub", "usb", "--yes"],
        ["team", "Tag-v0", "--page", *host],
    ]
    page.close()


def test_runs_show_their_curve_and_what_is_to_be_trusted(tmp_path: Path) -> None:
    page = StartPage(tmp_path, launch=launch)
    for name, count in (("short", 7), ("long", 130), ("new", 0)):
        folder = RunFolder(tmp_path / "runs" / name)
        folder.path.mkdir(parents=True)
        folder.write_config(TrainConfig(env="RunAway-v0", seed=3))
        folder.write_episodes(
            [Episode(n, Phase.TRAIN, n, 1, float(n), None) for n in range(1, count + 1)]
        )
        os.utime(folder.config_path, (count + 1, count + 1))
    strange = tmp_path / "runs" / "a friend's"
    strange.mkdir()
    config = {**TrainConfig(env="RunAway-v0").to_dict(), "env": "their_task.py"}
    text = json.dumps({"bricksrl_run": 1, "config": config})
    (strange / "config.json").write_text(text)
    page._tick()
    status = page.board.status[1]
    (untrusted,) = status["untrusted"]
    assert untrusted["name"] == "a friend's" and untrusted["allow"].startswith("bricksrl trust ")
    long, short, new = status["runs"]
    assert [run["name"] for run in (long, short, new)] == ["long", "short", "new"], "latest first"
    assert short["points"] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert short["return"] == 5.0 and short["score"] == "mean of the last 5 episodes"
    assert (short["env"], short["agent"], short["seed"]) == ("RunAway-v0", "sac", 3)
    assert long["points"][:3] == [1.0, 4.0, 7.0] and (long["episodes"], long["return"]) == (
        130,
        128.0,
    )
    assert (new["points"], new["return"], new["has_report"], new["has_film"]) == (
        [],
        None,
        False,
        False,
    )
    page.close()
