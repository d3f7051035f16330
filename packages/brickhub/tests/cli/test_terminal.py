"""Questions on a terminal, and answers out of a pipe."""

from __future__ import annotations

import io
import json
import os
import sys
import time

import pytest

from brickhub.cli import terminal
from brickhub.cli.terminal import ask, choose, confirm, print_error, print_findings
from brickhub.finding import Finding, Outcome


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


@pytest.mark.parametrize(
    ("text", "answer", "asked"),
    [("b\n", "b", 1), (" A\n", "a", 1), ("\nb\n", "c", 1), ("d\na\n", "a", 2), ("", "c", 1)],
)
def test_one_of_some_names_is_chosen(
    typed, capfd: pytest.CaptureFixture[str], text: str, answer: str, asked: int
) -> None:
    typed(text)
    assert choose("Which?", ["a", "b", "c"], "c") == answer
    err = capfd.readouterr().err
    assert err.count("Which? [a/b/c, Enter is c]") == asked
    assert err.count("'d' is none of them; type one of a, b, c") == asked - 1


def test_nobody_is_asked_to_choose_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("a\n"))
    assert choose("Which?", ["a", "b"], "b") == "b"
    assert not capfd.readouterr().err
    # Text in memory has no file, and is read as it is.
    assert ask("Right?") is None
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    assert ask("Right?") is True
    sys.stdin.close()
    assert ask("Right?") is None


FINDINGS = (
    Finding("plug", Outcome.OK, "it is in"),
    Finding("battery", Outcome.WARNING, "low; charge it", line=3),
)


@pytest.mark.parametrize("last", Outcome)
def test_findings_are_lines_or_json_and_an_error_is_the_exit_code(
    capfd: pytest.CaptureFixture[str], last: Outcome
) -> None:
    found = (*FINDINGS, Finding("motor", last, "turns"))
    assert print_findings(found, (9, 8)) == int(last is Outcome.ERROR)
    assert capfd.readouterr().out.splitlines() == [
        "ok       plug    it is in",
        "warning  battery low; charge it",
        f"{last.value:9}motor   turns",
    ]
    assert print_findings(found, (9, 8), as_json=True, robot="r") == int(last is Outcome.ERROR)
    written = json.loads(capfd.readouterr().out)
    assert (written["ok"], written["robot"]) == (last is not Outcome.ERROR, "r")
    assert written["findings"][1] == {
        "name": "battery",
        "outcome": "warning",
        "detail": "low; charge it",
    }
    assert str(found[1]) == "battery: low; charge it"


def test_an_error_is_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    print_error("what\n  happened;\twhat to do\n")
    assert capfd.readouterr().err == "error: what happened; what to do\n"
