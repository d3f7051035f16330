"""What a page answers: its requests, what a browser sends, and the commands of the start page."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import queue
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bricksrl.errors import PageError
from bricksrl.page import program as programs
from bricksrl.page import server as servers
from bricksrl.page import start as start_page
from bricksrl.page.board import Board
from bricksrl.page.program import ProgramPage, Told
from bricksrl.page.server import PageOptions, PageServer
from bricksrl.page.start import ACTIONS, StartPage
from bricksrl.page.visitors import Visitor

TOKEN = "secret"  # noqa: S105  of this test alone


def page_of(host: str = "127.0.0.1:8090") -> PageServer:
    """A page that is not served."""
    page = PageServer(Board(), lambda *_: None, lambda: None)
    page._guard = servers.Guard(TOKEN, int(host.rpartition(":")[2]))
    return page


def answered(page: PageServer, path: str, **headers: str) -> tuple[int, Headers, bytes]:
    """Status, headers and content of an answer."""
    given = {"Host": "127.0.0.1:8090", "Cookie": f"bricksrl_8090={TOKEN}", **headers}
    request: Any = SimpleNamespace(path=path, headers=given)
    response = SimpleNamespace(headers=Headers({"Content-Type": "x", "Content-Length": "0"}))

    def respond(status: int, _text: str) -> Any:
        response.status = status
        return response

    connection: Any = SimpleNamespace(respond=respond)
    found: Any = page._answer(connection, request)
    return found.status, found.headers, found.body


def test_each_answer_is_kept_from_other_pages_and_from_memory() -> None:
    for path in ("/", "/page.js", "/visitors.json", "/nothing.js"):
        _, headers, content = answered(page_of(), path)
        assert headers["Cache-Control"] == "no-store"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Content-Security-Policy"] == (
            "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        )
        # One of each, in place of those that the library gives.
        assert headers.get_all("Content-Length") == [f"{len(content)}"]
        assert len(headers.get_all("Content-Type")) == 1


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/", "text/html; charset=utf-8"),
        ("/page.css", "text/css; charset=utf-8"),
        ("/page.js", "text/javascript; charset=utf-8"),
        ("/icon.svg", "image/svg+xml; charset=utf-8"),
        ("/RunAway-v0.jpg", "image/jpeg"),
        ("/scene3d.js", "text/javascript; charset=utf-8"),
        ("/visitors.json", "application/json"),
        ("/drawing.json", "application/json"),
    ],
)
def test_files_of_the_page_and_of_its_view_have_their_types(path: str, kind: str) -> None:
    status, headers, _ = answered(page_of(), path)
    assert (status, headers["Content-Type"]) == (200, kind)


def test_who_has_no_token_is_told_so_as_text() -> None:
    status, headers, content = answered(page_of(), "/", Cookie="")
    assert status == 403 and headers["Content-Type"] == "text/plain"
    text = b"this page needs its token; open the address that the terminal shows\n"
    assert content == text and "Set-Cookie" not in headers
    status, headers, content = answered(page_of(), "/nothing.js")
    assert (status, headers["Content-Type"]) == (404, "text/plain")


def test_a_report_runs_nothing_and_shows_what_is_inside_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = page_of()
    monkeypatch.setattr(page, "file", lambda _name: ("text/html", b"a report"))
    policies = {}
    for path in ("/runs/one/report.html", "/report.htm", "/runs/one/before_after.mp4"):
        policies[path] = answered(page, path)[1]["Content-Security-Policy"]
    assert policies["/runs/one/report.html"] == (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:; "
        "frame-ancestors 'none'"
    )
    assert policies["/report.htm"].startswith("default-src 'self'")
    assert policies["/runs/one/before_after.mp4"].startswith("default-src 'self'")


def test_browser_gets_a_secret_once_and_the_token_with_each_page() -> None:
    token = f"bricksrl_8090={TOKEN}; HttpOnly; SameSite=Strict; Path=/"
    _, headers, _ = answered(page_of(), "/")
    first, secret = headers.get_all("Set-Cookie")
    assert first == token
    name, _, rest = secret.partition("=")
    value, _, kept = rest.partition("; ")
    assert (name, kept) == (
        "bricksrl_visitor",
        "HttpOnly; SameSite=Strict; Path=/; Max-Age=31536000",
    )
    assert len(value) == 24, "18 bytes in Base64"
    known = f"bricksrl_8090={TOKEN}; bricksrl_visitor=known"
    _, headers, _ = answered(page_of(), "/", Cookie=known)
    assert headers.get_all("Set-Cookie") == [token]
    _, headers, _ = answered(page_of(), "/page.js")
    assert headers.get_all("Set-Cookie") == []


def test_a_socket_is_opened_to_who_comes_from_this_page() -> None:
    page = page_of()
    request: Any = SimpleNamespace(
        path="/ws",
        headers={
            "Host": "127.0.0.1:8090",
            "Cookie": f"bricksrl_8090={TOKEN}",
            "Origin": "http://127.0.0.1:8090",
        },
    )
    assert page._answer(SimpleNamespace(), request) is None  # type: ignore[arg-type]
    status, _, _ = answered(page, "/ws")
    assert status == 403, "without an origin it is no page of ours"


def test_cookies_are_read_as_browsers_write_them() -> None:
    text = ' a = "1" ;b=2;a=3; c; d==; ="x"'
    found = servers.cookies({"Cookie": text})
    assert found == {"a": ["1", "3"], "b": ["2"], "d": ["="], "": ["x"]}
    assert servers.cookies({}) == {}


# ---------------------------------------------------------------- what a browser sends


class Browser:
    """A connection, which notes what it is sent."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    async def send(self, message: str) -> None:
        self.sent.append(json.loads(message))


def received(page: PageServer, visitor: Visitor, **message: Any) -> list[Any]:
    """What the page sends at once in answer to a message."""
    browser = Browser()
    asyncio.run(page._receive(browser, json.dumps(message), visitor))  # type: ignore[arg-type]
    return browser.sent


def presses(page: PageServer) -> list[tuple[Any, ...]]:
    found = []
    while True:
        try:
            found.append(page._presses.get_nowait())
        except queue.Empty:
            return found


def test_questions_of_a_browser_are_answered_at_once() -> None:
    page = page_of()
    ada = page.visitors.arrive("a", "Ada")
    assert received(page, ada, press="ping", value=17) == [{"pong": 17}]
    for nonsense in ("x", None, [1], float("nan")):
        assert received(page, ada, press="ping", value=nonsense) == [{"pong": 0}]
    assert presses(page) == []


def test_presses_are_handled_one_after_the_other_and_a_stop_beside_them() -> None:
    stopped = []
    page = PageServer(Board(), lambda *_: None, lambda: stopped.append("stop"))
    ada = page.visitors.arrive("a", "Ada")
    assert received(page, ada, press="pause") == []
    assert received(page, ada, press="speed", value="10x") == []
    for nonsense in (3, None, ["stop"]):
        assert received(page, ada, press=nonsense) == []
    assert presses(page) == [("pause", None, ada), ("speed", "10x", ada)]
    assert received(page, ada, press="stop", value=4) == [{"heard": 4}]
    for _ in range(500):
        if page.board.status[1].get("stop", {}).get("state") == "confirmed":
            break
        asyncio.run(asyncio.sleep(0.01))
    assert stopped == ["stop"] and presses(page) == []
    assert page.board.status[1]["stop"]["by"] == "Ada"


def test_name_of_a_visitor_is_shown_to_all() -> None:
    page = page_of()
    ada = page.visitors.arrive("a", "")
    page.visitors.arrive("b", "Ben")
    assert received(page, ada, press="name", value="Ada") == []
    assert ada.name == "Ada" and page.board.status[1]["visitors"] == ["Ada", "Ben"]
    assert presses(page) == [("renamed", None, ada)]


@pytest.mark.parametrize(
    ("host", "url", "is_open"),
    [
        ("127.0.0.1", "http://127.0.0.1:{}/", False),
        ("localhost", "http://127.0.0.1:{}/", False),
        ("0.0.0.0", "http://192.0.2.7:{}/", True),  # noqa: S104  nobody listens
        ("::1", "http://[::1]:{}/", False),
    ],
)
def test_address_of_a_page_is_one_that_can_be_opened(
    monkeypatch: pytest.MonkeyPatch, host: str, url: str, is_open: bool
) -> None:
    numbers = {"localhost": "127.0.0.1"}
    listening = SimpleNamespace(getsockname=lambda: (numbers.get(host, host), 4321, 0, 0))
    monkeypatch.setattr(servers, "_listen", lambda _options: listening)
    monkeypatch.setattr(servers, "_own_address", lambda: "192.0.2.7")
    page = PageServer(Board(), lambda *_: None, lambda: None, PageOptions(host))
    monkeypatch.setattr(page, "_start", lambda *_: None)
    page._ready.set()
    page.__enter__()
    assert page.url == f"{url.format(4321)}?token={page._guard.token}"
    assert (page._guard.port, page._guard.is_open) == (4321, is_open)
    assert len(page._guard.token) == 24


def test_page_that_does_not_start_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servers, "_START_TIMEOUT_S", 0.0)
    listening = SimpleNamespace(getsockname=lambda: ("127.0.0.1", 4321))
    monkeypatch.setattr(servers, "_listen", lambda _options: listening)
    page = PageServer(Board(), lambda *_: None, lambda: None)
    monkeypatch.setattr(page, "_start", lambda *_: None)
    with pytest.raises(PageError, match="^the live page did not start in time; try again$"):
        page.__enter__()


def test_computer_without_a_network_is_known_to_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    class Probe:
        def __init__(self, *_: Any) -> None:
            self.asked: Any = None

        def __enter__(self) -> Probe:
            return self

        def __exit__(self, *_: object) -> None:
            return None

        def connect(self, place: Any) -> None:
            if place is None:
                raise OSError("no network")
            self.asked = place

        def getsockname(self) -> tuple[str, int]:
            return "192.168.1.5", 9

    class Offline(Probe):
        def connect(self, place: Any) -> None:
            super().connect(None)

    for probe, address in ((Probe, "192.168.1.5"), (Offline, "127.0.0.1")):
        monkeypatch.setattr(servers.socket, "socket", probe)
        assert servers._own_address() == address


# ---------------------------------------------------------------- a whole connection


def connected(page: PageServer, secret: str, name: str = "") -> ClientConnection:
    """A tab of a browser, which comes from this page."""
    host = page.url.split("/")[2]
    known = [f"{page._guard.cookie}={page._guard.token}", f"bricksrl_visitor={secret}"]
    if name:
        known.append(f"bricksrl_name={name}")
    return connect(
        f"ws://{host}/ws",
        origin=f"http://{host}",
        additional_headers={"Cookie": "; ".join(known)},
        proxy=None,
    )


def said(tab: ClientConnection, key: str) -> Any:
    """The next message about something."""
    while True:
        message = json.loads(tab.recv(timeout=20.0))
        if key in message:
            return message[key]


def until(condition: Callable[[], bool]) -> None:
    for _ in range(2000):
        if condition():
            return
        asyncio.run(asyncio.sleep(0.01))
    raise AssertionError("it does not come")


def test_tab_of_a_browser_comes_and_goes() -> None:
    pressed: list[tuple[str, str]] = []

    def press(name: str, _value: Any, visitor: Visitor | None) -> None:
        pressed.append((name, "" if visitor is None else visitor.name))

    with PageServer(Board(), press, lambda: None) as page:
        with connected(page, "a", "Ada%20L.") as ada:
            assert said(ada, "you") == {"name": "Ada L.", "note": ""}
            until(lambda: page.board.status[1].get("visitors") == ["Ada L."])
            assert page.is_watched
            ada.send(json.dumps({"press": "ping", "value": 5}))
            assert said(ada, "pong") == 5
            (visitor,) = page.visitors.here()
            visitor.note = "Ben asks for it."
            assert said(ada, "you")["note"] == "Ben asks for it."
            with connected(page, "b") as other:
                assert said(other, "you")["name"] == "Visitor 2"
            ada.close(1001)
        until(lambda: not page.is_watched)
        # A tab that is closed says so; a phone that sleeps does not.
        asleep = [one.is_asleep for one in page.visitors._known.values()]
        assert asleep == [False, True]
        until(lambda: ("left", "Ada L.") in pressed)
        assert pressed[0] == ("arrived", "Ada L.")
        assert ("arrived", "Visitor 2") in pressed and ("left", "Visitor 2") in pressed
        until(lambda: page.board.status[1]["visitors"] == [])


def test_page_that_ends_tells_its_last_news_and_goodbye() -> None:
    with PageServer(Board(), lambda *_: None, lambda: None) as page:
        with connected(page, "a") as tab:
            said(tab, "status")
            page.board.update_status(state="finished")
            page.close()
            assert said(tab, "status")["state"] == "finished"
            with pytest.raises(ConnectionClosed) as caught:
                said(tab, "nothing")
        assert caught.value.rcvd is not None
        assert (caught.value.rcvd.code, caught.value.rcvd.reason) == (1001, "the run has ended")


def test_message_that_is_too_long_ends_its_connection_alone() -> None:
    with (
        PageServer(Board(), lambda *_: None, lambda: None) as page,
        connected(page, "a") as tab,
        connected(page, "b") as other,
    ):
        tab.send(json.dumps({"press": "ping", "value": 1}).ljust(4096))
        assert said(tab, "pong") == 1
        tab.send(" " * 4097)
        with pytest.raises(ConnectionClosed) as caught:
            said(tab, "nothing")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1009
        other.send(json.dumps({"press": "ping", "value": 2}))
        assert said(other, "pong") == 2


def test_browser_that_does_not_answer_for_8_seconds_is_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = page_of()
    made: list[Any] = []

    class Served:
        connections = ()

        async def __aenter__(self) -> Served:
            assert page._ready.is_set() is False
            page._closing.set()  # type: ignore[union-attr]
            return self

        async def __aexit__(self, *_: object) -> None:
            return None

    def serve(handler: Any, **named: Any) -> Served:
        made.append((handler, named))
        return Served()

    monkeypatch.setattr("websockets.asyncio.server.serve", serve)
    asyncio.run(page._serve("a socket"))  # type: ignore[arg-type]
    ((handler, named),) = made
    assert handler == page._serve_browser and page._ready.is_set()
    logger = named.pop("logger")
    assert not logger.isEnabledFor(logging.ERROR), "refused requests are not our errors"
    assert named == {
        "sock": "a socket",
        "process_request": page._answer,
        "compression": None,
        "max_size": 4096,
        "close_timeout": 0.5,
        "ping_interval": 2.0,
        "ping_timeout": 8.0,
    }


# ---------------------------------------------------------------- programs


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


# ---------------------------------------------------------------- the start page


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
