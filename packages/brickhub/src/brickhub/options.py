"""Command-line options, for all commands: their annotations, the refusal of ignored options."""

import dataclasses
import typing
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import UseAppendAction, arg
from tyro.constructors import PrimitiveConstructorSpec

from brickhub.errors import BricksError, DescriptionError
from brickhub.fields import Range
from brickhub.files import reading
from brickhub.seed import LARGEST_SEED
from brickhub.user_files import NotCode


def _default(value: str) -> str:
    """Text of a default in the help; empty for None, flags and empty values."""
    return "" if value in ("None", "False", "True", "{}", "") else f"(default: {value})"


option = partial(arg, help_behavior_hint=_default)
"""Annotation of an option: its name and the placeholder of its value, as tyro's ``arg``."""


def parsed(
    read: Callable[[str], Any],
    metavar: str,
    collect: Callable[[Any], Any] | None = None,
    choices: tuple[str, ...] | None = None,
) -> PrimitiveConstructorSpec[Any]:
    """Annotation of an option whose text is read by a function, and may be limited to ``choices``;
    with ``collect``, of one that may be repeated, whose values go through it together.

    An option of choices that may be left out needs it: of ``Literal[...] | None`` alone tyro also
    offers the word None, and all of them in a random order.
    """

    def value(words: Any) -> Any:
        return read(words[0]) if collect is None else collect(map(read, words))

    # This is what tyro's UseAppendAction sets, so that an option may be repeated.
    action: Any = {} if collect is None else {"_action": "append"}
    return PrimitiveConstructorSpec(
        1,
        metavar,
        value,
        # A default may be of a type that tyro does not know.
        is_instance=lambda _: True,
        str_from_instance=lambda default: [str(default)] if default else [],
        choices=choices,
        **action,
    )


class SavesNothing:
    """Base of a command that has nothing to save at its end: it ends in time after one Ctrl-C."""


@dataclass(frozen=True)
class Existing:
    """Annotation of an option that names what has to be there: a file, a folder, a run.

    Attributes:
        look: called with the value, and for several with each; raises a BricksError if it is not
            there. It imports nothing that takes long, as the user waits for the answer.
    """

    look: Callable[[Any], object]


def check_existing(command: Any) -> None:
    """Look whether what the options of a command name is there, before the command imports what
    takes long. Raises a BricksError if it is not."""
    hints = typing.get_type_hints(type(command), include_extras=True)
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        if dataclasses.is_dataclass(value):
            check_existing(value)
        # An option that was left out names nothing.
        if value is None:
            continue
        named = value if isinstance(value, tuple) else (value,)
        for remark in _remarks_on(hints[field.name]):
            if isinstance(remark, Existing):
                for item in named:
                    remark.look(item)


def _remarks_on(hint: Any) -> tuple[Any, ...]:
    """Remarks of an annotation on a field, besides its type."""
    remarks: tuple[Any, ...] = getattr(hint, "__metadata__", ())
    return remarks


def existing_file(
    what: str,
    error: type[BricksError],
    remedy: str,
) -> Existing:
    """Annotation of an option that names a file to read; the error says ``what`` cannot be read,
    and the remedy."""

    def look(path: Path) -> None:
        # A program may give the thing itself, such as a Physics, instead of a file.
        if isinstance(path, Path):
            with reading(what, path, error, remedy):
                path.open("rb").close()

    return Existing(look)


Seed = Annotated[int, Range(0, LARGEST_SEED), option(metavar="N")]
"""A seed."""
Flag = Annotated[bool, option()]
"""An option without a value."""
JsonFlag = Annotated[bool, option(help="Print only one JSON object on standard output.")]
"""``--json``."""


Faults = Annotated[
    UseAppendAction[tuple[Annotated[str, NotCode()], ...]],
    option(
        metavar="FAULT",
        help="Fault of the virtual robot, to practise: battery=6.2, reversed:left, port:left=C, "
        "dead:eyes, absent:eyes, "
        "slip:left=0.5 or link=12s. May be repeated.",
    ),
]
"""``--fault``."""


def changed_options(command: Any) -> Iterator[str]:
    """Options of a command that differ from their defaults, as they are written."""
    hints = typing.get_type_hints(type(command), include_extras=True)
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        if dataclasses.is_dataclass(value):
            yield from changed_options(value)
        elif value != _default_of(field):
            # A flag that is on by default has an option that turns it off.
            no = "no-" if field.default is True else ""
            name = _name_in_help(hints[field.name]) or field.name
            yield f"--{no}{name.replace('_', '-')}"


def _default_of(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is dataclasses.MISSING:
        return field.default
    return field.default_factory()


def _name_in_help(hint: Any) -> str | None:
    """Name that an annotation gives to an option, if it is another one than that of the field."""
    for remark in _remarks_on(hint):
        name: str | None = getattr(remark, "name", None)
        if name:
            return name
    return None


def refuse_ignored(
    command: Any,
    kept: Container[str],
    mode: str,
) -> None:
    """Raise DescriptionError if an option of a command is set that has no effect in a mode, such as
    ``with --resume``."""
    for name in changed_options(command):
        if name not in kept:
            raise DescriptionError(f"{name} has no effect {mode}; omit it")
