"""Commands in this process: how they end, and what they print."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest


class Done(NamedTuple):
    """A command that has ended."""

    code: int | str | None
    out: str
    err: str


def run(
    main: Callable[[Sequence[str]], int],
    capfd: pytest.CaptureFixture[str],
    arguments: Sequence[str],
) -> Done:
    """Run a command; help and wrong arguments end it as they would end a process."""
    try:
        code: int | str | None = main(arguments)
    except SystemExit as end:
        code = end.code or 0
    return Done(code, *capfd.readouterr())


def assert_fails(done: Done, says: str) -> None:
    """Expect exit code 2 and one error line that contains ``says``."""
    assert (done.code, done.out) == (2, "")
    assert re.fullmatch(r"error: [^\n]+\n", done.err), done.err
    assert says in done.err


def assert_explained(text: str) -> None:
    """Expect that the help of a command has a placeholder of ours for each value, and words on each
    option."""
    assert not re.search(r"\b(INT|STR|PATH|FLOAT|BOOL)\b|\{None", text), text
    boxed = "\n".join(line.strip("│") for line in text.splitlines() if line.startswith("│"))
    for told in re.split(r"\n (?=\S)", f"\n{boxed}")[1:]:
        _, _, words = told.strip().partition("  ")
        said = re.sub(r"\((?:required|default: .*)\)", "", words)
        # Of what nobody describes, only the name is said.
        assert len(said.split()) > 1, f"nothing is said of {told}"
