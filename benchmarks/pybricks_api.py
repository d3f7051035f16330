"""The virtual hub beside what Pybricks documents: which classes, methods and arguments it lacks, for each kind of hub.

    pip install --no-deps --target STUBS pybricks
    python benchmarks/pybricks_api.py STUBS

The package ``pybricks`` on PyPI is the documentation in the form of Python files without code; they are read, not run. What only
EV3 and NXT bricks have is left out (``LEFT_OUT``), and so is what a kind of hub does not have (``ONLY_ON``).
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from machine import command, write

from bricksrl.robots import HubKind, Robot
from bricksrl.virtual_hub.bench_body import BenchBody
from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.pybricks import modules

MODULES = ("hubs", "pupdevices", "robotics", "tools", "parameters", "iodevices")
HUBS = (HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC, HubKind.CITY)
LEFT_OUT = {
    *("tools.DataLog", "iodevices.AnalogSensor", "iodevices.I2CDevice", "iodevices.LUMPDevice", "iodevices.DCMotor"),
    "iodevices.XboxController.name()",  # the firmware accepts an argument
    "pupdevices.ColorLightMatrix.on(color)",  # its own text says ``colors``, and so does the firmware
}
LARGE = frozenset({HubKind.PRIME, HubKind.ESSENTIAL})
ONLY_ON = {
    **dict.fromkeys(("parameters.Icon", "tools.hub_menu"), frozenset({HubKind.PRIME})),
    **dict.fromkeys(("pupdevices.TechnicMoveHub", "pupdevices.MarioHub", "pupdevices.DuploTrain"), LARGE),
    **dict.fromkeys(("iodevices.XboxController", "robotics.DriveBase.use_gyro"), LARGE | {HubKind.TECHNIC}),
}
"""Names that only some kinds of hubs have, by the configuration of their firmware."""


@dataclass
class Documented:
    """A class: arguments of its methods, and the classes of its parts, by name."""

    methods: dict[str, list[str] | None] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)
    values: list[str] = field(default_factory=list)


class Stubs:
    """What the files of the documentation define."""

    def __init__(self, folder: Path) -> None:
        files = [folder / "pybricks" / f"{name}.py" for name in ("_common", *MODULES)]
        self._trees = {path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in files}

    def functions(self, module: str) -> Iterator[str]:
        yield from (node.name for node in self._trees[module].body if isinstance(node, ast.FunctionDef) and node.name[0] != "_")

    def classes(self, module: str) -> Iterator[str]:
        yield from (node.name for node in self._trees[module].body if isinstance(node, ast.ClassDef) and node.name[0] != "_")

    def documented(self, module: str, name: str) -> Documented:
        """A class, with what it inherits."""
        node = next((one for one in self._trees[module].body if isinstance(one, ast.ClassDef) and one.name == name), None)
        found = Documented()
        for base in node.bases if node is not None else ():
            text = ast.unparse(base)
            inherited = self.documented("_common" if text.startswith("_common.") else module, text.removeprefix("_common."))
            found.methods |= inherited.methods
            found.parts |= inherited.parts
        for member in node.body if node is not None else ():
            if isinstance(member, ast.FunctionDef) and (member.name[0] != "_" or member.name == "__init__"):
                is_overloaded = any(ast.unparse(one) == "overload" for one in member.decorator_list) or member.args.vararg
                names = [one.arg for one in (*member.args.args, *member.args.kwonlyargs) if one.arg != "self"]
                found.methods[member.name] = None if is_overloaded else names
            elif isinstance(member, ast.Assign) and isinstance(member.targets[0], ast.Name):
                text = ast.unparse(member.value)
                target = member.targets[0].id
                if text.startswith("_common."):
                    found.parts[target] = text.removeprefix("_common.").partition("(")[0]
                else:
                    found.values.append(target)
        return found


class _Silence:
    def available(self) -> int:
        return 0

    def read(self, n: int) -> bytes:
        raise EOFError

    def write(self, data: bytes) -> None:
        pass


def lacks(path: str, wanted: Documented, ours: Any) -> Iterator[str]:
    """What one of our classes or objects lacks."""
    for name, arguments in wanted.methods.items():
        method = ours if name == "__init__" else getattr(ours, name, None)
        if method is None:
            yield f"{path}.{name}"
        elif arguments is not None and isinstance(ours, type) and name != "__init__" and callable(method):
            own = [one for one in inspect.signature(method).parameters.values() if one.name != "self"]
            is_open = any(one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD) for one in own)
            if not is_open and [one.name for one in own] != arguments:
                yield f"{path}.{name}({', '.join(arguments)})"
    yield from (f"{path}.{name}" for name in wanted.values if not hasattr(ours, name))


def compared(stubs: Stubs, kind: HubKind) -> tuple[int, list[str]]:
    """How many names are documented for a hub, and those that ours lacks."""
    robot = Robot("any", kind)
    found = modules(Machine(BenchBody(robot)), _Silence())
    count, missing = 0, []
    for module in MODULES:
        ours = found[f"pybricks.{module}"]
        for name in (*stubs.functions(module), *stubs.classes(module)):
            path = f"{module}.{name}"
            if path in LEFT_OUT or kind not in ONLY_ON.get(path, HubKind) or (module == "hubs" and name != kind.model.class_name):
                continue
            wanted = stubs.documented(module, name)
            count += 1 + len(wanted.methods) + len(wanted.values)
            own = getattr(ours, name, None)
            if own is None:
                missing.append(path)
                continue
            one = own() if module == "hubs" else own
            missing += [lack for lack in lacks(path, wanted, one) if lack not in LEFT_OUT and not _is_of_others(lack, kind)]
            for part, part_class in wanted.parts.items() if module == "hubs" else ():
                details = stubs.documented("_common", part_class)
                count += 1 + len(details.methods)
                missing += lacks(f"{path}.{part}", details, getattr(one, part)) if hasattr(one, part) else [f"{path}.{part}"]
    return count, missing


def _is_of_others(path: str, kind: HubKind) -> bool:
    is_port = path.startswith("parameters.Port.")
    return path[-1] not in kind.model.ports if is_port else kind not in ONLY_ON.get(path, HubKind)


def main() -> None:
    parser = command(__doc__)
    parser.add_argument("stubs", type=Path, help="folder that the package was installed into")
    stubs = Stubs(parser.parse_args().stubs)
    result = {}
    for kind in HUBS:
        count, missing = compared(stubs, kind)
        print(f"{kind.value}: {count} names, {len(missing)} missing: {', '.join(missing) or 'none'}")
        result[kind.value] = {"documented": count, "missing": missing}
    print(write("pybricks_api", {"hubs": result}))


if __name__ == "__main__":
    main()
