"""The command ``bricktwin`` in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest
from in_process import Done, assert_fails, run

from bricktwin.cli import main

Command = Callable[..., Done]


@pytest.fixture
def bricktwin(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run ``bricktwin`` without standard input."""
    monkeypatch.setattr(sys, "stdin", None)
    return lambda *arguments: run(main, capfd, arguments)


@pytest.fixture
def fails(bricktwin: Command) -> Callable[..., None]:
    """Expect exit code 2 and one error line that contains ``says``."""
    return lambda *arguments, says: assert_fails(bricktwin(*arguments), says)
