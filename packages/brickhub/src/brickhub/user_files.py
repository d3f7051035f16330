"""Loading of objects from the user's code: ``my_robot.py``, ``my_robot.py:ROBOT``,
``package.module:ROBOT``."""

import contextlib
import importlib
import importlib.util
import os
import re
import sys
import types
import typing
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from brickhub import HOUSES
from brickhub.errors import BricksError, DescriptionError, UnknownNameError, message_of
from brickhub.robot import Robot
from brickhub.user_lines import line_of_user


@dataclass(frozen=True)
class NotCode:
    """Annotation of a text that names no code of the user's, such as an address or a folder; see
    `code_names`.

    Attributes:
        known: the only texts of which that is true, such as our own names; ``None`` for all texts.
    """

    known: Container[str] | None = None


def code_names(value: object, hint: object = None) -> Iterator[str]:
    """Texts in a value from a file, at any depth, that may name code of the user's.

    A text is known not to name any only where its annotation says so: by `NotCode`, or as one of a
    ``Literal``. All others may, in whatever form, and so may the texts of fields that are not
    declared.

    Args:
        value: plain values, as of JSON.
        hint: its annotation; of a table, the dataclass that is made of it, or the annotations of
            its fields by name.
    """
    alternatives = list(_alternatives_of(hint))
    if isinstance(value, str):
        is_harmless = any(_is_harmless(value, alternative) for alternative in alternatives)
        if value and not is_harmless:
            yield value
    elif isinstance(value, Mapping):
        fields = _fields_of(alternatives)
        for name, item in value.items():
            if fields is None:
                # Names of a table that is not declared are the file's own, and may be anything.
                yield from code_names(name)
                yield from code_names(item)
            else:
                # A field that is not declared has no annotation, so its texts count as code.
                yield from code_names(item, fields.get(name))
    elif isinstance(value, list | tuple):
        item_hint = _item_hint_of(alternatives)
        for item in value:
            yield from code_names(item, item_hint)


def _fields_of(alternatives: list[object]) -> Mapping[str, object] | None:
    """Annotations of a table's fields by name; ``None`` if they are not declared."""
    for alternative in alternatives:
        if isinstance(alternative, Mapping):
            return alternative
        if isinstance(alternative, type) and is_dataclass(alternative):
            return typing.get_type_hints(alternative, include_extras=True)
    return None


def _item_hint_of(alternatives: list[object]) -> object:
    """Annotation of the items of a tuple; ``None`` if it is no tuple's."""
    for alternative in alternatives:
        if typing.get_origin(alternative) is tuple:
            return typing.get_args(alternative)[0]
    return None


def _alternatives_of(hint: object) -> Iterator[object]:
    """The alternatives of an annotation, and what is said of them."""
    # Only an Annotated has this attribute.
    if hasattr(hint, "__metadata__"):
        yield from hint.__metadata__
        hint = getattr(hint, "__origin__", hint)
    # An alternative may itself be annotated, as in `Annotated[str, NotCode()] | None`.
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        for alternative in typing.get_args(hint):
            yield from _alternatives_of(alternative)
    else:
        yield hint


def _is_harmless(text: str, alternative: object) -> bool:
    if isinstance(alternative, NotCode):
        return alternative.known is None or text in alternative.known
    is_choice = typing.get_origin(alternative) is typing.Literal
    return is_choice and text in typing.get_args(alternative)


PLAN_ENDINGS = (".ldr", ".mpd", ".io")
"""Endings of building plans, which are no code: what is named in one is a thing that its robot can
learn."""
_FILE_ENDINGS = (".py", *PLAN_ENDINGS)


def is_reference(env_id: str) -> bool:
    """True if this refers to the user's code rather than to a registered name: only such a text can
    be loaded."""
    return ":" in env_id or env_id.endswith(".py")


def with_absolute_file(reference: str) -> str:
    """A reference with the absolute path of its file, without ``..``, for use in any folder; names
    and modules as they are."""
    location, name = _parts(reference)
    if not _is_file(location):
        return reference
    path = os.path.abspath(location)  # noqa: PTH100  Path.resolve follows links
    return f"{path}:{name}" if name else path


def without_folder(reference: str) -> str:
    """A reference with only the name of its file, for display and for other computers; names and
    modules as they are."""
    location, _ = _parts(reference)
    return Path(reference).name if _is_file(location) else reference


def without_name(reference: str) -> str:
    """The file or module of a reference, without the name in it."""
    return _parts(reference)[0]


def load_object(
    reference: str,
    default: str | type,
    *,
    missing: str = "write one there",
    noun: str = "",
) -> Any:
    """Object of that name in the user's code.

    Args:
        reference: a Python file or an importable module, a colon, and the name; for a file the name
            may be omitted.
        default: the name where it is omitted, or the type of the file's only object of that type.
        missing: what to do where a file has no object of that type, for the message.
        noun: what an object of that type is called in messages; by default the type's name.

    Raises:
        UnknownNameError: there is no such file, module or name, or this is no reference.
        DescriptionError: the code raised.
    """
    if not is_reference(reference):
        raise UnknownNameError(
            f"'{reference}' names no Python file; give FILE.py, FILE.py:NAME or module:NAME"
        )
    location, name = _parts(reference)
    if location.lower().endswith(PLAN_ENDINGS):
        # A plan is no code: what is named in one must never be looked for in a module.
        raise UnknownNameError(
            f"'{reference}' names something in a building plan, which is no Python file; give the "
            f"plan alone, {location}, or a Python file"
        )
    module = _load(location, reference)
    if isinstance(default, type):
        noun = noun or default.__name__.lower()
        if not name:
            return _only(
                default,
                module,
                location,
                missing,
                noun,
            )
    name = name or str(default)
    try:
        return getattr(module, name)
    except AttributeError:
        wanted = "what" if isinstance(default, str) else f"a {noun} that"
        raise UnknownNameError(
            f"there is no '{name}' in {location}; name {wanted} is written there"
        ) from None


def objects_in(reference: str, kind: type) -> dict[str, Any]:
    """All objects of a type in the file or module of a reference, by name, or by where they are in
    a list, tuple, set or dictionary, such as ``MATS[0]``; aliases of one object count once. Raises
    as `load_object`."""
    location, _ = _parts(reference)
    return _objects_of(_load(location, reference), kind)


def _objects_of(module: ModuleType, kind: type) -> dict[str, Any]:
    """Objects of a type in a module that is loaded, as by `objects_in`."""
    # Objects are compared by identity, because equal robots may be two, and not every object has a
    # hash.
    found: dict[int, tuple[str, Any]] = {}
    contents = {name: value for name, value in vars(module).items() if not name.startswith("__")}
    for name, value in contents.items():
        if isinstance(value, kind):
            found[id(value)] = (name, value)
    walked: set[int] = set()
    for name, value in contents.items():
        for place, item in _items_within(name, value, walked):
            # A name of its own tells more than a place in a list, so it is looked for first.
            if isinstance(item, kind) and id(item) not in found:
                found[id(item)] = (place, item)
    return dict(found.values())


def _has_star_import(module: ModuleType) -> bool:
    """Whether a module imports all names of another one."""
    if not module.__file__:
        return False
    text = Path(module.__file__).read_text(encoding="utf-8", errors="replace")
    return re.search(r"^from\s+\S+\s+import\s+\*", text, re.MULTILINE) is not None


def _is_ours(name: str, value: object) -> bool:
    """Whether a module of ours has this very object by this name."""
    ours = [
        module
        for module_name, module in list(sys.modules.items())
        if module_name.partition(".")[0] in HOUSES
    ]
    return any(vars(module).get(name) is value for module in ours)


def _items_within(
    place: str,
    value: object,
    walked: set[int],
) -> Iterator[tuple[str, object]]:
    """Everything in a list, tuple, set or dictionary, at any depth, by its place. A container that
    was walked before has nothing new."""
    if not isinstance(value, list | tuple | set | frozenset | dict) or id(value) in walked:
        return
    walked.add(id(value))
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        inner = f"{place}[{key!r}]"
        yield inner, item
        yield from _items_within(inner, item, walked)


def _parts(reference: str) -> tuple[str, str]:
    """File or module, and the name in it, which may be empty."""
    location, colon, name = reference.rpartition(":")
    # The colon in `C:\robots\mine.py` belongs to a drive of Windows.
    if not colon or _is_file(name):
        return reference, ""
    return location, name


def _is_file(location: str) -> bool:
    """Whether this is a file, and no module."""
    return location.lower().endswith(_FILE_ENDINGS)


def check_there(reference: str) -> None:
    """Check that the file of a reference is there. Raises UnknownNameError if not, or if the
    reference is empty, as a variable of a shell is that was never set."""
    if not reference.strip():
        raise UnknownNameError(
            f"the name '{reference}' is empty; give one, or leave the option out"
        )
    location, _ = _parts(reference)
    path = Path(location)
    if not _is_file(location) or path.is_file():
        return
    kind = "Python file" if location.lower().endswith(".py") else "plan"
    if path.is_absolute():
        raise UnknownNameError(
            f"there is no file {location}; put it there, or give the path of another {kind}"
        )
    remedy = f"give the path of a {kind}, or go to the right folder"
    raise UnknownNameError(f"there is no file {location} in {Path.cwd()}; {remedy}")


def load_robot(reference: str) -> Robot:
    """Robot in the user's code; the name may be omitted for a file with a single robot. Raises as
    `load_object`, and DescriptionError if the named object is no robot."""
    robot = load_object(reference, Robot)
    if not isinstance(robot, Robot):
        raise DescriptionError(f"{reference} is not a robot; name a Robot that is written there")
    return robot


def _load(location: str, reference: str) -> ModuleType:
    is_file = location.endswith(".py")
    check_there(reference)
    try:
        with beside(reference):
            return _run_file(Path(location)) if is_file else importlib.import_module(location)
    except (Exception, SystemExit) as error:
        # A script may end the program, which must not end this one.
        # The name in the error tells whether the module itself is missing or something that it
        # imports. A name that no module can have, such as "", raises ValueError instead.
        is_import = isinstance(error, ImportError | ValueError)
        if is_import and not is_file and getattr(error, "name", location) == location:
            remedy = "give one that can be imported, or a file: my_task.py"
            raise UnknownNameError(f"there is no module '{location}'; {remedy}") from None
        # The message of a failed import is a sentence by itself, but others say little without
        # their type.
        kind = "" if is_import else f"{type(error).__name__}: "
        what = f"{kind}{error}{line_of_user(error)}"
        raise DescriptionError(f"{reference} cannot be loaded ({what}); correct it") from error


@contextlib.contextmanager
def beside(reference: str) -> Iterator[None]:
    """Context in which Python finds what is beside a user's file, or in the present folder, as if
    it ran that file."""
    location, _ = _parts(reference)
    is_file = location.endswith(".py")
    folder = Path(location).resolve().parent if is_file else Path.cwd()
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))


@contextlib.contextmanager
def calling(
    reference: str,
    failing: str,
    *,
    is_of_user: bool = True,
) -> Iterator[None]:
    """Raise DescriptionError, with the line, where the user's code raises in this context;
    ``failing``: what it then does. Errors of ours, and of code that is not the user's, are raised
    as they are."""
    try:
        yield
    except Exception as error:
        if isinstance(error, BricksError) or not is_of_user:
            raise
        what = f"{message_of(error, typed=True)}{line_of_user(error)}"
        raise DescriptionError(f"{reference} {failing} ({what}); correct it") from error


def failure_of_user(error: BaseException) -> str | None:
    """One-line message of an exception raised in the user's files; ``None`` for any other."""
    line = line_of_user(error)
    if not line:
        return None
    return f"{type(error).__name__}: {error}{line}; correct it"


def _run_file(path: Path) -> ModuleType:
    # The module gets a name of its own, so that a file called json.py hides no module of that name.
    spec = importlib.util.spec_from_file_location(f"bricksrl_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses of the file look their module up here.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _only(
    type_: type,
    module: ModuleType,
    location: str,
    missing: str,
    noun: str,
) -> Any:
    """The only object of a type in a module. Raises UnknownNameError for none or several."""
    # An object does not record which module defines it, so imported ones count too.
    objects = _objects_of(module, type_)
    # But `from brickhub.robot import *` brings a bench that nobody asked for.
    if _has_star_import(module):
        own = {name: value for name, value in objects.items() if not _is_ours(name, value)}
        objects = own or objects
    named = [name for name in objects if name.isidentifier()]
    # Objects with names go before those in a list, such as the robots of a whole class.
    names = named or list(objects)
    if len(names) == 1:
        return objects[names[0]]
    if not names:
        raise UnknownNameError(f"{location} has no {noun}; {missing}")
    known = ", ".join(names)
    remedy = f"name one: {location}:{noun.upper()}"
    if not named:
        example = f"{noun.upper()} = {names[0]}"
        remedy = f"give one a name of its own, {example}, and name it: {location}:{noun.upper()}"
    raise UnknownNameError(f"{location} has {len(names)} {noun}s ({known}); {remedy}")
