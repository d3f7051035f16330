"""Compiler from MicroPython source to the bytes that a hub loads."""

import ast
import builtins
import re
import struct
import symtable
from collections.abc import Iterator, Mapping

from mpy_cross_v6 import mpy_cross_compile

from brickhub.errors import ProgramError, hint
from brickhub.hub.program.syntax import imported_names, parse
from brickhub.hub.transport import MAIN_FILE, HubProgram
from brickhub.robot import AnyHub

_SMALL_INT_BITS = "-msmall-int-bits=31"
"""A hub has integers of 31 bits and no longer ones."""
MAIN_MODULE = "__main__"


def cross_compile(source: str, name: str) -> tuple[bytes | None, str]:
    """The program as ``.mpy`` version 6, and what the compiler reports. ``name`` is the file name
    that tracebacks show. Raises ProgramError if the compiler could not be run, or has no memory for
    so large a program."""
    try:
        process, mpy = mpy_cross_compile(name, source, extra_args=[_SMALL_INT_BITS])
    except OSError as error:
        raise ProgramError(
            f"the compiler mpy-cross could not be run ({error}); reinstall mpy-cross-v6"
        ) from error
    report = process.stderr.decode("utf-8", "replace").strip()
    if mpy is None and "MemoryError" in report:
        raise ProgramError(
            f"{name} is too large for the compiler mpy-cross; put parts of it into modules beside "
            "it, or make it shorter"
        )
    # A compiler that has crashed says nothing itself.
    return mpy, report or f"mpy-cross ended with status {process.returncode}"


def compile_mpy(source: str, name: str = MAIN_FILE) -> bytes:
    """Compile a program as `cross_compile`. Raises ProgramError if it is not MicroPython, or the
    compiler could not be run."""
    mpy, report = cross_compile(source, name)
    if mpy is None:
        numbers = re.findall(r'File ".*", line (\d+)', report)
        where = f"{name}, line {numbers[-1]}" if numbers else name
        # The report is a traceback, whose last line names the error.
        problem = report.splitlines()[-1].strip()
        raise ProgramError(f"{where}: {problem}; correct the program")
    return mpy


def compile_program(program: HubProgram) -> dict[str, bytes]:
    """Compile a program and the modules beside it to ``.mpy``, by their names on the hub. Raises
    ProgramError if one of them is not MicroPython, or the compiler could not be run."""
    modules = {module.name: compile_mpy(module.source, module.file) for module in program.modules}
    return {MAIN_MODULE: compile_mpy(program.source, program.name), **modules}


def program_blob(modules: Mapping[str, bytes], hub: AnyHub) -> bytes:
    """Content of a hub's program area: ``<I length> name "\\0" mpy`` for each module, the program
    itself first. Raises ProgramError if the content is larger than the program area.
    """
    blob = b""
    for name, mpy in modules.items():
        blob += struct.pack("<I", len(mpy)) + name.encode() + b"\0" + mpy
    max_bytes = hub.model.program_bytes
    if len(blob) > max_bytes:
        raise ProgramError(
            f"the program has {len(blob)} bytes, the {hub.value} hub takes {max_bytes}; make "
            "it shorter"
        )
    return blob


U_PREFIXED = ("sys", "select", "struct", "math", "random", "json", "io", "errno")
_PYBRICKS = (
    "hubs",
    "parameters",
    "pupdevices",
    "robotics",
    "tools",
    "messaging",
    "iodevices",
    "geometry",
    "experimental",
)
_DEVICES = {"ev3devices": ("ev3devices", "nxtdevices")}
"""Further modules of motors and sensors, by the one that a hub's devices are in."""
HUB_MODULES = frozenset(
    (
        *U_PREFIXED,
        *(f"u{name}" for name in U_PREFIXED),
        "gc",
        "micropython",
        "pybricks",
        *(f"pybricks.{name}" for name in _PYBRICKS),
        "_builtin_port_view",
        "_imu_calibrate",
    )
)
"""Modules of the firmware of a hub with floating-point numbers."""


def check_program(program: HubProgram, hub: AnyHub) -> int:
    """Size in bytes of a program on a hub. Raises ProgramError if the compiler refuses it, it is
    too large, imports a module that is neither on the hub nor beside it, or reads a name that
    nothing sets."""
    # The compiler goes first, because what it refuses needs no further look.
    size = len(program_blob(compile_program(program), hub))
    modules = HUB_MODULES | {module.name for module in program.modules}
    modules |= {f"pybricks.{name}" for name in _DEVICES.get(hub.model.devices, ())}
    sources = [(program.name, program.source)]
    sources += [(module.file, module.source) for module in program.modules]
    for file, source in sources:
        tree = parse(source, file)
        _check_imports(tree, file, modules)
        _check_names(tree, file)
    return size


def _check_imports(
    tree: ast.AST,
    file: str,
    modules: frozenset[str],
) -> None:
    for name in imported_modules(tree):
        if name not in modules:
            raise ProgramError(
                f"{file}: the hub has no module '{name}'{hint(name, modules)}; put it beside "
                "the program"
            )


def _check_names(tree: ast.AST, file: str) -> None:
    """Raise ProgramError for a name that nothing sets; a hub notices that only when it runs the
    line."""
    # CPython refuses some texts that a hub accepts, so the text is written anew from the tree.
    top = symtable.symtable(ast.unparse(tree), file, "exec")
    known = set(dir(builtins))
    for symbol in top.get_symbols():
        if symbol.is_assigned() or symbol.is_imported():
            known.add(symbol.get_name())
    # Functions too may set names of the top level.
    for node in ast.walk(tree):
        if isinstance(node, ast.Global):
            known.update(node.names)
    unknown = sorted(set(_global_names(top)) - known)
    for name in unknown:
        line = _line_of(tree, name)
        raise ProgramError(
            f"{file}, line {line}: nothing sets '{name}'; define it, or correct the name"
        )


def _line_of(tree: ast.AST, name: str) -> int:
    """Line of the source in which a name is read or set."""
    return next(
        node.lineno for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == name
    )


def _global_names(table: symtable.SymbolTable) -> Iterator[str]:
    """Names that a scope, and those within, read from the top level of the program."""
    # All names of the top level are global, which CPython's table does not say.
    is_top = table.get_type() == "module"
    for symbol in table.get_symbols():
        if symbol.is_referenced() and (symbol.is_global() or is_top):
            yield symbol.get_name()
    for scope in table.get_children():
        yield from _global_names(scope)


def imported_modules(tree: ast.AST) -> Iterator[str]:
    """Names of the modules in all import statements."""
    for module, _ in imported_names(tree):
        yield module
