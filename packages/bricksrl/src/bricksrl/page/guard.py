"""Access control of the page, as pure functions of a request's headers.

A server on this computer can be reached by every web page in the same browser. So a request is accepted only if it has the token
(first in the address, then in a cookie), names this server as its host (against DNS rebinding), and, for a WebSocket, comes from
a page of this server.
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
"""Headers of every response."""


@dataclass(frozen=True)
class Guard:
    """Token and port of a page, and whether other computers may connect."""

    token: str
    port: int
    is_open: bool = False

    @property
    def cookie(self) -> str:
        """Name of the cookie, with the port, as cookies are shared by all ports of a host."""
        return f"bricksrl_{self.port}"

    def accepts_host(self, host: str | None) -> bool:
        """Whether the Host header names this server: a loopback name or, for an open page, an IP address."""
        name = (host or "").removesuffix(f":{self.port}")
        if name == host and self.port != 80:  # which browsers omit
            return False
        return name.lower() in LOOPBACK or (self.is_open and _is_ip_address(name))

    def accepts_token(self, path: str, cookies: str | None) -> bool:
        """Whether the address or the cookie has the token."""
        query = urllib.parse.parse_qs(urllib.parse.urlsplit(path).query)
        jar = _parse_cookies(cookies)
        tokens = (*query.get("token", ()), *((jar[self.cookie],) if self.cookie in jar else ()))
        return any(secrets.compare_digest(token.encode(), self.token.encode()) for token in tokens)

    def refusal(self, path: str, headers: Mapping[str, str], *, is_socket: bool) -> str | None:
        """Reason to refuse a request; ``None`` to accept it."""
        host = headers.get("Host")
        if not self.accepts_host(host):
            return "this page has another address; open the one that the terminal shows"
        if not self.accepts_token(path, headers.get("Cookie")):
            return "this page needs its token; open the address that the terminal shows"
        origin = headers.get("Origin")
        if (is_socket or origin is not None) and origin != f"http://{host}":
            return "another web page has asked for this; open the address that the terminal shows"
        return None

    @property
    def set_cookie(self) -> str:
        """Value of the Set-Cookie header with the token."""
        return f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def new_token() -> str:
    """A random secret."""
    return secrets.token_urlsafe(18)


def _parse_cookies(text: str | None) -> dict[str, str]:
    try:
        return {name: morsel.value for name, morsel in http.cookies.SimpleCookie(text or "").items()}
    except http.cookies.CookieError:
        return {}


def _is_ip_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True
