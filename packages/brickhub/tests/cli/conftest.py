"""The command ``brickhub`` in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest
from in_process import Done, assert_fails, run

from brickhub.cli import main

Command = Callable[..., Done]


@pytest.fixture
def brickhub(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run ``brickhub`` without standard input."""
    monkeypatch.setattr(sys, "stdin", None)
    return lambda *arguments: run(main, capfd, arguments)


@pytest.fixture
def fails(brickhub: Command) -> Callable[..., None]:
    """Expect exit code 2 and one error line that contains ``says``."""
    return lambda *arguments, says: assert_fails(brickhub(*arguments), says)


@pytest.fixture
def told(brickhub: Command) -> Callable[..., tuple[int | str | None, str]]:
    """Exit code and output of a command that has nothing to say on standard error."""

    def run_quietly(*arguments: str) -> tuple[int | str | None, str]:
        done = brickhub(*arguments)
        assert done.err == ""
        return done.code, done.out

    return run_quietly
