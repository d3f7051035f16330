"""Event loop of the tab: it waits in its mailbox, and never longer than it has to."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any

from bricktwin.site.tab.mailbox_loop import MailboxLoop


class Mailbox:
    """A mailbox whose letters come while somebody waits."""

    def __init__(self, *letters: list[dict[str, Any]]) -> None:
        self._letters = deque(letters)
        self._here = ""
        self.waited_ms: list[float] = []

    def take(self) -> str:
        taken, self._here = self._here, ""
        return taken

    def wait(self, longest_ms: float) -> None:
        self.waited_ms.append(longest_ms)
        assert longest_ms > 0
        if self._letters:
            self._here = json.dumps(self._letters.popleft())


def run(mailbox: Mailbox, seconds: float) -> list[dict[str, Any]]:
    """Messages that a loop hears until it has slept."""
    heard: list[dict[str, Any]] = []
    loop = MailboxLoop(mailbox, heard.append)
    try:
        loop.run_until_complete(asyncio.sleep(seconds))
    finally:
        loop.close()
    return heard


def test_messages_are_heard_in_their_order() -> None:
    mailbox = Mailbox([{"a": 1}, {"b": 2}], [{"c": 3}])
    assert run(mailbox, 0.05) == [{"a": 1}, {"b": 2}, {"c": 3}]
    assert max(mailbox.waited_ms) <= 50.0 + 1.0


def test_nothing_is_waited_for_where_something_is_due() -> None:
    mailbox = Mailbox()
    assert run(mailbox, 0.0) == [] and mailbox.waited_ms == []
