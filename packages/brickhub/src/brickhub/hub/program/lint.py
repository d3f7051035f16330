"""Linter of hub programs: finds Python features that the hub lacks, before a program is sent.

It is static and therefore incomplete; ``compile_mpy`` finds further syntax errors. Sources: the firmware's MicroPython
configuration and the Pybricks documentation, both of Pybricks 4.
"""

from __future__ import annotations

import ast
import builtins
import warnings
from collections.abc import Iterator

from brickhub.errors import ProgramError
from brickhub.finding import Finding, Outcome
from brickhub.robot import HubKind
from brickhub.tables import read_table

_SMALL_INT_MAX = 2**30 - 1

_MODULES_EVERYWHERE = {"pybricks", "uerrno"}
_LARGER_MODULES = {"gc", "micropython", "uio", "ujson", "umath", "urandom", "uselect", "ustruct", "usys"}
_PYBRICKS_MODULES = {"hubs", "iodevices", "messaging", "parameters", "pupdevices", "robotics", "tools"}
_HUB_CLASSES = {"PrimeHub", "InventorHub", "EssentialHub", "TechnicHub", "CityHub", "MoveHub", "EV3Brick", "NXTBrick", "ThisHub"}

_BUILTINS = frozenset(
    """
    abs all any bin bool bytes callable chr classmethod dict dir divmod eval exec getattr globals hasattr hash hex id int
    isinstance issubclass iter len list locals map max min next object oct ord pow print range repr round setattr sorted
    staticmethod str sum super tuple type zip Ellipsis True False None __name__
    ArithmeticError AssertionError AttributeError BaseException EOFError Exception GeneratorExit ImportError
    IndentationError IndexError KeyError KeyboardInterrupt LookupError MemoryError NameError NotImplementedError OSError
    OverflowError RuntimeError StopAsyncIteration StopIteration SyntaxError SystemExit TypeError ValueError
    ZeroDivisionError
    """.split()  # noqa: SIM905  a list would take four times the lines
)
_LARGER_BUILTINS = {"bytearray", "complex", "enumerate", "float", "help", "input", "reversed", "set", "slice"}
_HUBS_WITH_MEMORYVIEW = {HubKind.PRIME, HubKind.ESSENTIAL}

_MISSING_MODULE_NAMES = {("usys", name) for name in ("argv", "exit", "exc_info", "modules", "path")} | {
    ("umath", name) for name in ("comb", "dist", "erf", "factorial", "gamma", "gcd", "hypot", "inf", "nan", "prod", "tau")
}
_MISSING = {(row["kind"], row["name"]): row["remedy"] for row in read_table(__package__, "missing")}
"""What to do instead of a module or an attribute that a hub lacks, by kind and name."""


def lint(source: str, hub: HubKind) -> tuple[Finding, ...]:
    """All findings in a program for that kind of hub, by line."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = error.lineno if isinstance(error, SyntaxError) else None
        return (_finding(line or 1, f"this is not Python ({error}); correct the program"),)
    checker = _Checker(tree, hub)
    messages = {(getattr(node, "lineno", 1), message) for node in ast.walk(tree) for message in checker.messages(node)}
    return tuple(_finding(line, message) for line, message in sorted(messages))


def require_clean(source: str, hub: HubKind) -> None:
    """Require that a program has no findings. Raises ProgramError if there are findings; the message has the first and their
    number."""
    findings = lint(source, hub)
    if findings:
        more = f" ({len(findings)} findings in all)" if len(findings) > 1 else ""
        raise ProgramError(f"the program cannot run on the {hub.value} hub: {findings[0]}{more}")


def _finding(line: int, message: str) -> Finding:
    return Finding(f"line {line}", Outcome.ERROR, message)


class _Checker:
    def __init__(self, tree: ast.Module, hub: HubKind) -> None:
        self._hub = hub
        self._is_small = not hub.model.has_float  # such firmware has no streams, struct or sets either
        self._bound = set(_bound_names(tree))
        self._builtins = set(_BUILTINS)
        self._modules = set(_MODULES_EVERYWHERE)
        if not self._is_small:
            self._builtins |= _LARGER_BUILTINS
            self._modules |= _LARGER_MODULES
        if hub in _HUBS_WITH_MEMORYVIEW:
            self._builtins.add("memoryview")

    def messages(self, node: ast.AST) -> Iterator[str]:
        """Findings in one node, without its children."""
        match node:
            case ast.Import(names=names):
                for alias in names:
                    yield from self._module(alias.name)
            case ast.ImportFrom(module=module, names=names, level=level):
                yield from self._import_from(module or "", [alias.name for alias in names], level)
            case ast.Name(id=name, ctx=ast.Load()):
                yield from self._name(name)
            case ast.Attribute():
                yield from self._attribute(node)
            case ast.Constant(value=value):
                yield from self._constant(value)
            case ast.BinOp():
                yield from self._operation(node)
            case _:
                yield from self._syntax(node)

    def _syntax(self, node: ast.AST) -> Iterator[str]:
        match node:
            case ast.ClassDef(bases=bases, keywords=keywords):
                if len(bases) > 1:
                    yield f"class {node.name} has {len(bases)} bases; a hub allows one"
                if keywords:
                    yield f"class {node.name} has keyword arguments such as metaclass; omit them"
            case ast.Set() | ast.SetComp() if self._is_small:
                yield f"the {self._hub.value} hub has no sets; use a dict or a tuple"
            case ast.Match():
                yield "a hub has no match statement; use if and elif"
            case ast.TryStar():
                yield "a hub has no exception groups; use except"
            case ast.arguments(posonlyargs=[_, *_]):
                yield "a hub has no positional-only parameters; take the / out"

    def _module(self, name: str) -> Iterator[str]:
        top, _, rest = name.partition(".")
        if top not in self._modules:
            remedy = _MISSING.get(("module", top), "put what you need of it into the program")
            yield f"the {self._hub.value} hub has no module {top}; {remedy}"
        elif top == "pybricks" and rest and rest not in _PYBRICKS_MODULES:
            yield f"there is no pybricks.{rest} on the {self._hub.value} hub; there are {', '.join(sorted(_PYBRICKS_MODULES))}"

    def _import_from(self, module: str, names: list[str], level: int) -> Iterator[str]:
        if level:
            yield "a hub has no relative imports; put all into one file"
            return
        yield from self._module(module)
        valid = {self._hub.model.class_name, "ThisHub"} | ({"InventorHub"} if self._hub is HubKind.PRIME else set())
        for name in names:
            if (module, name) in _MISSING_MODULE_NAMES:
                yield f"there is no {module}.{name} on a hub; {_exit_remedy(name)}"
            if module == "pybricks.hubs" and name in _HUB_CLASSES - valid:
                yield f"{name} is not this hub; the {self._hub.value} hub has {self._hub.model.class_name}"

    def _name(self, name: str) -> Iterator[str]:
        if name in self._bound or name in self._builtins:
            return
        if hasattr(builtins, name):
            yield f"the {self._hub.value} hub has no {name}; write it another way"
        elif "*" not in self._bound:
            yield f"the name {name} is never defined; define or import it"

    def _attribute(self, node: ast.Attribute) -> Iterator[str]:
        if node.attr in self._bound:
            return
        if isinstance(node.value, ast.Name) and (node.value.id, node.attr) in _MISSING_MODULE_NAMES:
            yield f"there is no {node.value.id}.{node.attr} on a hub; {_exit_remedy(node.attr)}"
        elif ("attribute", node.attr) in _MISSING:
            yield f"there is no attribute {node.attr} on a hub; {_MISSING['attribute', node.attr]}"

    def _constant(self, value: object) -> Iterator[str]:
        if type(value) is int and value > _SMALL_INT_MAX:
            yield f"{value} needs a long integer, and a hub's end at {_SMALL_INT_MAX}; use smaller numbers or bytes"
        elif isinstance(value, (float, complex)) and self._is_small:
            yield f"the {self._hub.value} hub has no floating point numbers; use integers"

    def _operation(self, node: ast.BinOp) -> Iterator[str]:
        if isinstance(node.op, ast.Div) and self._is_small:
            yield f"the {self._hub.value} hub cannot divide with /; use //"
        left, right = _integer(node.left), _integer(node.right)
        if left is None or right is None or not right >= 0:
            return
        match node.op:
            case ast.LShift():
                largest = abs(left) << min(right, 64)
            case ast.Pow():
                largest = abs(left) ** min(right, 64)
            case ast.Mult():
                largest = abs(left) * right
            case _:
                return
        if largest > _SMALL_INT_MAX:
            yield f"{ast.unparse(node)} needs a long integer, and a hub's end at {_SMALL_INT_MAX}; use smaller numbers or bytes"


def _integer(node: ast.expr) -> int | None:
    return node.value if isinstance(node, ast.Constant) and type(node.value) is int else None


def _exit_remedy(name: str) -> str:
    return "use raise SystemExit" if name == "exit" else "do without it"


def _bound_names(tree: ast.Module) -> Iterator[str]:
    """Names that the program binds anywhere; scopes are not checked."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.arg(arg=name):
                yield name
            case ast.alias(name=name, asname=asname):
                yield asname or name.partition(".")[0]
            case ast.ExceptHandler(name=str(name)):
                yield name
