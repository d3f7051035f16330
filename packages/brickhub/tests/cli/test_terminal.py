"""Questions on a terminal, and answers out of a pipe."""

from __future__ import annotations

import io
import os
import sys
import time

import pytest

from brickhub.cli import terminal
from brickhub.cli.terminal import ask, confirm


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch):
    """Type into a terminal."""

    def type_in(text: str) -> None:
        stream = io.StringIO(text)
        stream.isatty = lambda: True  # type: ignore[method-assign]
        monkeypatch.setattr(sys, "stdin", stream)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)

    return type_in


@pytest.mark.parametrize(
    ("text", "answer", "asked"),
    [
        ("y\n", True, 1),
        (" YES \n", True, 1),
        ("n\n", False, 1),
        ("No\n", False, 1),
        ("\ny\n", True, 2),
        ("yep\ny\n", True, 2),
        ("ja\nnein\n?\nn\n", False, 4),
        ("", None, 1),
        ("what", None, 2),
    ],
)
def test_a_typo_is_no_answer(
    typed, capfd: pytest.CaptureFixture[str], text: str, answer: bool | None, asked: int
) -> None:
    typed(text)
    assert ask("Right?") is answer
    assert capfd.readouterr().err.count("Right? [y/n]") == asked


def test_what_enter_means_is_said(typed, capfd: pytest.CaptureFixture[str]) -> None:
    typed("\n")
    assert not confirm("Move?")
    assert "Move? [y/N, Enter is no]" in capfd.readouterr().err


@pytest.mark.parametrize("platform", ["linux", "win32"])
def test_answers_come_out_of_a_pipe(monkeypatch: pytest.MonkeyPatch, platform: str) -> None:
    monkeypatch.setattr("sys.platform", platform)
    monkeypatch.setattr(terminal, "_PIPE_S", 0.05)
    reader, writer = os.pipe()
    with os.fdopen(reader) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        os.write(writer, b"y\nmaybe\nn\n")
        assert (ask("1"), ask("2")) == (True, False)
        start_s = time.monotonic()
        assert ask("3") is None and time.monotonic() - start_s < 5, "a pipe whose writer is silent"
        os.close(writer)
        assert ask("4") is None


def test_nothing_is_asked_without_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    assert ask("Right?") is None and not confirm("Move?")
