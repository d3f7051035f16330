"""The program's output between two threads."""

from __future__ import annotations

import threading
import time

import pytest

from bricksrl.errors import HubError
from bricksrl.hub.errors import HubDisconnectedError
from bricksrl.hub.transports.stdout_buffer import Output


def test_before_a_program_there_is_nothing_to_read() -> None:
    with pytest.raises(HubError, match="no program runs"):
        Output().read(0.0)


def test_reading_gives_all_that_came_and_nothing_in_time() -> None:
    output = Output()
    output.begin()
    assert output.read(0.0) == b""
    output.put(b"ab")
    output.put(b"cd")
    assert output.holds(b"bc") and not output.holds(b"x")
    assert output.read(0.0) == b"abcd"
    assert not output.holds(b"bc")


def test_a_reader_wakes_when_something_comes() -> None:
    output = Output()
    output.begin()
    threading.Timer(0.05, output.put, [b"x"]).start()
    start_s = time.monotonic()
    assert output.read(5.0) == b"x"
    assert time.monotonic() - start_s < 1.0


def test_the_end_comes_after_the_rest() -> None:
    output = Output()
    output.begin()
    output.put(b"last words")
    output.end(HubDisconnectedError, "gone; come back")
    assert output.read(0.0) == b"last words"
    assert output.read(0.0) == b""
    for call in (lambda: output.read(0.0), output.check):
        with pytest.raises(HubDisconnectedError, match="gone"):
            call()
    output.begin()
    output.check()
    assert output.read(0.0) == b""


def test_the_last_reason_counts() -> None:
    output = Output()
    output.begin()
    output.end(HubError, "ended; start again")
    assert output.read(0.0) == b""
    output.end(HubDisconnectedError, "gone; come back")
    with pytest.raises(HubDisconnectedError):
        output.read(0.0)
