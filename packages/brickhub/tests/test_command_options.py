"""Options of commands: how their texts are read, what the help shows, what is refused."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from brickhub.cli.app import CommandLine, parse
from brickhub.errors import DescriptionError
from brickhub.options import (
    Existing,
    Faults,
    Flag,
    Seed,
    changed_options,
    check_existing,
    existing_file,
    option,
    parsed,
    refuse_ignored,
)


def _there(path: Path) -> None:
    if path.name == "missing":
        raise DescriptionError(f"there is no {path}")


def _pair(text: str) -> tuple[str, str]:
    name, _, value = text.partition("=")
    return name, value


@dataclass(frozen=True)
class _Inner:
    rate: Annotated[float, option(name="rate-hz", metavar="HZ")] = 4.0


@dataclass(frozen=True)
class _Command:
    """Command of this test.

    Examples:
      test it
    """

    size: Annotated[int | None, parsed(int, "N"), option()] = None
    knobs: Annotated[dict[str, str], parsed(_pair, "NAME=VALUE", collect=dict), option()] = field(
        default_factory=dict
    )
    color: Annotated[str | None, parsed(str, "COLOR", choices=("red", "blue")), option()] = None
    fault: Faults = ()
    files: Annotated[tuple[Path, ...], option(metavar="FILE"), Existing(_there)] = ()
    seed: Seed = 0
    loud: Flag = False
    kept: Flag = True
    inner: Annotated[_Inner, tyro.conf.OmitArgPrefixes] = field(default_factory=_Inner)


LINE = CommandLine("test", "0", "Tests.", {"it": f"{__name__}:_Command"})


def command(*words: str) -> _Command:
    """The command with these options."""
    made = tyro.cli(_Command, args=words)
    assert isinstance(made, _Command)
    return made


def test_text_of_an_option_is_read() -> None:
    assert command().size is None and command("--size", "3").size == 3
    assert command("--knobs", "a=1", "--knobs", "b=2").knobs == {"a": "1", "b": "2"}
    assert command("--color", "blue").color == "blue"
    assert command("--fault", "a", "--fault", "b").fault == ("a", "b")


def test_value_is_one_word(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (("--size",), ("--size", "3", "4"), ("--color", "green")):
        with pytest.raises(SystemExit):
            command(*words)
    assert "None" not in capsys.readouterr().err, "is no choice"


def test_help_shows_placeholders_and_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command("--help")
    told = " ".join(re.sub(r"[│╭╮╰╯─]", " ", capsys.readouterr().out).split())
    for shown in ("--size N", "--knobs NAME=VALUE", "--color COLOR", "--fault FAULT", "--seed N"):
        assert shown in told
    assert "--rate-hz HZ (default: 4.0)" in told
    assert "default: None" not in told and "default: False" not in told


@pytest.mark.parametrize(
    ("words", "changed"),
    [
        ((), []),
        (("--size", "0"), ["--size"]),
        (("--loud", "--no-kept"), ["--loud", "--no-kept"]),
        (("--rate-hz", "2", "--seed", "0"), ["--rate-hz"]),
        (("--fault", "a"), ["--fault"]),
    ],
)
def test_options_that_differ_from_their_defaults(words: tuple[str, ...], changed: list[str]):
    assert list(changed_options(command(*words))) == changed
    if changed:
        with pytest.raises(DescriptionError, match=f"{changed[0]} has no effect at all; omit it"):
            refuse_ignored(command(*words), (), "at all")
    refuse_ignored(command(*words), changed, "at all")


def test_what_is_named_is_looked_for(tmp_path: Path) -> None:
    check_existing(command())
    check_existing(command("--files", "a", "b"))
    with pytest.raises(DescriptionError, match="there is no missing"):
        check_existing(command("--files", "a", "missing"))
    look = existing_file("the picture", DescriptionError, "draw it").look
    (tmp_path / "a.png").touch()
    look(tmp_path / "a.png")
    look("text of a program")
    with pytest.raises(DescriptionError, match="the picture .*draw it"):
        look(tmp_path / "b.png")


def test_command_line_finds_the_command() -> None:
    assert parse(LINE, ["it", "--size", "5"]) == _Command(size=5)
