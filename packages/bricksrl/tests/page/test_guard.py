"""Access control of the page."""

from __future__ import annotations

import asyncio
from unittest.mock import Mock

import pytest

from bricksrl.page.server import Guard, PageServer

OURS = Guard("secret", 8090)
OPEN = Guard("secret", 8090, is_open=True)
GOOD = {
    "Host": "127.0.0.1:8090",
    "Origin": "http://127.0.0.1:8090",
    "Cookie": "bricksrl_8090=secret",
}


def test_access_with_token() -> None:
    assert OURS.refusal("/?token=secret", {"Host": "127.0.0.1:8090"}, is_socket=False) is None
    assert OURS.refusal("/ws", GOOD, is_socket=True) is None
    assert (
        OURS.refusal(
            "/ws",
            {**GOOD, "Host": "localhost:8090", "Origin": "http://localhost:8090"},
            is_socket=True,
        )
        is None
    )


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"Cookie": "bricksrl_8090=secre"}, "/ws"),
        ({"Cookie": ""}, "/ws?token=wrong"),
        ({"Cookie": ""}, "/ws?token="),
        ({"Cookie": "bricksrl_8091=secret"}, "/ws"),
        ({"Origin": "http://evil.example"}, "/ws"),
        ({"Origin": "https://127.0.0.1:8090"}, "/ws"),
        ({"Origin": "http://127.0.0.1:9999"}, "/ws"),
        ({"Origin": "null"}, "/ws"),
        ({"Host": "evil.example:8090", "Origin": "http://evil.example:8090"}, "/ws"),
        ({"Host": "127.0.0.1.evil.example:8090"}, "/ws"),
        ({"Host": "127.0.0.1"}, "/ws"),
        ({"Host": "192.168.1.5:8090", "Origin": "http://192.168.1.5:8090"}, "/ws"),
    ],
)
def test_access_without_valid_token_is_denied(change: dict[str, str], path: str) -> None:
    assert OURS.refusal(path, {**GOOD, **change}, is_socket=True) is not None


def test_origin_and_host_are_required() -> None:
    without_origin = {name: value for name, value in GOOD.items() if name != "Origin"}
    assert OURS.refusal("/ws", without_origin, is_socket=True) is not None
    assert OURS.refusal("/", without_origin, is_socket=False) is None
    assert OURS.refusal("/?token=secret", {}, is_socket=False) is not None


def test_network_page_uses_ip_address() -> None:
    at_home = {**GOOD, "Host": "192.168.1.5:8090", "Origin": "http://192.168.1.5:8090"}
    assert OPEN.refusal("/ws", at_home, is_socket=True) is None
    rebound = {**GOOD, "Host": "evil.example:8090", "Origin": "http://evil.example:8090"}
    assert OPEN.refusal("/ws", rebound, is_socket=True) is not None


def test_browser_omits_port_80() -> None:
    headers = {"Host": "127.0.0.1", "Origin": "http://127.0.0.1", "Cookie": "bricksrl_80=secret"}
    assert Guard("secret", 80).refusal("/ws", headers, is_socket=True) is None
    for host in ("evil.example", "127.0.0.1:8090", "evil.example:80", "192.168.1.5", "", ":80"):
        other = {**headers, "Host": host, "Origin": f"http://{host}"}
        assert Guard("secret", 80).refusal("/ws", other, is_socket=True) is not None


def test_cookie_is_limited_to_page() -> None:
    assert "HttpOnly" in OURS.set_cookie and "SameSite=Strict" in OURS.set_cookie


@pytest.mark.parametrize(
    "other",
    [
        "a[b]=1",
        "x",
        "=",
        "name=va;lue",
        'q="a b\\',
        "\u00fc=\u2603",
        "{}=[]",
        "a=b=c",
        ", ,",
        "bricksrl_8091=other",
        "$Version=1",
        "a@b=c,d",
    ],
)
def test_cookies_of_other_programs_do_no_harm(other: str) -> None:
    for cookies in (
        f"{other}; bricksrl_8090=secret",
        f"bricksrl_8090=secret; {other}",
        f"{other};bricksrl_8090=secret;{other}",
    ):
        assert OURS.refusal("/ws", {**GOOD, "Cookie": cookies}, is_socket=True) is None
    assert OURS.refusal("/ws", {**GOOD, "Cookie": other}, is_socket=True) is not None


def test_of_two_cookies_of_our_name_one_may_be_old() -> None:
    """A cookie of a deeper path, or of an earlier page on this port, comes first."""
    cookies = "bricksrl_8090=old; bricksrl_8090=secret"
    assert OURS.refusal("/ws", {**GOOD, "Cookie": cookies}, is_socket=True) is None


@pytest.mark.parametrize(
    "message", ["", "{", "[" * 100_000, "null", "[]", "1", '"press"', "{}", b"\xff"]
)
def test_message_that_is_no_press_is_ignored(message: str | bytes) -> None:
    server, connection = Mock(), Mock()
    asyncio.run(PageServer._receive(server, connection, message, Mock()))
    assert not server.mock_calls and not connection.mock_calls
