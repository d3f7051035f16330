"""Wording of argument errors: the parser's messages in plain words."""

from __future__ import annotations

import re

from bricksrl.errors import hint

_WANTED = {"INT": "a whole number", "FLOAT": "a number", "INT INT": "two whole numbers"}


def one_line(box: str, command: str = "bricksrl") -> str:
    """One line from the parser's boxed message: its first paragraph, and the command with the help."""
    lines = [line.strip("│╭╮╰╯─ ") for line in box.splitlines()[1:]]
    message, *more = [" ".join(part.split()) for part in "\n".join(lines).split("\n\n")] or [""]
    return f"{plain(message.removesuffix('.'))}{_meant(message, more)}; see `{command} --help`"


def _meant(message: str, more: list[str]) -> str:
    """``" (did you mean --agent?)"``: an option that the parser found, or one of the commands that it names."""
    for part in more:
        if found := re.match(r"Perhaps you meant: (--\S+)", part):
            return f" (did you mean {found[1]}?)"
        if found := re.match(r"Available subcommands: (.*)", part):
            return hint(message.rsplit(": ", maxsplit=1)[-1].split(", ", maxsplit=1)[0], found[1].split(", "))
    return ""


def plain(message: str) -> str:
    """A message of the parser in plain words; an unknown one is returned unchanged.

    ``Error parsing --seed: invalid literal for int() with base 10: 'x'`` becomes ``--seed is 'x'; give a whole number``.
    """
    for pattern, words in (
        (r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)", r"\1 is \2; give a whole number"),
        (r"Error parsing (\S+): could not convert string to float: (.*)", r"\1 is \2; give a number"),
        (r"Missing value for argument '(\S+)'\. Expected 1 values?", r"\1 needs a value"),
        (r"Missing value for argument '(\S+)'\. Expected (\d+) values", r"\1 needs \2 values"),
        (r"Expected one of \{(.*)\}", r"a command is missing; choose \1"),
        (r"Unrecognized options: (.*)", r"there is no option or argument \1"),
    ):
        found = re.fullmatch(pattern, message)
        if found:
            return found.expand(words)
    found = re.fullmatch(
        r"Error parsing (\S+): no type matching \{None\}\|\{?([A-Z ]+)\}? could be instantiated from \[(.*)\]", message
    )
    if found:
        given = " ".join(re.findall(r"'([^']*)'", found[3]))
        return f"{found[1]} is '{given}'; give {_WANTED.get(found[2], found[2])}"
    found = re.fullmatch(r"invalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)", message)
    if found:
        choices = sorted(choice for choice in re.findall(r"'([^']*)'", found[3]) if choice != "None")
        return f"{found[2]} is {found[1]}; choose {', '.join(choices)}"
    found = re.fullmatch(r"Missing from [\w -]+: (.*\(required\))", message)
    if found:
        names = (re.match(r" *(--\S+ \S+|\S+)", part) for part in found[1].split("(required)"))
        missing = [name[1] for name in names if name]
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    return message
