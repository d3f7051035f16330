"""Server of the live page: files, a scene and a WebSocket, in a separate thread with its own event
loop.

A server on this computer can be reached by every web page in the same browser. So a request is
accepted only if it has the token (first in the address, then in a cookie), names this server as its
host (against DNS rebinding), and, for a WebSocket, comes from a page of this server.
"""

from __future__ import annotations

import asyncio
import contextlib
import http
import importlib.resources
import ipaddress
import json
import logging
import math
import queue
import secrets
import socket
import threading
import time
import urllib.parse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeGuard

from brickhub.options import option
from bricksrl.errors import BricksError, PageError, installed
from bricksrl.page.board import Board, BoardReader, to_json
from bricksrl.page.visitors import Visitor, Visitors

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

FRAME_S = 0.04
"""Period of a connection's updates of poses."""
NUMBERS_S = 0.2
"""Period of its updates of numbers."""
PORTS = range(8090, 8110)
"""Ports tried in order if none is given."""
_TEXT = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_CONTENT_TYPES = {
    **{ending: f"{kind}; charset=utf-8" for ending, kind in _TEXT.items()},
    "jpg": "image/jpeg",
}
_MAX_CONNECTIONS = 12
_MAX_MESSAGE_BYTES = 4096
_MAX_SHOWN = 40
_SECRET = "bricksrl_visitor"  # noqa: S105  the name of a cookie
"""Cookie of all pages of this computer with a secret, by which a browser is known again."""
_NAME = "bricksrl_name"
"""Cookie with the visitor's name."""
_KEPT = "HttpOnly; SameSite=Strict; Path=/; Max-Age=31536000"
_UNSEEN = ("arrived", "left", "renamed", "drive", "pull")
"""Presses after which a note to the visitor stays, as they are not made by a click."""
_GOING_AWAY = 1001
"""Code with which a browser closes the connection of a tab that is closed."""
_PING_S = 2.0
"""Period of the questions whether a browser is there."""
_SILENT_S = 8.0
"""Time without an answer after which a browser is gone."""
_TICK_S = 0.5
_CONFIRM_POLL_S = 0.02
CONFIRM_S = 3.0
"""Time that a robot has to confirm an emergency stop."""
_START_TIMEOUT_S = 10.0
_JOIN_TIMEOUT_S = 2.0
_CLOSE_TIMEOUT_S = 0.5
"""Time that a browser has to answer the end of its connection."""

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of every response."""
_DOCUMENT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:; "
    "frame-ancestors 'none'"
)
"""Content policy of a report, which has its looks and films inside, and must run nothing."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Guard:
    """Access control, from a request's headers: token and port of a page, and whether other
    computers may connect."""

    token: str
    port: int
    is_open: bool = False

    @property
    def cookie(self) -> str:
        """Name of the cookie, with the port, as cookies are shared by all ports of a host."""
        return f"bricksrl_{self.port}"

    @property
    def set_cookie(self) -> str:
        """Value of the Set-Cookie header with the token."""
        return f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def refusal(
        self,
        path: str,
        headers: Mapping[str, str],
        *,
        is_socket: bool,
    ) -> str | None:
        """Reason to refuse a request; ``None`` to accept it."""
        host = headers.get("Host") or ""
        name = host.removesuffix(f":{self.port}")
        # Browsers omit the port of the web itself.
        has_our_port = name != host or self.port == 80
        # By number only: a name may be anybody's, and point here by its owner's DNS (rebinding).
        has_our_name = name.lower() in LOOPBACK or (self.is_open and _is_ip_address(name))
        if not (has_our_port and has_our_name):
            return "this page has another address; open the one that the terminal shows"
        query = urllib.parse.urlsplit(path).query
        tokens = urllib.parse.parse_qs(query).get("token", [])
        tokens += cookies(headers).get(self.cookie, [])
        # In a time that does not tell how much of a guess was right.
        if not any(secrets.compare_digest(token.encode(), self.token.encode()) for token in tokens):
            return "this page needs its token; open the address that the terminal shows"
        # A browser sends cookies along also with what another site's page asks for.
        origin = headers.get("Origin")
        if (is_socket or origin is not None) and origin != f"http://{host}":
            return "another web page has asked for this; open the address that the terminal shows"
        return None


def cookies(headers: Mapping[str, str]) -> dict[str, list[str]]:
    """Values of a request's cookies by name. Those of other programs on this host are among them,
    in any form."""
    found: dict[str, list[str]] = {}
    for part in (headers.get("Cookie") or "").split(";"):
        name, equals, value = part.strip().partition("=")
        if equals:
            found.setdefault(name.strip(), []).append(value.strip().strip('"'))
    return found


def _is_ip_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


Press = Callable[[str, Any, "Visitor | None"], None]
"""Called with the name of a button or slider, its value, and who pressed it. The page itself
presses ``arrived`` and ``left`` for each tab."""


@dataclass(frozen=True)
class PageOptions:
    """Address flags of the live page."""

    page_host: Annotated[str, option(metavar="ADDRESS")] = "127.0.0.1"
    """Address that serves the live page; 0.0.0.0 also admits devices in the same network that know
    the page's full address."""
    page_port: Annotated[int | None, option(metavar="N")] = None
    """Port of the live page; by default the first free one from 8090."""


class PageServer:
    """Server of a page, running while entered.

    Args:
        board: state to show.
        on_press: called with each press except an emergency stop, one at a time, in a separate
            thread.
        on_stop: called for an emergency stop, at once, even while an earlier press is being
            handled. What it raises is told to all visitors.

    Attributes:
        board: state that the page shows.
        url: address with the token.

    Raises:
        PageError: on entering, the address is in use or not of this computer.
    """

    def __init__(
        self,
        board: Board,
        on_press: Press,
        on_stop: Callable[[], None],
        options: PageOptions | None = None,
    ) -> None:
        self.board = board
        self._on_press = on_press
        self._on_stop = on_stop
        self._options = options or PageOptions()
        self._presses: queue.SimpleQueue[tuple[str, Any, Visitor | None] | None] = (
            queue.SimpleQueue()
        )
        self.visitors = Visitors()
        self._stops = 0
        self._threads: list[threading.Thread] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._closing: asyncio.Event | None = None
        self._drawing: tuple[int, bytes] = (0, b"")
        self._connections = 0
        self.url = ""

    def __enter__(self) -> Self:
        with installed("websockets", PageError, '"bricksrl[page]"'):
            import websockets.asyncio.server  # noqa: F401
        server_socket = _listen(self._options)
        host, port = server_socket.getsockname()[:2]
        is_open = self._options.page_host not in ("127.0.0.1", "localhost", "::1")
        self._guard = Guard(secrets.token_urlsafe(18), port, is_open)
        # Who listens on all addresses is told one that others can open.
        name = _own_address() if host in ("0.0.0.0", "::") else host  # noqa: S104  compared only
        name = f"[{name}]" if ":" in name else name
        self.url = f"http://{name}:{port}/?token={self._guard.token}"
        self._start("bricksrl-page", lambda: asyncio.run(self._serve(server_socket)))
        self._start("bricksrl-page-presses", self._handle_presses)
        if not self._ready.wait(_START_TIMEOUT_S):
            raise PageError("the live page did not start in time; try again")
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_watched(self) -> bool:
        """Whether a browser shows the page."""
        return self._connections > 0

    def close(self) -> None:
        """Close the connections and stop serving; closing twice does nothing."""
        if self._loop is not None and self._closing is not None:
            # The loop is closed already where its own thread has ended.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._closing.set)
        self._presses.put(None)
        for thread in self._threads:
            thread.join(_JOIN_TIMEOUT_S)

    def _start(
        self,
        name: str,
        target: Callable[[], None],
    ) -> None:
        thread = threading.Thread(
            target=target,
            name=name,
            daemon=True,
        )
        self._threads.append(thread)
        thread.start()

    # -------------------------------------------------------------- in the thread of the event loop

    async def _serve(self, server_socket: socket.socket) -> None:
        from websockets.asyncio.server import serve

        logger = logging.getLogger(f"{__name__}.websockets")
        logger.setLevel(logging.CRITICAL)  # refused requests are not our errors
        self._loop = asyncio.get_running_loop()
        self._closing = asyncio.Event()
        self._loop.set_exception_handler(_note)
        async with serve(
            self._serve_browser,
            sock=server_socket,
            process_request=self._answer,
            compression=None,
            max_size=_MAX_MESSAGE_BYTES,
            close_timeout=_CLOSE_TIMEOUT_S,
            ping_interval=_PING_S,
            ping_timeout=_SILENT_S,
            logger=logger,
        ) as server:
            self._ready.set()
            await self._closing.wait()
            # The last news, such as that of a stop, are told too.
            await asyncio.sleep(NUMBERS_S + FRAME_S)
            # All at once: a browser that sleeps takes its whole time to answer.
            connections = list(server.connections)
            ends = [connection.close(1001, "the run has ended") for connection in connections]
            await asyncio.gather(*ends)

    def file(self, name: str) -> tuple[str, bytes] | None:
        """Content type and bytes of a file of the page; ``None`` if there is no such file."""
        return _file(name or "index.html")

    def _answer(
        self,
        connection: ServerConnection,
        request: Request,
    ) -> Response | None:
        """Response to a request; ``None`` accepts a WebSocket."""
        path = urllib.parse.urlsplit(request.path).path
        status = http.HTTPStatus.OK
        content_type = "text/plain"
        refusal = self._guard.refusal(request.path, request.headers, is_socket=path == "/ws")
        if refusal is not None:
            status = http.HTTPStatus.FORBIDDEN
            data = f"{refusal}\n".encode()
        elif path == "/ws":
            if self._connections < _MAX_CONNECTIONS:
                return None
            status = http.HTTPStatus.SERVICE_UNAVAILABLE
            data = b"too many tabs look at this page\n"
        elif path == "/visitors.json":
            content_type = "application/json"
            data = json.dumps(self.visitors.described()).encode()
        elif path == "/drawing.json":
            # Encoded for the first browser that asks, and kept for the others.
            version, drawing = self.board.drawing
            if version != self._drawing[0] and drawing is not None:
                self._drawing = (version, json.dumps(drawing.described()).encode())
            content_type = "application/json"
            data = self._drawing[1]
        elif (file := self.file(path[1:])) is not None:
            content_type, data = file
        else:
            status = http.HTTPStatus.NOT_FOUND
            data = b"there is no such file here\n"
        response = connection.respond(status, "")
        headers = {"Content-Type": content_type, "Content-Length": str(len(data)), **HEADERS}
        if path.endswith("/report.html"):
            headers["Content-Security-Policy"] = _DOCUMENT_POLICY
        for name, value in headers.items():
            response.headers.pop(name, None)
            response.headers[name] = value
        if path == "/" and refusal is None:
            response.headers["Set-Cookie"] = self._guard.set_cookie
            # The same on all pages of this computer, so that a visitor is known on each.
            if _SECRET not in cookies(request.headers):
                response.headers["Set-Cookie"] = f"{_SECRET}={secrets.token_urlsafe(18)}; {_KEPT}"
        response.body = data
        return response

    async def _serve_browser(self, connection: ServerConnection) -> None:
        """Serve one browser until it disconnects."""
        from websockets.exceptions import ConnectionClosed

        known = cookies(connection.request.headers) if connection.request is not None else {}
        secret = known.get(_SECRET, [secrets.token_urlsafe(18)])[0]
        visitor = self.visitors.arrive(secret, urllib.parse.unquote(known.get(_NAME, [""])[0]))
        self._connections += 1
        self._tell_visitors()
        self._presses.put(("arrived", None, visitor))
        sender = asyncio.create_task(self._send_changes(connection, visitor))
        try:
            async for message in connection:
                await self._receive(connection, message, visitor)
        except ConnectionClosed:
            pass
        finally:
            self._connections -= 1
            self.visitors.leave(visitor, closed=connection.close_code == _GOING_AWAY)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
            self._presses.put(("left", None, visitor))
            self._tell_visitors()

    def _tell_visitors(self) -> None:
        """Show who is here."""
        self.board.update_status(visitors=[visitor.name for visitor in self.visitors.here()])

    async def _send_changes(
        self,
        connection: ServerConnection,
        visitor: Visitor,
    ) -> None:
        reader = BoardReader(self.board)
        due_s = 0.0
        told: dict[str, str] | None = None
        while True:
            you = {"name": visitor.name, "note": visitor.note}
            if you != told:
                told = you
                await connection.send(to_json({"you": you}))
            now_s = time.monotonic()
            # Poses move at each frame; numbers change too fast to be read, and come less often.
            numbers = now_s >= due_s
            if numbers:
                due_s = now_s + NUMBERS_S
            for message in reader.changes(numbers=numbers):
                data = message if isinstance(message, bytes) else to_json(message)
                await connection.send(data)
            await asyncio.sleep(FRAME_S)

    async def _receive(
        self,
        connection: ServerConnection,
        message: str | bytes,
        visitor: Visitor,
    ) -> None:
        """Handle a press; other messages, as of another version of the page, are ignored."""
        try:
            content = json.loads(message)
        # RecursionError: brackets in brackets.
        except (ValueError, RecursionError):
            return
        if not isinstance(content, dict) or "press" not in content:
            return
        name = content["press"]
        value = content.get("value")
        number = value if is_finite(value) else 0
        if name == "stop":
            # A thread of its own: neither a press that is being handled nor the loop delays it.
            stop = threading.Thread(
                target=self._stop,
                args=(visitor.name,),
                name="bricksrl-page-stop",
                daemon=True,
            )
            stop.start()
            await connection.send(to_json({"heard": number}))
        elif name == "ping":
            # The page's question whether we are there; an answer shows both ways of the connection.
            await connection.send(to_json({"pong": number}))
        elif name == "name":
            self.visitors.rename(visitor, value)
            self._tell_visitors()
            self._presses.put(("renamed", None, visitor))
        elif isinstance(name, str):
            self._presses.put((name, value, visitor))

    # ----------------------------------------------------------- in a thread of each emergency stop

    def _stop(self, by: str) -> None:
        """Stop, and tell all visitors what is known of it: sent, confirmed, or why not."""
        self._stops += 1
        number = self._stops

        def tell(state: str, reason: str = "") -> None:
            # Of several, the last one is shown.
            if number == self._stops:
                stop = {"number": number, "by": by, "state": state, "reason": reason}
                self.board.update_status(stop=stop)

        tell("sent")
        try:
            self._on_stop()
        except BricksError as error:
            tell("unconfirmed", str(error))
            return
        # Sent is not stopped: only the hub's own answer confirms it.
        limit_s = time.monotonic() + CONFIRM_S
        while not self.has_stopped():
            if time.monotonic() >= limit_s:
                tell("unconfirmed")
                return
            time.sleep(_CONFIRM_POLL_S)
        tell("confirmed")

    def has_stopped(self) -> bool:
        """Whether what moved is known to be stopped; asked for up to :data:`CONFIRM_S` after an
        emergency stop."""
        return True

    # ---------------------------------------------------------------- in the thread of the presses

    def _handle_presses(self) -> None:
        due_s = time.monotonic()
        while True:
            try:
                with contextlib.suppress(queue.Empty):
                    press = self._presses.get(timeout=_TICK_S)
                    if press is None:
                        return
                    self._handle(*press)
                if time.monotonic() >= due_s:
                    due_s = time.monotonic() + _TICK_S
                    self._tick()
            except Exception as error:  # noqa: BLE001  a failed press must not block later ones
                _log.warning("the page: %s", error)

    def _handle(
        self,
        name: str,
        value: Any,
        visitor: Visitor | None,
    ) -> None:
        if visitor is not None and name not in _UNSEEN:
            visitor.note = ""
        self._on_press(name, value, visitor)

    def _tick(self) -> None:
        """Hook: called about every half second."""


def _note(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Say nothing of a browser that is gone, which the event loop of Windows takes for an error."""
    if not isinstance(context.get("exception"), ConnectionError):
        loop.default_exception_handler(context)


def _listen(options: PageOptions) -> socket.socket:
    """Open a listening socket on the given port, or on the first free one."""
    if options.page_port is not None and not 0 <= options.page_port < 65536:
        raise PageError(f"{options.page_port} is not a port; give one in 0 to 65535, or none")
    last_error: OSError | None = None
    family = socket.AF_INET6 if ":" in options.page_host else socket.AF_INET
    # `::` stands for all addresses, also those of IPv4.
    is_dual = options.page_host == "::" and socket.has_dualstack_ipv6()
    ports = PORTS if options.page_port is None else (options.page_port,)
    for port in ports:
        place = (options.page_host, port)
        try:
            return socket.create_server(place, family=family, dualstack_ipv6=is_dual)
        except OSError as error:
            last_error = error
    # Python adds the address to the system's reason, which names it another time.
    text = str((last_error and last_error.strerror) or last_error)
    reason = text.partition(" (while attempting")[0]
    address = f"{options.page_host}:{ports[0]}"
    raise PageError(f"cannot serve the page on {address} ({reason}); name another host or port")


def _own_address() -> str:
    """IP address of this computer in its network, found without sending anything."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # documentation address (RFC 5737): gives the outgoing interface
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _file(name: str) -> tuple[str, bytes] | None:
    """Content type and bytes of a file of the page, or of the view that it shows; ``None`` if there
    is no such file."""
    content_type = _CONTENT_TYPES.get(name.rpartition(".")[2])
    if content_type is None:
        return None
    # A name is looked up among those that are there, and never joined to a path.
    page = importlib.resources.files("bricksrl.page")
    view = importlib.resources.files("bricktwin.view")
    for folder in (page / "static", page / "pictures", view / "static"):
        for file in folder.iterdir():
            if file.name == name:
                return content_type, file.read_bytes()
    return None


# --------------------------------------- values of presses, which may be anything that JSON can say


def chosen(
    noun: str,
    value: object,
    names: Iterable[str],
) -> str:
    """The value, one of the names. Raises PageError if it is none of them."""
    known = list(names)
    if isinstance(value, str) and value in known:
        return value
    choice = "nothing yet"
    if known:
        *first, last = known
        choice = f"{', '.join(first)} or {last}" if first else last
    raise PageError(f"there is no {noun} {value!r:.{_MAX_SHOWN}}; choose {choice}")


def is_finite(value: object) -> TypeGuard[int | float]:
    """Whether the value is a finite number."""
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # a whole number beyond what a float holds
        return False
