"""Ctrl-C during a run."""

from __future__ import annotations

import threading
import time

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
