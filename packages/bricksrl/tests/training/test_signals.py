"""Ctrl-C during a run."""

from __future__ import annotations

import threading
import time
from contextlib import nullcontext

import pytest
from test_training_loop import ctrl_c

from bricksrl.training.signals import StopSignals


def test_ctrl_c_raises_at_once_after_a_wait() -> None:
    """A reset that waited before its next try can still be interrupted."""
    signals = StopSignals(threading.Event())
    with signals, signals.at_once():
        signals.wait(0.0)
        with pytest.raises(KeyboardInterrupt):
            ctrl_c()
    assert signals.requested


def test_wait_is_in_pieces() -> None:
    """Windows tells of a Ctrl-C only when a wait is over."""
    pieces_s: list[float] = []

    class Recorded(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            assert timeout is not None
            pieces_s.append(timeout)
            return super().wait(timeout)

    signals = StopSignals(stop := Recorded())
    start_s = time.monotonic()
    signals.wait(0.5)
    assert 0.5 <= time.monotonic() - start_s < 5.0
    assert len(pieces_s) > 2 and max(pieces_s) <= 0.2
    stop.set()
    with pytest.raises(KeyboardInterrupt):
        signals.wait(60.0)


@pytest.mark.parametrize(
    ("is_second", "at_once", "held_back", "raises"),
    [
        (False, False, False, False),
        (False, True, False, True),
        (True, False, False, True),
        (True, True, False, True),
        (False, True, True, False),
        (True, False, True, False),
    ],
)
def test_ctrl_c_raises_where_nothing_is_lost(
    is_second: bool, at_once: bool, held_back: bool, raises: bool
) -> None:
    """While files are written it never does, and a second one is as good as at once."""
    stop = threading.Event()
    signals = StopSignals(stop)
    if is_second:
        stop.set()
    signals._at_once = at_once
    with signals.held_back() if held_back else nullcontext():
        if raises:
            with pytest.raises(KeyboardInterrupt):
                signals._on_interrupt()
        else:
            signals._on_interrupt()
    assert signals.requested
    assert not signals._held_back and signals._at_once is at_once


def test_contexts_of_signals_may_be_nested() -> None:
    signals = StopSignals(threading.Event())
    with signals.at_once():
        with signals.at_once(), signals.held_back():
            assert signals._at_once and signals._held_back
        assert signals._at_once and not signals._held_back
    assert not signals._at_once


def test_run_that_is_to_end_waits_for_nothing() -> None:
    stop = threading.Event()
    stop.set()
    signals = StopSignals(stop)
    with pytest.raises(KeyboardInterrupt):
        signals.at_once()
    with signals.held_back():
        assert signals.requested
