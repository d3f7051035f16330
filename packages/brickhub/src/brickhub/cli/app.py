"""Tree of commands, their errors, and the words of argument errors."""

import ast
import errno
import importlib.util
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from functools import cache
from inspect import cleandoc
from pathlib import Path
from typing import Protocol, cast

import tyro
from tyro.conf import FlagCreatePairsOff
from tyro.extras import SubcommandApp

from brickhub import HOUSES
from brickhub.cli.terminal import Interrupted, print_error, print_line, print_note
from brickhub.errors import BricksError, hint
from brickhub.fields import check_fields
from brickhub.options import check_existing


@dataclass(frozen=True)
class CommandLine:
    """A program and its commands.

    Attributes:
        prog: name of the program, also that of its distribution.
        description: help of the program as a whole.
        commands: place of each command, ``"package.module:class"``; a module is imported when its
            command is named.
        groups: help and commands of each group of commands.
        spelling: beginnings of example lines in the help, and what they are in this program.
    """

    prog: str
    version: str
    description: str
    commands: Mapping[str, str]
    groups: Mapping[str, tuple[str, Mapping[str, str]]] = field(default_factory=dict)
    spelling: Mapping[str, str] = field(default_factory=dict)


class ParsedCommand(Protocol):
    """One parsed command line."""

    def execute(self) -> int | None:
        """Run the command; returns its exit code, ``None`` for 0. Raises Interrupted if the user
        ends it."""


def run(
    line: CommandLine,
    arguments: Sequence[str],
    begin: Callable[["ParsedCommand"], None] | None = None,
) -> int:
    """Parse the arguments and run the command; a `BricksError` becomes one line on standard error.
    ``begin`` is called with it right before the command is executed."""
    try:
        if list(arguments) == ["--version"]:
            print_line(f"{line.prog} {line.version}")
            return 0
        if not arguments or arguments[0] == "help":
            arguments = [*command_words(line, arguments[1:]), "--help"]
        command = parse(line, arguments)
        check_fields(type(command), vars(command))
        check_existing(command)
        if begin is not None:
            begin(command)
        return command.execute() or 0
    except Interrupted as end:
        if str(end):
            print_note(f"interrupted: {end}")
        return 130  # as in shells
    except BricksError as error:
        print_error(str(error))
        return 2
    except OSError as error:
        if _is_unread(error):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        subject = f"{error.filename}: " if error.filename else ""
        remedy = (
            "make room on the disk"
            if error.errno == errno.ENOSPC
            else "look whether it is there and you may use it"
        )
        print_error(f"{subject}{error.strerror or error}; {remedy}")
        return 2
    except MemoryError:
        print_error("this computer has not enough memory for that; ask for less")
        return 2
    except Exception as error:
        from brickhub.user_files import failure_of_user

        message = failure_of_user(error)
        package = (getattr(error, "name", None) or line.prog).partition(".")[0]
        if message is None and isinstance(error, ModuleNotFoundError) and package not in HOUSES:
            remedy = f"install {line.prog} there again, or activate its environment"
            message = f"the package '{package}' is missing in {sys.prefix}; {remedy}"
        if message is None:
            raise  # a bug of ours: show the traceback
        print_error(message)
        return 2


def _is_unread(error: OSError) -> bool:
    """Whether the reader of our output, such as ``head``, has closed the pipe, which Windows calls
    an invalid argument."""
    is_windows = sys.platform == "win32"
    is_argument = error.errno == errno.EINVAL and error.filename is None
    return isinstance(error, BrokenPipeError) or (is_windows and is_argument)


def parse(line: CommandLine, arguments: Sequence[str]) -> ParsedCommand:
    """Parse the arguments into a command; exits like argparse for help and for invalid
    arguments."""
    words = command_words(line, arguments)
    if typed := next((word for word in arguments if word.startswith(_DASHES)), None):
        print_error(
            f"{typed} begins with the dash of a word processor; type "
            f"--{typed.lstrip(''.join(_DASHES) + '-')}"
        )
        raise SystemExit(2)
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            parsed = _parse(line, words, arguments[len(words) :])
    except SystemExit as end:
        if end.code:
            print_error(one_line(messages.getvalue(), " ".join([line.prog, *words])))
        raise
    return cast(ParsedCommand, parsed)


_DASHES = ("\N{EN DASH}", "\N{EM DASH}", "\N{MINUS SIGN}")


def _parse(line: CommandLine, words: Sequence[str], arguments: Sequence[str]) -> object:
    """Parse with the parser of the named command only, as a parser of all would have to import
    every command."""
    prog = " ".join([line.prog, *words])
    config = (FlagCreatePairsOff,)
    if not words:
        overview = _listing(line.commands)
        for name, (text, commands) in line.groups.items():
            overview.command(_listing(commands), name=name, help=text)
        return overview.cli(prog=prog, description=line.description, args=arguments, config=config)
    if words[0] in line.commands or len(words) == 2:
        command = _load(
            line.commands[words[0]] if len(words) == 1 else line.groups[words[0]][1][words[1]]
        )
        return tyro.cli(
            command, prog=prog, description=_help(line, command), args=arguments, config=config
        )
    text, commands = line.groups[words[0]]
    return _listing(commands).cli(prog=prog, description=text, args=arguments, config=config)


def _listing(commands: Mapping[str, str]) -> SubcommandApp:
    """A parser of commands, with the first line of their help."""
    app = SubcommandApp()
    for name, place in commands.items():
        app.command(name=name, help=_summaries(place.partition(":")[0])[place.partition(":")[2]])(
            lambda: None
        )
    return app


@cache
def _summaries(module: str) -> dict[str, str]:
    """First sentence of the help of each command of a module, which is not imported: that of a
    training takes long."""
    spec = importlib.util.find_spec(module)
    source = Path(cast(str, spec and spec.origin)).read_text(encoding="utf-8")
    classes = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)]
    return {node.name: _first_sentence(ast.get_docstring(node) or "") for node in classes}


def _first_sentence(text: str) -> str:
    """First sentence of a help, on one line though it is written on several; its first paragraph if
    no full stop ends one."""
    paragraph = " ".join(text.partition("\n\n")[0].split())
    sentence = re.match(r".+?\.(?=\s|$)", paragraph)
    return sentence[0] if sentence else paragraph


def _load(place: str) -> type:
    module, _, name = place.partition(":")
    command: type = getattr(importlib.import_module(module), name)
    return command


def _help(line: CommandLine, command: type) -> str:
    """Help of a command, whose examples name the program as it was called."""
    text = cleandoc(command.__doc__ or "")
    for begin, here in line.spelling.items():
        text = re.sub(rf"^(  |.*`){begin}\b", rf"\g<1>{here}", text, flags=re.MULTILINE)
    return text


def command_words(line: CommandLine, arguments: Sequence[str]) -> list[str]:
    """Leading words that name a command or a group: none, ``train``, or ``hub`` and ``scan``."""
    words = [word for word in arguments[:1] if word in {*line.commands, *line.groups}]
    group = line.groups.get(words[0]) if words else None
    if group and arguments[1:] and arguments[1] in group[1]:
        words.append(arguments[1])
    return words


_EXPECTED = {"INT": "a whole number", "FLOAT": "a number", "INT INT": "two whole numbers"}


def one_line(box: str, command: str = "bricksrl") -> str:
    """One line from the parser's boxed message: its first paragraph, and the command with the help.
    The box is drawn with hyphens if the console has no line-drawing characters."""
    lines = [re.sub(r"^-+$", "", line.strip("│╭╮╰╯─ ")) for line in box.splitlines()[1:]]
    message, *more = [
        " ".join(part.split()) for part in "\n".join(lines).split("\n\n") if part.strip()
    ] or [""]
    return f"{plain(message.removesuffix('.'))}{_suggestion(message, more)}; see `{command} --help`"


def _suggestion(message: str, more: list[str]) -> str:
    """``" (did you mean --agent?)"``: an option that the parser found, or one of the commands that
    it names."""
    for part in more:
        if match := re.match(r"Perhaps you meant: (--\S+)", part):
            return f" (did you mean {match[1]}?)"
        if match := re.match(r"Available subcommands: (.*)", part):
            return hint(
                message.rsplit(": ", maxsplit=1)[-1].split(", ", maxsplit=1)[0],
                match[1].split(", "),
            )
    return ""


def plain(message: str) -> str:
    """A message of the parser in plain words; an unknown one is returned unchanged.

    ``Error parsing --seed: invalid literal for int() with base 10: 'x'`` becomes ``--seed is 'x';
    give a whole number``.
    """
    for pattern, words in (
        (
            r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)",
            r"\1 is \2; give a whole number",
        ),
        (
            r"Error parsing (\S+): could not convert string to float: (.*)",
            r"\1 is \2; give a number",
        ),
        (r"Error parsing \S+: (.*; .*)", r"\1"),
        (
            r"Missing value for argument '(\w+)'\. Expected 1 values?",
            r"\1 is no option; give it without --\1",
        ),
        (r"Missing value for argument '(\S+)'\. Expected 1 values?", r"\1 needs a value"),
        (r"Missing value for argument '(\S+)'\. Expected (\d+) values", r"\1 needs \2 values"),
        (r"Expected one of \{(.*)\}", r"a command is missing; choose \1"),
        (r"Unrecognized options: (.*)", r"there is no option or argument \1"),
    ):
        if match := re.fullmatch(pattern, message):
            return match.expand(words)
    pattern = (
        r"Error parsing (\S+): no type matching \{None\}\|\{?([A-Z ]+)\}? could be "
        r"instantiated from \[(.*)\]"
    )
    if match := re.fullmatch(pattern, message):
        value = " ".join(re.findall(r"'([^']*)'", match[3]))
        return f"{match[1]} is '{value}'; give {_EXPECTED.get(match[2], match[2])}"
    if match := re.fullmatch(
        r"invalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)", message
    ):
        choices = sorted(
            choice for choice in re.findall(r"'([^']*)'", match[3]) if choice != "None"
        )
        return f"{match[2]} is {match[1]}; choose {', '.join(choices)}"
    if match := re.fullmatch(r"Missing from [\w -]+: (.*\(required\))", message):
        names = (re.match(r" *(--\S+ \S+|\S+)", part) for part in match[1].split("(required)"))
        missing = [name[1] for name in names if name]
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    return message
