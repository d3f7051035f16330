"""User's program: its file, and the modules beside it that it imports."""

from __future__ import annotations

import ast
import hashlib
import math
from collections.abc import Iterator
from pathlib import Path

from brickhub.errors import ProgramError
from brickhub.hub.program.syntax import parse
from brickhub.hub.transport import HubModule, HubProgram

_MAX_FOLDERS_ABOVE = 5


def read_program(path: Path) -> str:
    """Source of a program. Raises ProgramError if the file cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ProgramError(f"cannot read the program '{path}' ({error.strerror}); give the path of a Python file") from error
    except UnicodeDecodeError as error:
        raise ProgramError(f"the program '{path}' is no text in UTF-8 ({error.reason}); save it as UTF-8") from error


def check_time_limit(time_limit_s: float | None) -> None:
    """Check a time limit in seconds; ``None`` for no limit. Raises ProgramError if the limit is not a positive finite number."""
    if time_limit_s is not None and not 0 < time_limit_s < math.inf:
        raise ProgramError(f"the time limit is {time_limit_s} s; give a number above zero, or none")


def module_beside(path: Path, name: str) -> HubModule | None:
    """The module ``name`` (such as ``parts.arm``) beside a program; ``None`` if there is none. Raises ProgramError if the file
    cannot be read."""
    stem = "/".join(name.split("."))
    for file in (f"{stem}.py", f"{stem}/__init__.py"):
        if (path.parent / file).is_file():
            return HubModule(name, file, read_program(path.parent / file))
    return None


def folder_with_module(path: Path, name: str) -> Path | None:
    """The nearest folder above a program's that has a module which it lacks; ``None`` if there is none."""
    above = path.resolve().parents[1:_MAX_FOLDERS_ABOVE]
    return next((folder for folder in above if module_beside(folder / path.name, name)), None)


def load_program(path: Path) -> HubProgram:
    """A program for a hub, with all modules beside it that it may import. Raises ProgramError if a file cannot be read."""
    main = read_program(path)
    modules: dict[str, HubModule] = {}
    sources = [main]
    while sources:
        for name in _imported(sources.pop()):
            module = None if name in modules else module_beside(path, name)
            if module is not None:
                modules[name] = module
                sources.append(module.source)
    text = "\0".join([main, *(f"{module.name}\0{module.source}" for module in modules.values())])
    number = int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "little")
    return HubProgram(main, number, name=path.name, modules=tuple(modules.values()), says_hello=False)


def _imported(source: str) -> Iterator[str]:
    """Names of modules in all import statements; empty for invalid source, which the hub's compiler rejects later."""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and not node.level:
            yield node.module
