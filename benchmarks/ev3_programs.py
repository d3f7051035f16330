"""Strangers' programs for an EV3: how each ends on the virtual brick, and whether that is how it
ends on a real one.

    python -m benchmarks ev3_programs FOLDER

The folder has a folder for each repository, such as ``mkoeda+LEGO_Python``, as they are cloned:
those of ``ev3_programs.csv``. A program counts if it, or a module beside it that it imports,
imports ``pybricks``, and neither a hub of Powered Up. Each runs in a process of its own, on the
bench with all devices that it asks for, without input, for 3 simulated seconds; and again without
the names that it imports and never uses, which most of them stop at. The result has counts and the
firmware's words only, nothing of the files themselves.

What a brick does is said by ``mpy-cross``, the compiler of MicroPython, for programs that it
refuses, and by the firmware's own tables of names (v4.1.0b2, ``pb_module_*.c`` with the options of
``bricks/ev3/mpconfigport.h``): the first import statement of a program that names something that is
not in them raises, and no program ends by another ImportError.
"""

from __future__ import annotations

import ast
import hashlib
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.hub.program.compile import cross_compile
from brickhub.hub.program.pybricks2 import outdated
from brickhub.hub.program.run_program import load_program
from brickhub.hub.program.syntax import imported_names, parse
from brickhub.hub.transport import HubProgram

TIME_LIMIT_S = 3.0
_TIMEOUT_S = 600.0
_POWERED_UP = {
    *("PrimeHub", "InventorHub", "EssentialHub", "TechnicHub", "CityHub", "MoveHub"),
    "LWP3Device",
}
# Names of the firmware's modules on an EV3.
NAMES: dict[str, set[str]] = {
    "pybricks": {"version"},
    "pybricks.hubs": {"EV3Brick", "ThisHub", "PrimeHub"},
    "pybricks.ev3devices": {
        *("Motor", "ColorSensor", "GyroSensor", "InfraredSensor", "TouchSensor"),
        *("UltrasonicSensor", "ForceSensor"),
    },
    "pybricks.nxtdevices": {
        *("Motor", "TouchSensor", "LightSensor", "ColorSensor", "UltrasonicSensor"),
        *("TemperatureSensor", "SoundSensor", "EnergyMeter", "VernierAdapter"),
    },
    "pybricks.iodevices": {
        *("AnalogSensor", "DCMotor", "I2CDevice", "LUMPDevice", "PUPDevice", "UARTDevice"),
    },
    "pybricks.parameters": {
        *("Axis", "Button", "Color", "Direction", "Font", "Icon", "Image", "ImageFile", "Port"),
        *("Side", "Stop"),
    },
    "pybricks.robotics": {"Car", "DriveBase"},
    "pybricks.tools": {
        *("wait", "StopWatch", "multitask", "run_task", "read_input_byte", "Matrix", "vector"),
        *("cross", "Axis", "AppData"),
    },
    "pybricks.messaging": {"AppData", "bluetooth_scan"},
    "pybricks.experimental": {"hello_world"},
}
NAMES["pybricks.pupdevices"] = NAMES["pybricks.ev3devices"]
NAMES["pybricks.geometry"] = NAMES["pybricks.tools"]
_MODULES = {
    *("sys", "select", "struct", "math", "random", "json", "io", "errno", "gc", "micropython"),
    *("usys", "uselect", "ustruct", "umath", "urandom", "ujson", "uio", "uerrno"),
}


def is_for_ev3(program: HubProgram) -> bool:
    """Whether a program is one for an EV3 with Pybricks."""
    uses_pybricks = False
    for source in (program.source, *(module.source for module in program.modules)):
        try:
            tree = parse(source)
        except (SyntaxError, ValueError):
            uses_pybricks = uses_pybricks or re.search(r"(?m)^from pybricks", source) is not None
            continue
        for module, name in imported_names(tree):
            if module == "pybricks.pupdevices" or name in _POWERED_UP:
                return False
            uses_pybricks = uses_pybricks or module.partition(".")[0] == "pybricks"
    return uses_pybricks


_UNUSED = "nothing here uses it"
CIRCULAR = "modules import each other"


def syntax_error(program: HubProgram) -> str:
    """What the compiler says of a program that it refuses, or of a module beside it; else empty."""
    for source in (program.source, *(module.source for module in program.modules)):
        mpy, report = cross_compile(source, "main.py")
        if mpy is None:
            return report.splitlines()[-1].strip()
    return ""


def import_error(program: HubProgram) -> str:
    """The ImportError by which a brick ends the program; empty if its imports are all there, and
    ``CIRCULAR`` if that depends on what modules have done before they import each other."""
    own = {module.name: module.source for module in program.modules}
    return next(_import_errors(program.source, own, {}), "")


def _import_errors(source: str, own: dict[str, str], done: dict[str, bool]) -> Iterator[str]:
    """Errors in the order of the imports. ``done``: whether a module has been imported to its
    end."""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):
        return
    # A function imports only when it is called.
    for node in tree.body:
        pairs = imported_names(node) if isinstance(node, ast.Import | ast.ImportFrom) else ()
        for module, name in pairs:
            if module in own:
                if done.get(module) is False:
                    yield CIRCULAR
                elif module not in done:
                    done[module] = False
                    yield from _import_errors(own[module], own, done)
                    done[module] = True
                if name not in ("", "*") and not _may_define(own[module], name):
                    yield f"ImportError: can't import name {name}"
            elif module not in NAMES and module not in _MODULES:
                yield f"ImportError: no module named '{module}'"
            elif module in NAMES and name not in ("", "*") and name not in NAMES[module]:
                yield f"ImportError: can't import name {name}"


def _may_define(source: str, name: str) -> bool:
    """Whether a module may have a name: it sets it somewhere, or imports all names of another."""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):
        return True
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {
        node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
    return name in names or "*" in names


def run(path: Path) -> dict[str, Any]:
    """How a program ends on the virtual brick."""
    command = [sys.executable, "-m", "brickhub", "run", str(path)]
    command += ["--time-limit-s", str(TIME_LIMIT_S)]
    try:
        done = subprocess.run(  # noqa: S603 - our own command
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return {"end": "no end", "line": 0}
    text = done.stderr.decode("utf-8", "replace")
    lines = text.splitlines()
    if done.returncode == 0:
        return {"end": "ends", "line": 0}
    if "at the time limit" in text:
        return {"end": "runs on", "line": 0}
    if "Traceback (most recent call last)" not in text:
        # What we refuse ourselves is one line.
        return {"end": "refused", "says": lines[-1] if lines else "", "line": 0}
    if f'File "{Path(brickhub_folder())}' in text:
        return {"end": "our traceback", "says": lines[-1], "line": 0}
    numbers = re.findall(r"(?m)^  File .*, line (\d+)", text)
    is_error = re.compile(r"[A-Z]\w*(Error|Exit|Interrupt|Iteration)?(:|$)")
    says = next((line for line in lines if is_error.match(line)), "")
    return {"end": "raises", "says": says, "line": int(numbers[-1]) if numbers else 0}


def brickhub_folder() -> str:
    """Folder of our own code."""
    import brickhub

    return str(Path(brickhub.__file__).parent)


def without_unused(program: HubProgram, folder: Path) -> Path:
    """A copy of a program, and of the modules beside it, without the old names that nothing
    uses."""
    unused: dict[str, set[tuple[int, str]]] = {}
    for one in outdated(program):
        if one.instead.startswith(_UNUSED):
            unused.setdefault(one.file, set()).add((one.line, one.what))
    files = {program.name: program.source}
    files |= {f"{module.name}.py": module.source for module in program.modules}
    for file, source in files.items():
        gone = unused.get(file, set())
        place = folder / Path(*file.removesuffix(".py").split(".")).with_suffix(".py")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(_stripped(source, gone) if gone else source, encoding="utf-8")
    return folder / program.name


def _stripped(source: str, gone: set[tuple[int, str]]) -> str:
    lines = source.splitlines()
    for node in ast.walk(parse(source)):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        kept = [alias for alias in node.names if (node.lineno, alias.name) not in gone]
        if len(kept) == len(node.names):
            continue
        node.names = kept
        # The lines keep their numbers.
        first, last = node.lineno - 1, node.end_lineno or node.lineno
        indent = lines[first][: node.col_offset]
        lines[first] = indent + (ast.unparse(node) if kept else "pass")
        lines[first + 1 : last] = [""] * (last - first - 1)
    return "\n".join(lines) + "\n"


def look(path: Path) -> dict[str, Any]:
    """How a program ends, and what is said of it."""
    program = load_program(path)
    found = run(path)
    found |= judged(program, found)
    if found["unused"]:
        found["without_unused"] = look_without_unused(program)
    return found


def look_without_unused(program: HubProgram) -> dict[str, Any]:
    """How a program ends without its unused old names, and whether what is said of its lines named
    the one that raises."""
    with tempfile.TemporaryDirectory() as name:
        path = without_unused(program, Path(name))
        found = run(path)
        kept = load_program(path)
        found |= judged(kept, found)
        # The last line of the traceback is in the program or in a module beside it.
        found["is_named"] = any(one.line == found["line"] for one in outdated(kept))
    return found


def judged(program: HubProgram, found: dict[str, Any]) -> dict[str, Any]:
    """What is said of a program, and whether it ends as on a brick."""
    expected = syntax_error(program) or import_error(program)
    old = outdated(program)
    unused = sum(one.instead.startswith(_UNUSED) for one in old)
    said = str(found.get("says", ""))
    is_told = said.startswith(("ImportError", "SyntaxError"))
    is_judged = expected != CIRCULAR and (bool(expected) or is_told)
    ends_alike = said == expected if is_judged else found["end"] != "our traceback"
    # Nobody plugs a sensor of NXT into the bench.
    if "ENODEV" in said and _asks_for_nxt(program):
        ends_alike = False
    return {
        "expected": expected,
        "old_lines": len(old),
        "unused": unused,
        "as_on_brick": ends_alike,
    }


def _asks_for_nxt(program: HubProgram) -> bool:
    for source in (program.source, *(module.source for module in program.modules)):
        for module, name in imported_names(parse(source)):
            if module == "pybricks.nxtdevices" and name != "Motor":
                return True
    return False


def summary(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Counts of all programs, by repository and digest."""
    found_rows = list(rows.values())
    errors = Counter(row["says"].partition(":")[0] for row in found_rows if "says" in row)
    expected = Counter(row["expected"] for row in found_rows if row["expected"])
    again = [row["without_unused"] for row in found_rows if "without_unused" in row]
    raised = [row for row in again if row["end"] == "raises"]
    return {
        "programs": len(rows),
        "repositories": dict(Counter(name.partition(" ")[0] for name in rows)),
        "ends": dict(Counter(row["end"] for row in found_rows)),
        "errors": dict(errors),
        "expected_by_compiler_and_names": dict(expected),
        "with_old_lines": sum(row["old_lines"] > 0 for row in found_rows),
        "old_lines": sum(row["old_lines"] for row in found_rows),
        "unused_imports": sum(row["unused"] for row in found_rows),
        "our_tracebacks": sum(row["end"] == "our traceback" for row in found_rows),
        "without_unused": {
            "programs": len(again),
            "ends": dict(Counter(row["end"] for row in again)),
            "errors": dict(Counter(row["says"] for row in raised)),
            "named": sum(row["is_named"] for row in raised),
            "our_tracebacks": sum(row["end"] == "our traceback" for row in again),
            "differ": sum(not row["as_on_brick"] for row in again),
        },
        "differ": [name for name, row in rows.items() if not row["as_on_brick"]],
        "each": rows,
    }


def name_of(path: Path, folder: Path) -> str:
    """Repository and digest of a program: its own name may be that of a person."""
    relative = path.relative_to(folder)
    digest = hashlib.sha256(relative.as_posix().encode() + path.read_bytes()).hexdigest()[:16]
    return f"{relative.parts[0].replace('+', '/', 1)} {digest}"


def main(session: Session) -> None:
    """Run all and write the counts."""
    parser = session.parser
    parser.add_argument("folder", type=Path, help="folder with the cloned repositories")
    folder: Path = session.parse().folder
    paths = []
    for path in sorted(folder.rglob("*.py")):
        if is_for_ev3(load_program(path)):
            paths.append(path)
    rows: dict[str, dict[str, Any]] = {}
    with ThreadPoolExecutor(session.jobs or 1) as pool:
        for path, found in zip(paths, pool.map(look, paths), strict=True):
            rows[name_of(path, folder)] = found
            print(path.relative_to(folder), found, flush=True)
    result = summary(rows)
    for key in ("programs", "ends", "errors", "our_tracebacks", "with_old_lines", "differ"):
        print(f"{key}: {result[key]}", flush=True)
    session.write(result)
