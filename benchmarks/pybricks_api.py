"""Comparison of the virtual hub with Pybricks' documentation: missing classes, methods and
arguments, for each kind of hub.

    pip install --no-deps --target STUBS pybricks
    python -m benchmarks pybricks_api STUBS

The package ``pybricks`` on PyPI is the documentation in the form of Python files without code; they
are parsed, not run. What only EV3 and NXT bricks have is omitted (``LEFT_OUT``), and so is what a
kind of hub does not have (``ONLY_ON``).
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules

MODULES = ("hubs", "pupdevices", "robotics", "tools", "parameters", "iodevices")
HUBS = (HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC, HubKind.CITY)
LEFT_OUT = {
    *(
        "tools.DataLog",
        "iodevices.AnalogSensor",
        "iodevices.I2CDevice",
        "iodevices.LUMPDevice",
        "iodevices.DCMotor",
    ),
    "iodevices.XboxController.name()",  # the firmware accepts an argument
    # its own text says ``colors``, and so does the firmware
    "pupdevices.ColorLightMatrix.on(color)",
}
LARGE = frozenset({HubKind.PRIME, HubKind.ESSENTIAL})
ONLY_ON = {
    **dict.fromkeys(("parameters.Icon", "tools.hub_menu"), frozenset({HubKind.PRIME})),
    **dict.fromkeys(
        ("pupdevices.TechnicMoveHub", "pupdevices.MarioHub", "pupdevices.DuploTrain"), LARGE
    ),
    **dict.fromkeys(
        ("iodevices.XboxController", "robotics.DriveBase.use_gyro"), LARGE | {HubKind.TECHNIC}
    ),
}
"""Names that only some kinds of hubs have, by the configuration of their firmware."""


@dataclass
class Documented:
    """A class: arguments of its methods, and the classes of its parts, by name."""

    methods: dict[str, list[str] | None] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)
    values: list[str] = field(default_factory=list)


class Stubs:
    """Definitions in the files of the documentation."""

    def __init__(self, folder: Path) -> None:
        files = [folder / "pybricks" / f"{name}.py" for name in ("_common", *MODULES)]
        self._trees = {path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in files}

    def functions(self, module: str) -> Iterator[str]:
        yield from (
            node.name
            for node in self._trees[module].body
            if isinstance(node, ast.FunctionDef) and node.name[0] != "_"
        )

    def classes(self, module: str) -> Iterator[str]:
        yield from (
            node.name
            for node in self._trees[module].body
            if isinstance(node, ast.ClassDef) and node.name[0] != "_"
        )

    def documented(self, module: str, name: str) -> Documented:
        """A class, with what it inherits."""
        node = next(
            (
                item
                for item in self._trees[module].body
                if isinstance(item, ast.ClassDef) and item.name == name
            ),
            None,
        )
        result = Documented()
        for base in node.bases if node is not None else ():
            text = ast.unparse(base)
            inherited = self.documented(
                "_common" if text.startswith("_common.") else module, text.removeprefix("_common.")
            )
            result.methods |= inherited.methods
            result.parts |= inherited.parts
        for member in node.body if node is not None else ():
            if isinstance(member, ast.FunctionDef) and (
                member.name[0] != "_" or member.name == "__init__"
            ):
                is_overloaded = (
                    any(ast.unparse(item) == "overload" for item in member.decorator_list)
                    or member.args.vararg
                )
                names = [
                    item.arg
                    for item in (*member.args.args, *member.args.kwonlyargs)
                    if item.arg != "self"
                ]
                result.methods[member.name] = None if is_overloaded else names
            elif isinstance(member, ast.Assign) and isinstance(member.targets[0], ast.Name):
                text = ast.unparse(member.value)
                target = member.targets[0].id
                if text.startswith("_common."):
                    result.parts[target] = text.removeprefix("_common.").partition("(")[0]
                else:
                    result.values.append(target)
        return result


class _Silence:
    inbox = bytearray()

    def available(self) -> int:
        return 0

    def read(self, n: int) -> bytes:
        raise EOFError

    def write(self, data: bytes) -> None:
        pass

    write_app_data = write


def missing_names(path: str, documented: Documented, actual: Any) -> Iterator[str]:
    """Documented names that one of our classes or objects lacks."""
    for name, arguments in documented.methods.items():
        method = actual if name == "__init__" else getattr(actual, name, None)
        if method is None:
            yield f"{path}.{name}"
        elif (
            arguments is not None
            and isinstance(actual, type)
            and name != "__init__"
            and callable(method)
        ):
            parameters = [
                p for p in inspect.signature(method).parameters.values() if p.name != "self"
            ]
            is_open = any(p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) for p in parameters)
            if not is_open and [p.name for p in parameters] != arguments:
                yield f"{path}.{name}({', '.join(arguments)})"
    yield from (f"{path}.{name}" for name in documented.values if not hasattr(actual, name))


def compared(stubs: Stubs, kind: HubKind) -> tuple[int, list[str]]:
    """Number of names documented for a hub, and those that ours lacks."""
    robot = Robot("any", kind)
    hub_modules = modules(Machine(BenchBody(robot)), _Silence())
    count, missing = 0, []
    for module in MODULES:
        own_module = hub_modules[f"pybricks.{module}"]
        for name in (*stubs.functions(module), *stubs.classes(module)):
            path = f"{module}.{name}"
            if (
                path in LEFT_OUT
                or kind not in ONLY_ON.get(path, HubKind)
                or (module == "hubs" and name != kind.model.class_name)
            ):
                continue
            documented = stubs.documented(module, name)
            count += 1 + len(documented.methods) + len(documented.values)
            defined = getattr(own_module, name, None)
            if defined is None:
                missing.append(path)
                continue
            instance = defined() if module == "hubs" else defined
            names = missing_names(path, documented, instance)
            missing += [
                name for name in names if name not in LEFT_OUT and not _is_of_others(name, kind)
            ]
            for part, part_class in documented.parts.items() if module == "hubs" else ():
                details, own_part = (
                    stubs.documented("_common", part_class),
                    getattr(instance, part, None),
                )
                count += 1 + len(details.methods)
                missing += (
                    [f"{path}.{part}"]
                    if own_part is None
                    else missing_names(f"{path}.{part}", details, own_part)
                )
    return count, missing


def _is_of_others(path: str, kind: HubKind) -> bool:
    is_port = path.startswith("parameters.Port.")
    return path[-1] not in kind.model.ports if is_port else kind not in ONLY_ON.get(path, HubKind)


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument("stubs", type=Path, help="folder that the package was installed into")
    stubs = Stubs(session.parse().stubs)
    result = {}
    for kind in HUBS:
        count, missing = compared(stubs, kind)
        print(
            f"{kind.value}: {count} names, {len(missing)} missing: {', '.join(missing) or 'none'}"
        )
        result[kind.value] = {"documented": count, "missing": missing}
    session.write({"hubs": result})
