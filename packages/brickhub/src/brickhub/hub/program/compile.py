"""Compiler from MicroPython source to the bytes that a hub loads."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping

from mpy_cross_v6 import mpy_cross_compile

from brickhub.errors import ProgramError
from brickhub.hub.transport import MAIN_FILE, HubProgram
from brickhub.robot import AnyHub

_SMALL_INT_BITS = "-msmall-int-bits=31"
MAIN_MODULE = "__main__"


def compile_mpy(source: str, name: str = MAIN_FILE) -> bytes:
    """Compile a program to ``.mpy`` version 6. ``name`` is the file name that tracebacks show. Raises ProgramError if the source
    is not MicroPython, or the compiler could not be run."""
    try:
        process, mpy = mpy_cross_compile(name, source, extra_args=[_SMALL_INT_BITS])
    except OSError as error:
        raise ProgramError(f"the compiler mpy-cross could not be run ({error}); reinstall mpy-cross-v6") from error
    if mpy is None:
        lines = [line.strip() for line in process.stderr.decode("utf-8", "replace").splitlines() if line.strip()]
        numbers = re.findall(r'File ".*", line (\d+)', "\n".join(lines))
        where = f"{name}, line {numbers[-1]}" if numbers else name
        problem = lines[-1] if lines else f"mpy-cross ended with status {process.returncode}"
        raise ProgramError(f"{where}: {problem}; correct the program")
    return mpy


def compile_program(program: HubProgram) -> dict[str, bytes]:
    """Compile a program and the modules beside it to ``.mpy``, by their names on the hub. Raises ProgramError if one of them is
    not MicroPython, or the compiler could not be run."""
    modules = {module.name: compile_mpy(module.source, module.file) for module in program.modules}
    return {MAIN_MODULE: compile_mpy(program.source, program.name), **modules}


def program_blob(modules: Mapping[str, bytes], hub: AnyHub) -> bytes:
    """Content of a hub's program area: ``<I length> name "\\0" mpy`` for each module, the program itself first. Raises
    ProgramError if the content is larger than the program area.
    """
    blob = b"".join(struct.pack("<I", len(mpy)) + name.encode() + b"\0" + mpy for name, mpy in modules.items())
    max_bytes = hub.model.program_bytes
    if len(blob) > max_bytes:
        raise ProgramError(f"the program has {len(blob)} bytes, the {hub.value} hub takes {max_bytes}; make it shorter")
    return blob
