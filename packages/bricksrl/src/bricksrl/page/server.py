"""Server of the live page: files, a scene and a WebSocket, in a separate thread with its own event loop."""

from __future__ import annotations

import asyncio
import contextlib
import http
import importlib.resources
import json
import logging
import queue
import socket
import threading
import time
import urllib.parse
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from bricksrl.errors import PageError
from bricksrl.page.board import Board, BoardReader, to_json
from bricksrl.page.guard import HEADERS, Guard, new_token

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.datastructures import Headers
    from websockets.http11 import Request, Response

FRAME_S = 0.04
"""Period of a connection's updates of poses."""
NUMBERS_S = 0.2
"""Period of its updates of numbers."""
PORTS = range(8090, 8110)
"""Ports tried in order if none is given."""
_CONTENT_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_MAX_CONNECTIONS, _MAX_MESSAGE_BYTES = 12, 4096
_START_TIMEOUT_S, _JOIN_TIMEOUT_S = 10.0, 5.0

_log = logging.getLogger(__name__)

Press = Callable[[str, Any], None]
"""Called with the name of a button or slider, and its value."""


@dataclass(frozen=True)
class PageOptions:
    """Address of the page's server.

    Attributes:
        host: address to listen on; 127.0.0.1 for this computer only, 0.0.0.0 or :: for others too.
        port: port to listen on; ``None`` for the first free one of :data:`PORTS`, 0 for any.
    """

    host: str = "127.0.0.1"
    port: int | None = None


class PageServer:
    """Server of a page, running while entered.

    Args:
        board: state to show.
        on_press: called with each press except an emergency stop, one at a time, in a separate thread.
        on_stop: called for an emergency stop, at once, even while an earlier press is being handled.

    Attributes:
        url: address with the token.

    Raises:
        PageError: on entering, the address is in use or not of this computer.
    """

    def __init__(self, board: Board, on_press: Press, on_stop: Callable[[], None], options: PageOptions | None = None) -> None:
        self._board, self._on_press, self._on_stop = board, on_press, on_stop
        self._options = options or PageOptions()
        self._presses: queue.SimpleQueue[tuple[str, Any] | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._closing: asyncio.Event | None = None
        self._scene: tuple[int, bytes] = (0, b"")
        self._connections = 0
        self.url = ""

    def __enter__(self) -> Self:
        try:
            import websockets.asyncio.server  # noqa: F401
        except ImportError:
            raise PageError("the live page needs websockets; install it with: pip install 'bricksrl[page]'") from None
        server_socket = _listen(self._options)
        host, port = server_socket.getsockname()[:2]
        self._guard = Guard(new_token(), port, is_open=self._options.host not in ("127.0.0.1", "localhost", "::1"))
        name = _own_address() if host in ("0.0.0.0", "::") else host  # noqa: S104  compared, not listened on
        name = f"[{name}]" if ":" in name else name
        self.url = f"http://{name}:{port}/?token={self._guard.token}"
        self._start("bricksrl-page", lambda: asyncio.run(self._serve(server_socket)))
        self._start("bricksrl-page-presses", self._handle_presses)
        if not self._ready.wait(_START_TIMEOUT_S):
            raise PageError("the live page did not start in time; try again")
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections and stop serving; closing twice does nothing."""
        if self._loop is not None and self._closing is not None:
            with contextlib.suppress(RuntimeError):  # closed already
                self._loop.call_soon_threadsafe(self._closing.set)
        self._presses.put(None)
        for thread in self._threads:
            thread.join(_JOIN_TIMEOUT_S)

    def _start(self, name: str, target: Callable[[], None]) -> None:
        thread = threading.Thread(target=target, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    # ---------------------------------------------------------------- in the thread of the event loop

    async def _serve(self, server_socket: socket.socket) -> None:
        from websockets.asyncio.server import serve

        logger = logging.getLogger(f"{__name__}.websockets")
        logger.setLevel(logging.CRITICAL)  # refused requests are not our errors
        self._loop, self._closing = asyncio.get_running_loop(), asyncio.Event()
        async with serve(
            self._serve_browser,
            sock=server_socket,
            process_request=self._answer,
            compression=None,
            max_size=_MAX_MESSAGE_BYTES,
            close_timeout=1.0,
            logger=logger,
        ) as server:
            self._ready.set()
            await self._closing.wait()
            for connection in list(server.connections):
                await connection.close(1001, "the run has ended")

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Response to a request; ``None`` accepts a WebSocket."""
        path = urllib.parse.urlsplit(request.path).path
        refusal = self._guard.refusal(request.path, request.headers, is_socket=path == "/ws")
        if refusal is not None:
            return _response(connection, http.HTTPStatus.FORBIDDEN, "text/plain", f"{refusal}\n".encode())
        if path == "/ws":
            if self._connections < _MAX_CONNECTIONS:
                return None
            return _response(connection, http.HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"too many tabs look at this page\n")
        if path == "/scene.bin":
            return _response(connection, http.HTTPStatus.OK, "application/octet-stream", self._scene_bytes())
        file = _file("index.html" if path == "/" else path[1:])
        if file is None:
            return _response(connection, http.HTTPStatus.NOT_FOUND, "text/plain", b"there is no such file here\n")
        content_type, data = file
        response = _response(connection, http.HTTPStatus.OK, content_type, data)
        if path == "/":
            response.headers["Set-Cookie"] = self._guard.set_cookie
        return response

    def _scene_bytes(self) -> bytes:
        version, scene = self._board.scene
        if version != self._scene[0] and scene is not None:
            self._scene = (version, scene.to_bytes())
        return self._scene[1]

    async def _serve_browser(self, connection: ServerConnection) -> None:
        """Serve one browser until it disconnects."""
        from websockets.exceptions import ConnectionClosed

        self._connections += 1
        sender = asyncio.create_task(self._send_changes(connection))
        try:
            async for message in connection:
                self._receive(message)
        except ConnectionClosed:
            pass
        finally:
            self._connections -= 1
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
            self._presses.put(("left", None))

    async def _send_changes(self, connection: ServerConnection) -> None:
        reader, due_s = BoardReader(self._board), 0.0
        while True:
            now_s = time.monotonic()
            numbers = now_s >= due_s
            due_s = now_s + NUMBERS_S if numbers else due_s
            for message in reader.changes(numbers=numbers):
                await connection.send(message if isinstance(message, bytes) else to_json(message))
            await asyncio.sleep(FRAME_S)

    def _receive(self, message: str | bytes) -> None:
        """Handle a press; other messages, as of another version of the page, are ignored."""
        try:
            content = json.loads(message)
            name, value = content["press"], content.get("value")
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return
        if name == "stop":
            threading.Thread(target=self._on_stop, name="bricksrl-page-stop", daemon=True).start()
        elif isinstance(name, str):
            self._presses.put((name, value))

    # ---------------------------------------------------------------- in the thread of the presses

    def _handle_presses(self) -> None:
        while (press := self._presses.get()) is not None:
            try:
                self._on_press(*press)
            except Exception as error:  # noqa: BLE001  a failed press must not block later ones
                _log.warning("the page: %s", error)


def _listen(options: PageOptions) -> socket.socket:
    """Open a listening socket on the given port, or on the first free one."""
    if options.port is not None and not 0 <= options.port < 65536:
        raise PageError(f"{options.port} is not a port; give one in 0 to 65535, or none")
    last_error: OSError | None = None
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    is_dual = options.host == "::" and socket.has_dualstack_ipv6()  # all addresses, also those of IPv4
    for port in PORTS if options.port is None else (options.port,):
        try:
            return socket.create_server((options.host, port), family=family, dualstack_ipv6=is_dual)
        except OSError as error:
            last_error = error
    address = f"{options.host}:{PORTS.start if options.port is None else options.port}"
    reason = str((last_error and last_error.strerror) or last_error).partition(" (while attempting")[0]
    raise PageError(f"cannot serve the page on {address} ({reason}); name another host or port")


def _own_address() -> str:
    """IP address of this computer in its network, found without sending anything."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # documentation address (RFC 5737): gives the outgoing interface
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _file(name: str) -> tuple[str, bytes] | None:
    """Content type and bytes of a file of the page; ``None`` if there is no such file."""
    content_type = _CONTENT_TYPES.get(name.rpartition(".")[2])
    folder = importlib.resources.files("bricksrl.page") / "static"
    if content_type is None or "/" in name or "\\" in name or name not in {file.name for file in folder.iterdir()}:
        return None
    return f"{content_type}; charset=utf-8", (folder / name).read_bytes()


def _response(connection: ServerConnection, status: http.HTTPStatus, content_type: str, data: bytes) -> Response:
    response = connection.respond(status, "")
    headers: Headers = response.headers
    for name in ("Content-Type", "Content-Length"):
        del headers[name]
    headers["Content-Type"], headers["Content-Length"] = content_type, str(len(data))
    for name, value in HEADERS.items():
        headers[name] = value
    response.body = data
    return response
