"""Ctrl-C during a run."""

from __future__ import annotations

import threading

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
