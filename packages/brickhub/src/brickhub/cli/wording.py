"""Wording of argument errors: the parser's messages in plain words."""

from __future__ import annotations

import re

from brickhub.errors import hint

_EXPECTED = {"INT": "a whole number", "FLOAT": "a number", "INT INT": "two whole numbers"}


def one_line(box: str, command: str = "bricksrl") -> str:
    """One line from the parser's boxed message: its first paragraph, and the command with the help. The box is drawn with hyphens
    if the console has no line-drawing characters."""
    lines = [re.sub(r"^-+$", "", line.strip("│╭╮╰╯─ ")) for line in box.splitlines()[1:]]
    message, *more = [" ".join(part.split()) for part in "\n".join(lines).split("\n\n") if part.strip()] or [""]
    return f"{plain(message.removesuffix('.'))}{_suggestion(message, more)}; see `{command} --help`"


def _suggestion(message: str, more: list[str]) -> str:
    """``" (did you mean --agent?)"``: an option that the parser found, or one of the commands that it names."""
    for part in more:
        if match := re.match(r"Perhaps you meant: (--\S+)", part):
            return f" (did you mean {match[1]}?)"
        if match := re.match(r"Available subcommands: (.*)", part):
            return hint(message.rsplit(": ", maxsplit=1)[-1].split(", ", maxsplit=1)[0], match[1].split(", "))
    return ""


def plain(message: str) -> str:
    """A message of the parser in plain words; an unknown one is returned unchanged.

    ``Error parsing --seed: invalid literal for int() with base 10: 'x'`` becomes ``--seed is 'x'; give a whole number``.
    """
    for pattern, words in (
        (r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)", r"\1 is \2; give a whole number"),
        (r"Error parsing (\S+): could not convert string to float: (.*)", r"\1 is \2; give a number"),
        (r"Error parsing \S+: (.*; .*)", r"\1"),
        (r"Missing value for argument '(\w+)'\. Expected 1 values?", r"\1 is no option; give it without --\1"),
        (r"Missing value for argument '(\S+)'\. Expected 1 values?", r"\1 needs a value"),
        (r"Missing value for argument '(\S+)'\. Expected (\d+) values", r"\1 needs \2 values"),
        (r"Expected one of \{(.*)\}", r"a command is missing; choose \1"),
        (r"Unrecognized options: (.*)", r"there is no option or argument \1"),
    ):
        if match := re.fullmatch(pattern, message):
            return match.expand(words)
    pattern = r"Error parsing (\S+): no type matching \{None\}\|\{?([A-Z ]+)\}? could be instantiated from \[(.*)\]"
    if match := re.fullmatch(pattern, message):
        value = " ".join(re.findall(r"'([^']*)'", match[3]))
        return f"{match[1]} is '{value}'; give {_EXPECTED.get(match[2], match[2])}"
    if match := re.fullmatch(r"invalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)", message):
        choices = sorted(choice for choice in re.findall(r"'([^']*)'", match[3]) if choice != "None")
        return f"{match[2]} is {match[1]}; choose {', '.join(choices)}"
    if match := re.fullmatch(r"Missing from [\w -]+: (.*\(required\))", message):
        names = (re.match(r" *(--\S+ \S+|\S+)", part) for part in match[1].split("(required)"))
        missing = [name[1] for name in names if name]
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    return message
