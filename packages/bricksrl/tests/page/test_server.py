"""Server of the page: its files, its presses and its emergency stop, without a browser."""

from __future__ import annotations

import asyncio
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.errors import HubError
from bricksrl.page import server as servers
from bricksrl.page.board import Board
from bricksrl.page.server import PageServer, chosen, is_finite
from bricksrl.page.visitors import Visitor
from bricktwin.view.drawing_of_body import Drawing, DrawnBody, Shape, box, poses

Press = tuple[str, Any, str]


@pytest.fixture(scope="module")
def presses() -> list[Press]:
    return []


@pytest.fixture(scope="module")
def page(presses: list[Press]) -> Iterator[PageServer]:
    """A page that notes its presses."""

    def press(name: str, value: Any, visitor: Visitor | None) -> None:
        presses.append((name, value, "" if visitor is None else visitor.name))

    with PageServer(Board(), press, lambda: None) as served:
        yield served


def fetched(page: PageServer, path: str) -> tuple[int, Any, bytes]:
    """Status, headers and content of what a browser asks for."""
    address = page.url.replace("/?", f"/{path}?")
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(address, timeout=5.0) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def test_files_have_their_types_and_nothing_else_is_there(page: PageServer) -> None:
    status, headers, content = fetched(page, "")
    assert status == 200 and headers["Content-Type"] == "text/html; charset=utf-8"
    assert b"<html" in content and int(headers["Content-Length"]) == len(content)
    assert headers["X-Frame-Options"] == "DENY" and "frame-ancestors" in str(
        headers["Content-Security-Policy"]
    )
    cookies = headers.get_all("Set-Cookie")
    assert len(cookies) == 2 and all("HttpOnly; SameSite=Strict" in one for one in cookies)
    for path in ("server.py", "../server.py", "nothing.js"):
        status, headers, content = fetched(page, path)
        assert (status, content) == (404, b"there is no such file here\n")
        assert headers.get_all("Set-Cookie") is None
    assert page.file("") == page.file("index.html") != None  # noqa: E711
    found = page.file("index.html")
    assert found is not None and found[1].lstrip()[:9].lower() == b"<!doctype"


def test_drawing_is_told_anew_when_it_changes(page: PageServer) -> None:
    for name in ("cube", "other"):
        shape = Shape(box((1.0, 1.0, 1.0)), (1.0, 0.0, 0.0, 1.0))
        drawing = Drawing((DrawnBody(name, (shape,)),))
        page.board.show_drawing(drawing, poses([[0, 0, 1]]))
        for _ in range(2):
            status, headers, content = fetched(page, "drawing.json")
            assert (status, headers["Content-Type"]) == (200, "application/json")
            assert json.loads(content) == json.loads(json.dumps(drawing.described()))


def test_visitors_are_told_to_who_has_the_token(page: PageServer) -> None:
    status, _, content = fetched(page, "visitors.json")
    assert status == 200 and set(json.loads(content)) == {"here", "asleep", "came"}
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(page.url.partition("?")[0])
    assert not page.is_watched


def test_only_so_many_tabs_look_at_a_page(
    page: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, host, rest = page.url.split("/")
    headers = {"Host": host, "Origin": f"http://{host}"}
    request: Any = SimpleNamespace(path=f"/ws{rest}", headers=headers)

    def respond(status: int, _text: str) -> SimpleNamespace:
        return SimpleNamespace(status=status, headers={})

    connection: Any = SimpleNamespace(respond=respond)
    monkeypatch.setattr(page, "_connections", servers._MAX_CONNECTIONS - 1)
    assert page._answer(connection, request) is None and page.is_watched
    monkeypatch.setattr(page, "_connections", servers._MAX_CONNECTIONS)
    answer: Any = page._answer(connection, request)
    assert (answer.status, answer.body) == (503, b"too many tabs look at this page\n")


def test_page_that_is_closed_twice_serves_no_more() -> None:
    with PageServer(Board(), lambda *_: None, lambda: None) as served:
        served.close()
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(served.url, timeout=1.0)
    PageServer(Board(), lambda *_: None, lambda: None).close()


def test_poses_come_at_each_frame_and_numbers_five_times_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = PageServer(Board(), lambda *_: None, lambda: None)
    ada, now_s, sent = page.visitors.arrive("a", "Ada"), [0.0], list[list[Any]]()

    class Connection:
        async def send(self, message: str | bytes) -> None:
            sent[-1].append("poses" if isinstance(message, bytes) else json.loads(message))

    async def next_frame(seconds: float) -> None:
        assert seconds == servers.FRAME_S
        if len(sent) == 10:
            raise asyncio.CancelledError
        now_s[0] += 0.06
        sent.append([])
        page.board.show_poses(poses([[0, 0, len(sent)]]))
        page.board.update_status(frame=len(sent))
        ada.note = "Ben asks for it." if len(sent) > 6 else ""

    monkeypatch.setattr(servers.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(servers.asyncio, "sleep", next_frame)
    sent.append([])
    with pytest.raises(asyncio.CancelledError):
        page._send_changes(Connection(), ada).send(None)  # type: ignore[arg-type]
    monkeypatch.undo()
    assert sent[0] == [{"you": {"name": "Ada", "note": ""}}, {"status": {}}]
    for number, messages in enumerate(sent[1:], 2):
        said = [{"you": {"name": "Ada", "note": "Ben asks for it."}}] if number == 7 else []
        status = [{"status": {"frame": number}}] if number in (5, 9) else []
        assert messages == [*said, "poses", *status], number


# ---------------------------------------------------------------- emergency stop


class Stopping(PageServer):
    """A page whose robot takes a number of looks to stop; ``None``: it does not."""

    def __init__(self, looks: int | None, error: HubError | None = None) -> None:
        self.looks = looks
        self.states: list[str] = []
        self.error = error
        super().__init__(Board(), lambda *_: None, self.note_stop)

    def note_stop(self) -> None:
        self.states.append(self.told["state"])
        if self.error is not None:
            raise self.error

    def has_stopped(self) -> bool:
        self.states.append(self.told["state"])
        return self.looks is not None and self.states.count("sent") > self.looks

    @property
    def told(self) -> dict[str, Any]:
        found: dict[str, Any] = self.board.status[1]["stop"]
        return found


def test_stop_is_sent_and_confirmed_only_by_the_robot() -> None:
    page = Stopping(2)
    page._stop("Ada")
    assert page.states == ["sent"] * 3
    assert page.told == {"number": 1, "by": "Ada", "state": "confirmed", "reason": ""}
    page._stop("Ben")
    assert (page.told["number"], page.told["by"]) == (2, "Ben")


def test_stop_that_nobody_confirms_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servers, "CONFIRM_S", 0.03)
    page = Stopping(None)
    page._stop("Ada")
    assert len(page.states) > 2
    assert (page.told["state"], page.told["reason"]) == ("unconfirmed", "")


def test_stop_that_does_not_reach_the_hub_says_why() -> None:
    page = Stopping(0, HubError("it is out of reach; switch it off"))
    page._stop("Ada")
    assert page.told["state"] == "unconfirmed"
    assert page.told["reason"] == "it is out of reach; switch it off"
    assert page.states == ["sent"], "and nobody waits for a confirmation"


def test_of_two_stops_the_last_one_is_shown() -> None:
    page = Stopping(0)

    def stop_again() -> None:
        page._on_stop = page.note_stop
        page._stop("Ben")

    page._on_stop = stop_again
    page._stop("Ada")
    assert (page.told["number"], page.told["by"]) == (2, "Ben")


# ---------------------------------------------------------------- presses


def test_click_ends_the_note_and_driving_does_not(page: PageServer, presses: list[Press]) -> None:
    ada = page.visitors.arrive("a", "Ada")
    presses.clear()
    for name, is_kept in (("drive", True), ("arrived", True), ("pull", True), ("pause", False)):
        ada.note = "Ben drives this robot."
        page._handle(name, 1, ada)
        assert bool(ada.note) == is_kept, name
    page._handle("reset", None, None)
    assert presses == [
        ("drive", 1, "Ada"),
        ("arrived", 1, "Ada"),
        ("pull", 1, "Ada"),
        ("pause", 1, "Ada"),
        ("reset", None, ""),
    ]


def test_press_that_fails_blocks_no_later_one(caplog: pytest.LogCaptureFixture) -> None:
    done: list[str] = []

    class Failing(PageServer):
        def _tick(self) -> None:
            done.append("tick")

    def press(name: str, _value: Any, _visitor: Visitor | None) -> None:
        if name == "bad":
            raise ValueError("a bug")
        done.append(name)

    page = Failing(Board(), press, lambda: None)
    for name in ("bad", "good", "good"):
        page._presses.put((name, None, None))
    page._presses.put(None)
    page._handle_presses()
    assert done == ["good", "tick", "good"], "from time to time, not after each press"
    assert caplog.messages == ["the page: a bug"]


@pytest.mark.parametrize(
    ("value", "names", "says"),
    [
        ("warp", ["1x", "10x", "max"], "there is no speed 'warp'; choose 1x, 10x or max"),
        (3, ["1x"], "there is no speed 3; choose 1x"),
        ("1x", [], "there is no speed '1x'; choose nothing yet"),
    ],
)
def test_choice_is_one_of_the_names(value: object, names: list[str], says: str) -> None:
    with pytest.raises(servers.PageError) as caught:
        chosen("speed", value, iter(names))
    assert str(caught.value) == says
    assert chosen("speed", "10x", iter(["1x", "10x"])) == "10x"


def test_only_finite_numbers_are_numbers() -> None:
    for value in (0, 1.5, -(10**30), True):
        assert is_finite(value)
    for value in (None, "1", float("nan"), float("inf"), 10**400, [1]):
        assert not is_finite(value)


def test_port_that_is_none_is_refused() -> None:
    for port in (-1, 65536):
        options = servers.PageOptions(page_port=port)
        with pytest.raises(servers.PageError, match=f"^{port} is not a port; give one in 0 to"):
            servers._listen(options)
    with servers._listen(servers.PageOptions(page_port=0)) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
