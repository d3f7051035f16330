"""Command lines: which words name a command, and one line for what a parser says in a box."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest

from brickhub.cli import app
from brickhub.cli.app import CommandLine, command_words, one_line, run
from brickhub.cli.terminal import print_line
from brickhub.errors import BricksError
from brickhub.options import Existing, Flag, option


def _there(name: str) -> None:
    if name != "there":
        raise BricksError(f"there is no {name}; make it")


@dataclass(frozen=True)
class Walk:
    """Walk over version 0.1 of the floor. Then stop.

    Examples:
      base walk --fast
    Type `base walk`, which base walks take.
    """

    fast: Flag = False
    steps: Annotated[int, option(metavar="N")] = 3
    robot: Annotated[str, option(metavar="ROBOT")] = ""

    def execute(self) -> int:
        return self.steps


@dataclass(frozen=True)
class Look:
    """Look around
    without a full stop"""

    far: Flag = False
    mark: Annotated[str | None, option(metavar="FILE"), Existing(_there)] = None

    def execute(self) -> None:
        print_line("seen")


LINE = CommandLine(
    "tool",
    "1.2",
    "Tools of this test.",
    {"walk": f"{__name__}:Walk", "look": f"{__name__}:Look"},
    {"hub": ("Hubs.", {"look": f"{__name__}:Look"})},
    spelling={"base": "tool of mine"},
    instead={"--env": "--robot NAME"},
)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], []),
        (["walk"], ["walk"]),
        (["walk", "look"], ["walk"]),
        (["hub"], ["hub"]),
        (["hub", "look", "--far"], ["hub", "look"]),
        (["hub", "walk"], ["hub"]),
        (["fly"], []),
        (["--help", "walk"], []),
    ],
)
def test_leading_words_name_a_command(arguments: list[str], words: list[str]) -> None:
    assert command_words(LINE, arguments) == words


def ended(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int | str | None, str]:
    """Exit code of a command line, and what it said on standard error."""
    try:
        code: int | str | None = run(LINE, arguments)
    except SystemExit as end:
        code = end.code
    return code, capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("hub",), "a command is missing; choose look; see `tool hub --help`"),
        (("hub", "loko"), "there is no command loko (did you mean 'look'?); see `tool hub --help`"),
        (("wlak",), "there is no command wlak (did you mean 'walk'?); see `tool --help`"),
        (("xyz",), "there is no command xyz; see `tool --help`"),
        (("--x",), "Unrecognized options: --x; see `tool --help`"),
        (
            ("walk", "\N{EN DASH}fast"),
            "\N{EN DASH}fast begins with the dash of a word processor; type --fast",
        ),
        (
            ("walk", "\N{EM DASH}-fast"),
            "\N{EM DASH}-fast begins with the dash of a word processor; type --fast",
        ),
        (("walk", "--steps", "x"), "--steps is 'x'; give a whole number; see `tool walk --help`"),
        (
            ("walk", "--fsat"),
            "Unrecognized options: --fsat (did you mean --fast?); see `tool walk --help`",
        ),
        (
            ("walk", "--env"),
            "Unrecognized options: --env (say --robot NAME); see `tool walk --help`",
        ),
        (("hub", "look", "--env"), "Unrecognized options: --env; see `tool hub look --help`"),
    ],
)
def test_wrong_words_are_told_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    code, err = ended(capsys, *arguments)
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err.removeprefix("error: ").rstrip("\n") == said


@pytest.mark.parametrize(
    ("arguments", "code", "out"),
    [
        (("--version",), 0, "tool 1.2\n"),
        (("walk",), 3, ""),
        (("walk", "--steps", "0"), 0, ""),
        (("hub", "look"), 0, "seen\n"),
    ],
)
def test_exit_code_is_that_of_the_command(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], code: int, out: str
) -> None:
    assert run(LINE, arguments) == code
    assert capsys.readouterr().out == out


def test_what_is_named_has_to_be_there_before_the_command_begins(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(LINE, ("look", "--mark", "there")) == 0
    begun: list[object] = []
    capsys.readouterr()
    assert run(LINE, ("look", "--mark", "gone"), begun.append) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "error: there is no gone; make it\n")
    assert begun == []


def test_command_is_handed_over_before_it_begins() -> None:
    begun: list[object] = []
    assert run(LINE, ("walk", "--fast"), begun.append) == 3
    assert begun == [Walk(fast=True)]


def test_help_names_the_program_as_it_was_called(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run(LINE, ("help", "walk"))
    out = capsys.readouterr().out
    assert out.startswith("usage: tool walk")
    assert "\n  tool of mine walk --fast" in out
    # Only in examples and backquotes, not in sentences.
    assert "`tool of mine walk`, which base walks take." in " ".join(out.split())


@pytest.mark.parametrize("arguments", [(), ("help",), ("--help",)])
def test_help_lists_commands_and_groups(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as end:
        run(LINE, arguments)
    assert not end.value.code
    out = " ".join(capsys.readouterr().out.split())
    assert out.startswith("usage: tool ")
    for told in ("Tools of this test.", "Walk over version 0.1 of the floor.", "Hubs."):
        assert told in out
    assert "Then stop." not in out


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("One. Two.", "One."),
        ("Version 0.1 is old. New.", "Version 0.1 is old."),
        ("Ends\nhere.\n\nMore.", "Ends here."),
        ("No end\nat all\n\nMore.", "No end at all"),
        ("", ""),
    ],
)
def test_first_sentence_of_a_help(text: str, sentence: str) -> None:
    assert app._first_sentence(text) == sentence


def boxed(*rows: str) -> str:
    """A message as the parser draws it."""
    width = max(map(len, rows), default=0)
    lines = [f"╭─ Error {'─' * width}╮"]
    lines += [f"│ {row:{width}} │" for row in rows]
    lines.append(f"╰{'─' * (width + 8)}╯")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (("It is", "wrong."), "It is wrong"),
        (("It is wrong.", "────", "For full helptext, see there."), "It is wrong"),
        (("First.", "", "Second."), "First"),
        (
            ("Unrecognized options: --sed", "────", "Perhaps you meant: --seed", "", "or --set"),
            "Unrecognized options: --sed (did you mean --seed?)",
        ),
        (
            ("Error parsing --seed: invalid literal for int() with base 10: 'x'",),
            "--seed is 'x'; give a whole number",
        ),
        (
            ("Error parsing --rate: could not convert string to float: 'x'",),
            "--rate is 'x'; give a number",
        ),
        (
            (
                "Error parsing --corners: no type matching {None}|{STR STR} could be instantiated",
                "from ['1,2']",
            ),
            "--corners is '1,2'; give 2 values with spaces between them",
        ),
        (
            (
                "Error parsing --place: no type matching {STR STR STR} could be instantiated from",
                "['1', '2']",
            ),
            "--place is '1 2'; give 3 values with spaces between them",
        ),
        (("Error parsing group: count is 0; give 1",), "count is 0; give 1"),
        (
            ("Missing value for argument 'target'. Expected 1",),
            "target is no option; give it without --target",
        ),
        (
            ("Error parsing --kind: 'x' is none of them",),
            "Error parsing --kind: 'x' is none of them",
        ),
    ],
)
def test_box_in_one_line(rows: tuple[str, ...], said: str) -> None:
    assert one_line(boxed(*rows), "tool walk") == f"{said}; see `tool walk --help`"
    # Where the console has no such characters, the box is drawn with hyphens.
    plain = boxed(*rows).translate(str.maketrans("╭╮╰╯─│", "----- "))
    assert one_line(plain, "tool walk") == f"{said}; see `tool walk --help`"


def test_what_to_say_instead_goes_before_a_suggestion() -> None:
    box = boxed("Unrecognized options: --env", "────", "Perhaps you meant: --end")
    assert one_line(box, "tool", "--robot NAME") == (
        "Unrecognized options: --env (say --robot NAME); see `tool --help`"
    )
    assert one_line("", "tool") == "; see `tool --help`"


def test_file_that_begins_with_a_dash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-odd.py").touch()
    (tmp_path / "--fast").touch()
    for argument in ("-odd.py", "-odd.py:ROBOT"):
        code, err = ended(capsys, "walk", argument)
        looks = f"error: {argument} looks like an option; for the file give ./{argument}\n"
        assert (code, err) == (2, looks)
    # What has no ending is an option.
    assert run(LINE, ("walk", "--fast")) == 3
    assert not app._is_file_like_an_option("-none.py")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            ModuleNotFoundError("x", name="scipy.linalg"),
            "the package 'scipy' is missing in ",
        ),
        (ModuleNotFoundError("x"), "the package 'tool' is missing in "),
        (ModuleNotFoundError("x", name="brickhub.nothing"), None),
        (ImportError("x", name="scipy"), None),
        (ValueError("x"), None),
    ],
)
def test_missing_package_is_named_unless_it_is_ours(error: Exception, said: str | None) -> None:
    found = app._missing_package(error, "tool")
    if said is None:
        assert found is None
        return
    assert found is not None
    assert found.startswith(said)
    assert found.endswith("; install tool there again, or activate its environment")


def test_words_of_the_system() -> None:
    full = OSError(errno.ENOSPC, "No space left")
    assert app._message_of_system(full) == "No space left; make room on the disk"
    other = OSError(errno.ENOENT, "No such file", "a.csv")
    remedy = "look whether it is there and you may use it"
    assert app._message_of_system(other) == f"a.csv: No such file; {remedy}"
    assert app._message_of_system(OSError("odd")) == f"odd; {remedy}"


def test_error_of_ours_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: Look) -> None:
        raise BricksError("it is\nbroken; mend it")

    monkeypatch.setattr(Look, "execute", fail)
    assert run(LINE, ("look",)) == 2
    assert capsys.readouterr().err == "error: it is broken; mend it\n"


@pytest.mark.parametrize(
    ("words", "err"), [("it is saved", "interrupted: it is saved\n"), ("", "")]
)
def test_interrupted_command_says_what_is_saved(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: str, err: str
) -> None:
    def fail(self: Look) -> None:
        raise app.Interrupted(words)

    monkeypatch.setattr(Look, "execute", fail)
    assert run(LINE, ("look",)) == 130
    assert capsys.readouterr().err == err


def test_bug_of_ours_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app, "_execute", lambda *_: 1 / 0)
    monkeypatch.setattr("brickhub.user_files.failure_of_user", lambda error: None)
    with pytest.raises(ZeroDivisionError):
        run(LINE, ("look",))
