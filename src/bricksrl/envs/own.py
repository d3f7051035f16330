"""Tasks of the user's own, named where they are written: ``my_task.py``, ``my_task.py:TASK`` or ``package.module:TASK``."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError, UnknownNameError


def is_reference(env_id: str) -> bool:
    """Whether this names a place in the user's own code rather than an environment."""
    return ":" in env_id or env_id.endswith(".py")


def load_builder(reference: str) -> Callable[..., Task]:
    """The task at a place in the user's own code, as a function of its options.

    Args:
        reference: a Python file or an importable module, a colon, and the name of a :class:`Task` in it or of a function that
            returns one; of a file that holds a single task, its name can be left out.

    Raises:
        UnknownNameError: there is no such file, module or name.
        DescriptionError: what has the name is no task, or the code raised.
    """
    place, colon, name = reference.rpartition(":")
    if not colon or name.endswith(".py"):
        place, name = reference, ""
    module = _load(place, reference)
    if not name:
        name = _only_task(module, reference)
    try:
        found = getattr(module, name)
    except AttributeError:
        raise UnknownNameError(f"there is no '{name}' in {place}; name a task that is written there") from None
    if isinstance(found, Task):
        return lambda: found
    if not callable(found):
        raise DescriptionError(f"{reference} is a {type(found).__name__} and no task; name a bricksrl.envs.Task")

    @functools.wraps(found)
    def build(**options: object) -> Task:
        task = found(**options)
        if not isinstance(task, Task):
            raise DescriptionError(f"{reference} returns a {type(task).__name__} and no task; let it return a bricksrl.envs.Task")
        return task

    return build


def _load(place: str, reference: str) -> ModuleType:
    path = Path(place)
    is_file = place.endswith(".py")
    if is_file and not path.is_file():
        raise UnknownNameError(f"there is no file {place}; give the path of the Python file with your task")
    try:
        with _importable(str(path.resolve().parent if is_file else Path.cwd())):
            return _run_file(path) if is_file else importlib.import_module(place)
    except (ImportError, ValueError) as error:
        if not is_file and getattr(error, "name", place) == place:
            raise UnknownNameError(
                f"there is no module '{place}'; give one that can be imported, or a file: my_task.py"
            ) from None
        raise DescriptionError(f"{reference} cannot be loaded ({error}); correct it") from error
    except Exception as error:
        raise DescriptionError(f"{reference} cannot be loaded ({type(error).__name__}: {error}); correct it") from error


def _run_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"bricksrl_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses of the file look it up
    spec.loader.exec_module(module)
    return module


@contextmanager
def _importable(folder: str) -> Iterator[None]:
    """What lies beside the user's file can be imported, as if Python ran that file."""
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)


def _only_task(module: ModuleType, reference: str) -> str:
    # What the file has imported is not written in it, but a task does not know where it was made: count objects, not names.
    tasks = {id(value): name for name, value in vars(module).items() if isinstance(value, Task)}
    if len(tasks) != 1:
        found = ", ".join(tasks.values()) or "none"
        raise UnknownNameError(f"{reference} has {len(tasks)} tasks ({found}); name one: {reference}:TASK")
    return next(iter(tasks.values()))
