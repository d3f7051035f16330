"""Event loop thread: results, errors, time bounds."""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future

import pytest

from brickhub.errors import HubError, HubTimeoutError
from brickhub.hub.transports.event_loop import EventLoopThread


async def value() -> int:
    await asyncio.sleep(0.01)
    return 7


async def fail() -> None:
    raise ValueError("mine")


async def refuse_once() -> None:
    try:
        await asyncio.sleep(60)
    except asyncio.CancelledError:
        await asyncio.sleep(60)


def test_results_and_errors_are_passed() -> None:
    loop = EventLoopThread("test")
    try:
        assert loop.run(value(), 1.0, "get a value") == 7
        with pytest.raises(ValueError, match="mine"):
            loop.run(fail(), 1.0, "fail")
    finally:
        loop.close()


def test_slow_call_is_cancelled() -> None:
    loop = EventLoopThread("test")
    cancelled = threading.Event()

    async def sleep() -> None:
        try:
            await asyncio.sleep(60)
        finally:
            cancelled.set()

    try:
        with pytest.raises(HubTimeoutError, match="could not sleep within"):
            loop.run(sleep(), 0.05, "sleep")
        assert cancelled.wait(1.0)
    finally:
        loop.close()


def test_close_is_bounded_and_ends_pending_calls() -> None:
    loop = EventLoopThread("test")
    errors: list[Exception] = []

    def call() -> None:
        try:
            loop.run(asyncio.sleep(60), 30.0, "sleep")
        except HubError as error:
            errors.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    with pytest.raises(HubTimeoutError):
        loop.run(refuse_once(), 0.05, "wait")
    start_s = time.monotonic()
    loop.close()
    thread.join(1.0)
    assert time.monotonic() - start_s < 3.0 and len(errors) == 1
    with pytest.raises(HubError, match="open it again"):
        loop.run(value(), 1.0, "get a value")


def test_loop_is_made_in_its_own_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows a loop that is made in the main thread takes Ctrl-C from the command, for good."""
    make = asyncio.new_event_loop
    makers: list[threading.Thread] = []

    def making() -> asyncio.AbstractEventLoop:
        makers.append(threading.current_thread())
        return make()

    monkeypatch.setattr(asyncio, "new_event_loop", making)
    loop = EventLoopThread("test")
    loop.close()
    assert [thread.name for thread in makers] == ["test"]


def test_loop_that_cannot_be_made_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> asyncio.AbstractEventLoop:
        raise OSError("too many open files")

    monkeypatch.setattr(asyncio, "new_event_loop", fail)
    with pytest.raises(OSError, match="too many"):
        EventLoopThread("test")


def test_ctrl_c_is_heard_during_a_long_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows tells of it only when a wait is over."""
    wait = concurrent.futures.wait
    pieces_s: list[float | None] = []

    def interrupted(futures: Sequence[Future[None]], timeout: float | None = None) -> object:
        pieces_s.append(timeout)
        if len(pieces_s) > 2:
            raise KeyboardInterrupt
        return wait(futures, 0.0)

    monkeypatch.setattr(concurrent.futures, "wait", interrupted)
    loop = EventLoopThread("test")
    cancelled = threading.Event()

    async def sleep() -> None:
        try:
            await asyncio.sleep(60)
        finally:
            cancelled.set()

    try:
        with pytest.raises(KeyboardInterrupt):
            loop.run(sleep(), 60.0, "sleep")
        assert cancelled.wait(1.0)
    finally:
        loop.close()
    assert all(piece_s is not None and piece_s <= 0.2 for piece_s in pieces_s)
