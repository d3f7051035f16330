"""JSON parser of a hub (``extmod/modjson.c`` of MicroPython 1.26): commas and colons are spaces, any bracket closes."""

from __future__ import annotations

import re
from typing import Any

from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.operators import to_float, to_int

_TOKEN = re.compile(
    r"""[,:\ \t\n\r]*(?:
        (?P<word>null|false|true)
      | "(?P<text>(?:[^"\\]|\\.)*)"
      | (?P<number>[-0-9][-+.eE0-9]*)
      | (?P<open>[\[{])
      | (?P<close>[\]}])
    )""",
    re.VERBOSE | re.DOTALL,
)
_WORDS = {"null": None, "false": False, "true": True}
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t"}
_SPACES = " \t\n\r\v\f"
_NO_KEY = object()


def read_json(source: str) -> Any:
    """Parse JSON. Raises ValueError as on the hub, OverflowError if a number needs more than 31 bits."""
    parents: list[Any] = []
    top: Any = None
    key: Any = _NO_KEY
    position = 0
    while True:
        token = _TOKEN.match(source, position)
        if token is None:
            raise _syntax_error()
        position = token.end()
        if token["close"]:
            if top is None:
                raise _syntax_error()
            if not parents:
                return _finished(top, source, position)
            top = parents.pop()
            continue
        value, opens = _value(token), token["open"] is not None
        if top is None:
            if not opens:
                return _finished(value, source, position)
            top = value
            continue
        if isinstance(top, list):
            top.append(value)
        elif key is not _NO_KEY:
            top[key], key = value, _NO_KEY
        elif opens:
            raise _syntax_error()
        else:
            key = value
        if opens:
            parents.append(top)
            top = value


def _value(token: re.Match[str]) -> Any:
    if token["open"]:
        return [] if token["open"] == "[" else HubDict()
    if token["word"]:
        return _WORDS[token["word"]]
    number = token["number"]
    if number is None:
        return re.sub(r"\\(u.{4}|.)", _unescaped, token["text"], flags=re.DOTALL)
    return to_float(float, number) if re.search("[.eE]", number) else to_int(int, number, 10)


def _unescaped(escape: re.Match[str]) -> str:
    text = escape[1]
    if len(text) == 1:
        return _ESCAPES.get(text, text)
    try:
        return chr(int(text[1:], 16))
    except ValueError:
        raise _syntax_error() from None


def _finished(value: Any, source: str, position: int) -> Any:
    if source[position:].strip(_SPACES):
        raise _syntax_error()
    return value


def _syntax_error() -> ValueError:
    return ValueError("syntax error in JSON")
