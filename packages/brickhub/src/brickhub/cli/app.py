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
from brickhub.cli.signals import INTERRUPTED
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
        return INTERRUPTED
    # Before OSError, as some of our errors are both, and say what to do by themselves.
    except BricksError as error:
        print_error(str(error))
        return 2
    except OSError as error:
        if _is_unread(error):
            # Nobody reads any more; what Python still writes at its end must not fail again.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            return 1
        print_error(_message_of_system(error))
        return 2
    except MemoryError:
        print_error("this computer has not enough memory for that; ask for less")
        return 2
    except Exception as error:
        from brickhub.user_files import failure_of_user

        message = failure_of_user(error) or _missing_package(error, line.prog)
        # A bug of ours: show the traceback.
        if message is None:
            raise
        print_error(message)
        return 2


def _message_of_system(error: OSError) -> str:
    subject = f"{error.filename}: " if error.filename else ""
    remedy = "look whether it is there and you may use it"
    if error.errno == errno.ENOSPC:
        remedy = "make room on the disk"
    return f"{subject}{error.strerror or error}; {remedy}"


def _missing_package(error: Exception, prog: str) -> str | None:
    """Message of an error that is that of an incomplete installation; ``None`` for others."""
    if not isinstance(error, ModuleNotFoundError):
        return None
    package = (error.name or prog).partition(".")[0]
    # A module of ours that is not there is a bug, whatever is installed.
    if package in HOUSES:
        return None
    remedy = f"install {prog} there again, or activate its environment"
    return f"the package '{package}' is missing in {sys.prefix}; {remedy}"


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
    # Commands are copied out of documents, where `--` has become a dash, which no parser knows.
    for argument in arguments:
        if argument.startswith(_DASHES):
            option = argument.lstrip("".join(_DASHES) + "-")
            print_error(f"{argument} begins with the dash of a word processor; type --{option}")
            raise SystemExit(2)
    # The parser's own messages are boxes of several lines.
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            parsed = _parse(line, words, arguments[len(words) :])
    except SystemExit as end:
        if end.code:
            command = " ".join([line.prog, *words])
            print_error(one_line(messages.getvalue(), command))
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
    if words[0] in line.commands:
        place = line.commands[words[0]]
    else:
        text, commands = line.groups[words[0]]
        # A group alone: what it lacks is a command, and its help lists them.
        if len(words) == 1:
            listing = _listing(commands)
            return listing.cli(prog=prog, description=text, args=arguments, config=config)
        place = commands[words[1]]
    command = _load(place)
    return tyro.cli(
        command, prog=prog, description=_help(line, command), args=arguments, config=config
    )


def _listing(commands: Mapping[str, str]) -> SubcommandApp:
    """A parser of commands, with the first line of their help."""
    app = SubcommandApp()
    for name, place in commands.items():
        module, _, class_name = place.partition(":")
        register = app.command(name=name, help=_summaries(module)[class_name])
        # It is never called: whoever names a command gets that command's own parser.
        register(lambda: None)
    return app


@cache
def _summaries(module: str) -> dict[str, str]:
    """First sentence of the help of each command of a module, which is not imported: that of a
    training takes long."""
    spec = importlib.util.find_spec(module)
    source = Path(cast(str, spec and spec.origin)).read_text(encoding="utf-8")
    summaries = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef):
            summaries[node.name] = _first_sentence(ast.get_docstring(node) or "")
    return summaries


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
        # Only examples, which are indented, and what stands in backquotes: not words of sentences.
        text = re.sub(rf"^(  |.*`){begin}\b", rf"\g<1>{here}", text, flags=re.MULTILINE)
    return text


def command_words(line: CommandLine, arguments: Sequence[str]) -> list[str]:
    """Leading words that name a command or a group: none, ``train``, or ``hub`` and ``scan``."""
    if not arguments:
        return []
    first = arguments[0]
    if first in line.commands:
        return [first]
    if first not in line.groups:
        return []
    _, commands = line.groups[first]
    if len(arguments) > 1 and arguments[1] in commands:
        return [first, arguments[1]]
    return [first]


_EXPECTED = {"INT": "a whole number", "FLOAT": "a number", "INT INT": "two whole numbers"}
"""What an option wants, by tyro's word for it."""


def one_line(box: str, command: str = "bricksrl") -> str:
    """One line from the parser's boxed message: its first paragraph, and the command with the help.
    The box is drawn with hyphens if the console has no line-drawing characters."""
    # The first line is the upper edge with the title; rules within become empty lines.
    rows = box.splitlines()[1:]
    inner = [row.strip("│╭╮╰╯─ ") for row in rows]
    lines = [re.sub(r"^-+$", "", row) for row in inner]
    paragraphs = []
    for part in "\n".join(lines).split("\n\n"):
        # The box breaks lines at the width of the terminal.
        paragraph = " ".join(part.split())
        if paragraph:
            paragraphs.append(paragraph)
    message, *more = paragraphs or [""]
    words = plain(message.removesuffix("."))
    return f"{words}{_suggestion(message, more)}; see `{command} --help`"


def _suggestion(message: str, more: list[str]) -> str:
    """``" (did you mean --agent?)"``: an option that the parser found, or one of the commands that
    it names."""
    for part in more:
        if match := re.match(r"Perhaps you meant: (--\S+)", part):
            return f" (did you mean {match[1]}?)"
        if match := re.match(r"Available subcommands: (.*)", part):
            # The message ends with the words that are no option; the first was to be a command.
            unknown = message.rsplit(": ", maxsplit=1)[-1]
            typed = unknown.split(", ", maxsplit=1)[0]
            return hint(typed, match[1].split(", "))
    return ""


def plain(message: str) -> str:
    """A message of the parser in plain words; an unknown one is returned unchanged.

    ``Error parsing --seed: invalid literal for int() with base 10: 'x'`` becomes ``--seed is 'x';
    give a whole number``.
    """
    for pattern, words in _PLAIN_WORDS:
        if match := re.fullmatch(pattern, message):
            return match.expand(words)
    if match := re.fullmatch(_OF_NO_TYPE, message):
        option, kind, texts = match.groups()
        value = " ".join(re.findall(_QUOTED, texts))
        return f"{option} is '{value}'; give {_EXPECTED.get(kind, kind)}"
    if match := re.fullmatch(_NO_CHOICE, message):
        value, option, texts = match.groups()
        # To leave an option out is never what a message should advise.
        choices = [choice for choice in re.findall(_QUOTED, texts) if choice != "None"]
        return f"{option} is {value}; choose {', '.join(sorted(choices))}"
    if match := re.fullmatch(_MISSING, message):
        # Each an option with the placeholder of its value, or an argument's placeholder alone.
        parts = match[1].split("(required)")
        names = (re.match(r" *(--\S+ \S+|\S+)", part) for part in parts)
        missing = [name[1] for name in names if name]
        verb = "is" if len(missing) == 1 else "are"
        return f"{' and '.join(missing)} {verb} missing"
    return message


_PLAIN_WORDS = (
    (
        r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)",
        r"\1 is \2; give a whole number",
    ),
    (
        r"Error parsing (\S+): could not convert string to float: (.*)",
        r"\1 is \2; give a number",
    ),
    # What a parser of ours says has its remedy after a semicolon, and needs no other words.
    (r"Error parsing \S+: (.*; .*)", r"\1"),
    # Before the next one: a name without dashes is that of an argument that was written with them.
    (
        r"Missing value for argument '(\w+)'\. Expected 1 values?",
        r"\1 is no option; give it without --\1",
    ),
    (r"Missing value for argument '(\S+)'\. Expected 1 values?", r"\1 needs a value"),
    (r"Missing value for argument '(\S+)'\. Expected (\d+) values", r"\1 needs \2 values"),
    (r"Expected one of \{(.*)\}", r"a command is missing; choose \1"),
    (r"Unrecognized options: (.*)", r"there is no option or argument \1"),
)
"""Messages of tyro, as patterns, and what we say in their place; the first that fits counts."""
_OF_NO_TYPE = (
    r"Error parsing (\S+): no type matching \{None\}\|\{?([A-Z ]+)\}? could be "
    r"instantiated from \[(.*)\]"
)
_NO_CHOICE = r"invalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)"
_MISSING = r"Missing from [\w -]+: (.*\(required\))"
_QUOTED = r"'([^']*)'"
