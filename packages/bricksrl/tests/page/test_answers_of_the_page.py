"""What a page answers: its requests, and what a browser sends."""

from __future__ import annotations

import asyncio
import json
import logging
import queue
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bricksrl.errors import PageError
from bricksrl.page import server as servers
from bricksrl.page.board import Board
from bricksrl.page.server import PageOptions, PageServer
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
