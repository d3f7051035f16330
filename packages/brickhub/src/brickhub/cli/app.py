"""Tree of commands, their errors, and the words of argument errors."""

import ast
import errno
import importlib.util
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
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
        instead: options of some commands, such as ``--robot``, and how others say that.
    """

    prog: str
    version: str
    description: str
    commands: Mapping[str, str]
    groups: Mapping[str, tuple[str, Mapping[str, str]]] = field(default_factory=dict)
    spelling: Mapping[str, str] = field(default_factory=dict)
    instead: Mapping[str, str] = field(default_factory=dict)


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
        return _execute(line, arguments, begin)
    except Interrupted as end:
        if str(end):
            print_note(f"interrupted: {end}")
        return INTERRUPTED
    # BricksError is caught before OSError, because some of our errors are both and already say what
    # to do.
    except BricksError as error:
        print_error(str(error))
        return 2
    except OSError as error:
        _drop_unwritten()
        # Nobody reads any more.
        if _is_unread(error):
            return 1
        print_error(_message_of_system(error))
        return 2
    except MemoryError:
        print_error("this computer has not enough memory for that; ask for less")
        return 2
    except Exception as error:
        from brickhub.user_files import failure_of_user

        message = failure_of_user(error) or _missing_package(error, line.prog)
        # An error without a message is a bug of ours, so its traceback is shown.
        if message is None:
            raise
        print_error(message)
        return 2


def _execute(
    line: CommandLine,
    arguments: Sequence[str],
    begin: Callable[["ParsedCommand"], None] | None,
) -> int:
    """Parse the arguments, run the command, and write what is buffered; raises what the command
    raises, SystemExit for its help."""
    try:
        if list(arguments) == ["--version"]:
            print_line(f"{line.prog} {line.version}")
            code = 0
        else:
            if not arguments or arguments[0] == "help":
                arguments = [*command_words(line, arguments[1:]), "--help"]
            command = parse(line, arguments)
            check_fields(type(command), vars(command))
            check_existing(command)
            if begin is not None:
                begin(command)
            code = command.execute() or 0
    except SystemExit:
        sys.stdout.flush()
        raise
    # Python would do it at its end, and say what fails then in words of its own.
    sys.stdout.flush()
    return code


def _drop_unwritten() -> None:
    """Drop what cannot be written: what Python writes at its end must not fail a second time."""
    try:
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())


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
    # If one of our own modules is missing, that is a bug whatever is installed.
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
    # Commands are copied from documents in which `--` has become a dash, and no parser knows that.
    for argument in arguments:
        if argument.startswith(_DASHES):
            option = argument.lstrip("".join(_DASHES) + "-")
            print_error(f"{argument} begins with the dash of a word processor; type --{option}")
            raise SystemExit(2)
        if _is_file_like_an_option(argument):
            print_error(f"{argument} looks like an option; for the file give ./{argument}")
            raise SystemExit(2)
    message = _wrong_command(line, words, arguments[len(words) :])
    if message:
        command = " ".join([line.prog, *words])
        print_error(f"{message}; see `{command} --help`")
        raise SystemExit(2)
    # The parser writes its messages as boxes of several lines, so they are caught and shortened.
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            parsed = _parse(line, words, arguments[len(words) :])
    except SystemExit as end:
        if end.code:
            command = " ".join([line.prog, *words])
            box = messages.getvalue()
            print_error(one_line(box, command, _instead(line, words, box)))
        raise
    return cast(ParsedCommand, parsed)


def _is_file_like_an_option(argument: str) -> bool:
    """Whether a file is there whose name begins with a dash, maybe with what of it is meant."""
    name = argument.split(":", maxsplit=1)[0]
    has_ending = Path(name).suffix != ""
    return argument.startswith("-") and has_ending and Path(name).is_file()


def _wrong_command(
    line: CommandLine,
    words: Sequence[str],
    rest: Sequence[str],
) -> str | None:
    """What is wrong with the word after these ones, which is to be a command; ``None`` if nothing
    is, or the parser tells it. A parser of names alone would only say which names there are."""
    if not words:
        names = [*line.commands, *line.groups]
    elif len(words) == 1 and words[0] in line.groups:
        _, commands = line.groups[words[0]]
        names = list(commands)
    else:
        return None
    if not rest:
        return f"a command is missing; choose {', '.join(names)}"
    unknown = rest[0]
    return (
        None if unknown.startswith("-") else f"there is no command {unknown}{hint(unknown, names)}"
    )


_DASHES = ("\N{EN DASH}", "\N{EM DASH}", "\N{MINUS SIGN}")


def _parse(
    line: CommandLine,
    words: Sequence[str],
    arguments: Sequence[str],
) -> object:
    """Parse with the parser of the named command only, as a parser of all would have to import
    every command."""
    prog = " ".join([line.prog, *words])
    config = (FlagCreatePairsOff,)
    if not words:
        overview = _listing(line, line.commands)
        for name, (text, commands) in line.groups.items():
            overview.command(_listing(line, commands), name=name, help=text)
        return overview.cli(
            prog=prog,
            description=line.description,
            args=arguments,
            config=config,
        )
    if words[0] in line.commands:
        place = line.commands[words[0]]
    else:
        text, commands = line.groups[words[0]]
        # A group alone lacks a command, so its help lists the commands.
        if len(words) == 1:
            listing = _listing(line, commands)
            return listing.cli(
                prog=prog,
                description=text,
                args=arguments,
                config=config,
            )
        place = commands[words[1]]
    command = _load(place)
    return tyro.cli(
        command,
        prog=prog,
        description=_help(line, command),
        args=arguments,
        config=config,
    )


def _listing(line: CommandLine, commands: Mapping[str, str]) -> SubcommandApp:
    """A parser of commands, with the first line of their help."""
    app = SubcommandApp()
    for name, place in commands.items():
        module, _, class_name = place.partition(":")
        summary = _spelled(line, _summaries(module)[class_name])
        register = app.command(name=name, help=summary)
        # This function is never called, because whoever names a command gets its own parser.
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
    return _spelled(line, cleandoc(command.__doc__ or ""))


def _spelled(line: CommandLine, text: str) -> str:
    """A text whose examples name the program as it was called."""
    for begin, here in line.spelling.items():
        # The name is replaced only in examples, which are indented, and in backquotes, but not in
        # sentences.
        text = re.sub(
            rf"^(  |.*`){begin}\b",
            rf"\g<1>{here}",
            text,
            flags=re.MULTILINE,
        )
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


_SUGGESTS = "Perhaps you meant: "
"""Words of the parser before the option that is most like an unknown one."""
_UNKNOWN = re.compile(r"Unrecognized options: (--[\w-]+)")
_NEEDED = {
    "invalid literal for int()": "a whole number",
    "could not convert string to float": "a number",
    # "INT INT" comes before "INT", which it contains.
    "INT INT": "two whole numbers",
    "INT": "a whole number",
    "FLOAT": "a number",
}
"""What an option wants, by the words with which Python or tyro refuse its value."""
_WRONG_VALUE = re.compile(r"Error parsing (\S+): (.*?)\W*'(.*)'\W*")
"""Option, reason and value: ``Error parsing --seed: invalid literal for int() with base 10:
'x'``."""
_WRONG_COUNT = re.compile(
    r"Error parsing (\S+): no type matching .*\{((?:STR ?){2,})\} could be instantiated from "
    r"\['(.*)'\]"
)
"""Option, kinds of its values and what was given: ``Error parsing --corners: no type matching
{None}|{STR STR} could be instantiated from ['1,2']``."""
_OF_SEVERAL = re.compile(r"Error parsing [^-\s]\S*: (.*)")
"""Our error about a group of options or a whole command, after a name that no user wrote: only
options begin with dashes."""
_GIVEN_AS_OPTION = re.compile(r"Missing value for argument '(\w+)'.*")
"""An argument that was written as an option: only an argument's name has no dashes."""


def _instead(
    line: CommandLine,
    words: Sequence[str],
    box: str,
) -> str:
    """How a command says what an unknown option in the parser's message means; empty if unknown."""
    unknown = _UNKNOWN.search(box)
    instead = line.instead.get(unknown[1]) if unknown else None
    if instead is None:
        return ""
    listed = io.StringIO()
    with redirect_stdout(listed), suppress(SystemExit):
        _parse(line, words, ["--help"])
    option = instead.split()[0]
    # Not every command has that option.
    return instead if f"{option} " in listed.getvalue() else ""


def one_line(
    box: str,
    command: str = "bricksrl",
    instead: str = "",
) -> str:
    """One line from the parser's boxed message: its first paragraph, what it suggests (or
    ``instead`` of that), and the command with the help. The box is drawn with hyphens if the
    console has no line-drawing characters."""
    # The first line is the upper edge with the title. Rules inside of the box become empty lines.
    rows = box.splitlines()[1:]
    inner = [row.strip("│╭╮╰╯─ ") for row in rows]
    lines = ["" if set(row) == {"-"} else row for row in inner]
    paragraphs = []
    for part in "\n".join(lines).split("\n\n"):
        # The box breaks lines at the width of the terminal, which does not matter here.
        paragraph = " ".join(part.split())
        if paragraph:
            paragraphs.append(paragraph)
    message, *more = paragraphs or [""]
    suggestion = ""
    for part in more:
        if part.startswith(_SUGGESTS):
            option = part.removeprefix(_SUGGESTS).split()[0]
            suggestion = f" (did you mean {option}?)"
            # Further suggestions are less similar than the first one.
            break
    if instead:
        suggestion = f" (say {instead})"
    return f"{_plain(message.removesuffix('.'))}{suggestion}; see `{command} --help`"


def _plain(message: str) -> str:
    """A message of the parser, with a remedy in place of Python's words: ``--seed is 'x'; give a
    whole number``. Most say by themselves what to do, and are returned unchanged."""
    if match := _GIVEN_AS_OPTION.fullmatch(message):
        return f"{match[1]} is no option; give it without --{match[1]}"
    if match := _OF_SEVERAL.fullmatch(message):
        return match[1]
    if match := _WRONG_COUNT.fullmatch(message):
        option, needed_kinds, value = match.groups()
        given = value.replace("', '", " ")
        count = len(needed_kinds.split())
        return f"{option} is '{given}'; give {count} values with spaces between them"
    if match := _WRONG_VALUE.fullmatch(message):
        option, reason, value = match.groups()
        for words, needed in _NEEDED.items():
            if words in reason:
                given = value.replace("', '", " ")
                return f"{option} is '{given}'; give {needed}"
    return message
