"""Output buffer between two threads."""

from __future__ import annotations

import threading
import time

import pytest

from brickhub.errors import HubDisconnectedError, HubError
from brickhub.hub.transports.connection import Output


def test_no_output_before_program() -> None:
    with pytest.raises(HubError, match="no program runs"):
        Output().read(0.0)


def test_read_returns_available_output_or_times_out() -> None:
    output = Output()
    output.begin()
    assert output.read(0.0) == b""
    output.put(b"ab")
    output.put(b"cd")
    assert output.contains(b"bc") and not output.contains(b"x")
    assert output.read(0.0) == b"abcd"
    assert not output.contains(b"bc")


def test_reader_wakes_on_output() -> None:
    output = Output()
    output.begin()
    threading.Timer(0.05, output.put, [b"x"]).start()
    start_s = time.monotonic()
    assert output.read(5.0) == b"x"
    assert time.monotonic() - start_s < 1.0


def test_end_follows_remaining_output() -> None:
    output = Output()
    output.begin()
    output.put(b"last words")
    output.end(HubDisconnectedError, "gone; come back")
    assert output.read(0.0) == b"last words"
    for call in (lambda: output.read(0.0), output.check):
        with pytest.raises(HubDisconnectedError, match="gone"):
            call()
    output.begin()
    output.check()
    assert output.read(0.0) == b""


def test_last_end_reason_counts() -> None:
    output = Output()
    output.begin()
    output.end(HubError, "ended; start again")
    output.end(HubDisconnectedError, "gone; come back")
    with pytest.raises(HubDisconnectedError):
        output.read(0.0)
