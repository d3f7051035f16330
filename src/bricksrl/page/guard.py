"""Guard of the page: who may connect. Pure functions of the headers of a request.

A page on this computer can be reached by every web page that is open in the same browser. So a request counts only when it knows
the token (in the address at first, in a cookie afterwards), names this server as its host (or a foreign name could be made to
point here: DNS rebinding), and, for a WebSocket, comes from a page of this server.
"""

from __future__ import annotations

import http.cookies
import ipaddress
import secrets
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Of every answer."""


@dataclass(frozen=True)
class Guard:
    """The token of a page, where it is served, and whether other computers are to reach it."""

    token: str
    port: int
    is_open: bool = False

    @property
    def cookie(self) -> str:
        """Name of the cookie; cookies do not know of ports, and there may be several pages."""
        return f"bricksrl_{self.port}"

    def knows_host(self, host: str | None) -> bool:
        """Whether a request named this server, and no foreign name that points here; other computers name its number."""
        if host is None:
            return False
        name, _, port = host.rpartition(":")
        if port != str(self.port):
            return False
        return name.lower() in LOOPBACK or (self.is_open and _is_number(name))

    def knows_token(self, path: str, cookies: str | None) -> bool:
        """Whether the address or the cookie has the token."""
        query = urllib.parse.parse_qs(urllib.parse.urlsplit(path).query)
        jar = _parse_cookies(cookies)
        given = (*query.get("token", ()), *((jar[self.cookie],) if self.cookie in jar else ()))
        return any(secrets.compare_digest(one.encode(), self.token.encode()) for one in given)

    def knows_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a WebSocket was opened by a page of this server."""
        return origin is not None and origin == f"http://{host}"

    def refusal(self, path: str, headers: Mapping[str, str], *, is_socket: bool) -> str | None:
        """The reason not to answer this request; ``None`` where there is none."""
        host = headers.get("Host")
        if not self.knows_host(host):
            return "this page has another address; open the one that the terminal shows"
        if not self.knows_token(path, headers.get("Cookie")):
            return "this page needs its token; open the address that the terminal shows"
        origin = headers.get("Origin")
        if (is_socket or origin is not None) and not self.knows_origin(origin, host):
            return "another web page has asked for this; open the address that the terminal shows"
        return None

    @property
    def set_cookie(self) -> str:
        """Header that lets the browser in again, without the token in the address."""
        return f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def new_token() -> str:
    """A secret that nobody guesses."""
    return secrets.token_urlsafe(18)


def _parse_cookies(text: str | None) -> dict[str, str]:
    try:
        return {name: one.value for name, one in http.cookies.SimpleCookie(text or "").items()}
    except http.cookies.CookieError:
        return {}


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True
