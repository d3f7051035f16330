"""Interpreter of hub programs on CPython, with the behaviour of a hub's MicroPython."""

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType, ModuleType
from typing import Any

from brickhub.hub.transport import HubModule
from brickhub.virtual.micropython.builtins import builtin_names
from brickhub.virtual.micropython.compiler import compile_source
from brickhub.virtual.micropython.exceptions import reword
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import Console
from brickhub.virtual.micropython.transform import COMPREHENSIONS


def _unchanged(value: Any) -> Any:
    return value


def _nothing() -> None:
    return None


# The transformed program calls these hooks even where there is no machine, and no time passes.
_NO_HOOKS: dict[str, Callable[..., Any]] = {
    "@tick": _nothing,
    "@turn": _unchanged,
    "@branch": _unchanged,
    "@callee": _unchanged,
    **dict.fromkeys(COMPREHENSIONS, _unchanged),
}


class Modules(dict[str, ModuleType]):
    """Modules that a program can import, by name.

    Attributes:
        hooks: functions that the transformed program calls: ``@tick`` at each iteration of a
            ``while`` loop, so that simulated time passes in one that does not wait; and some that
            return their argument: ``@turn`` at each iteration of a ``for`` loop, ``@branch`` and
            those of `COMPREHENSIONS` with the value on which a program branches, ``@callee`` with a
            function that may be calling itself. That one raises RuntimeError if the stack is full.
        product: called after each product of floats, so that simulated time passes in a program
            that computes much.
        missing_builtins: builtin names that the hub does not have.
        find_module: returns a module of the program by its name, or ``None``.
        find_frozen: likewise a module of the firmware that is itself a program.
        namespaces: globals of the program and of its modules, added while it runs.
    """

    def __init__(
        self,
        modules: dict[str, ModuleType],
        hooks: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
        namespaces: list[dict[str, Any]] | None = None,
        missing_builtins: Collection[str] = (),
    ) -> None:
        super().__init__(modules)
        self.hooks = {**_NO_HOOKS, **hooks}
        self.product: Callable[[], None] = lambda: None
        self.missing_builtins = missing_builtins
        self.find_module: Callable[[str], HubModule | None] = lambda name: None
        self.find_frozen: Callable[[str], HubModule | None] = lambda name: None
        self.namespaces = [] if namespaces is None else namespaces


def execute(
    source: str,
    filename: str,
    modules: dict[str, ModuleType],
    console: Console,
) -> None:
    """Run a program as ``__main__`` to its end; its exceptions propagate, with the hub's messages.

    Args:
        source: the program.
        filename: its name in tracebacks, e.g. ``main.py``.
        modules: the modules that it can import, such as those of ``pybricks.modules``.
        console: its standard input and output.

    Raises:
        SyntaxError: the hub's compiler refuses the program.
        OverflowError: a constant needs more than 31 bits.
    """
    code = compile_source(source, filename)
    importable = modules if isinstance(modules, Modules) else Modules(modules)
    main = module("__main__", {})
    namespace = main.__dict__
    importable.namespaces.append(namespace)

    def find_module(name: str) -> ModuleType:
        if name == "__main__":
            return main
        if name not in importable:
            # The program's own modules come before those that are frozen into the firmware.
            found = importable.find_module(name) or importable.find_frozen(name)
            if found is None:
                raise ImportError(f"no module named '{name}'")
            imported = module(name, {"__builtins__": namespace["__builtins__"]})
            # The module is registered before it runs, so that modules can import each other.
            importable[name] = imported
            importable.namespaces.append(imported.__dict__)
            exec(compile_source(found.source, found.file), imported.__dict__)
        return importable[name]

    names = builtin_names(
        importable.namespaces,
        find_module,
        console,
        importable.hooks,
        importable.missing_builtins,
    )
    multiply = names["@mul"]

    # Only products of floats are counted among all arithmetic, because they are what a network
    # computes.
    def product(a: Any, b: Any) -> Any:
        result = multiply(a, b)
        if type(result) is float:
            importable.product()
        return result

    namespace["__builtins__"] = {**names, "@mul": product}
    try:
        exec(code, namespace)
    except Exception as error:
        # Nobody caught the error, so no `except` of the program gave it the hub's message yet.
        reword(error, importable.namespaces)
        raise
