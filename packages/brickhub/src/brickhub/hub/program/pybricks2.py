"""Lines of programs for an EV3 with Pybricks 1 or 2 (``pybricks-micropython`` of 2019 to 2021) that
no longer run on Pybricks 4, and what there is instead.

Only text is looked at: an attribute counts by its name, whatever it is an attribute of.
"""

import ast
import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from brickhub.hub.program.syntax import parse
from brickhub.hub.transport import HubProgram

_HEADING = "Pybricks 4 does not run these lines of Pybricks 2:\n"
_SOUNDS = "there are no sound files; speaker.beep() and speaker.play_notes() play tones"
_PICTURES = "there are no picture files; draw on ev3.screen, or in an Image of pybricks.parameters"
_TASKS = "tasks run in turns: multitask and run_task of pybricks.tools"
_TIME = "wait and StopWatch of pybricks.tools"
_MAILBOXES = (
    "there are no mailboxes yet; AppData of pybricks.messaging reaches the computer over USB"
)
_OLD_BRICK = "from pybricks.hubs import EV3Brick, then ev3 = EV3Brick()"
# What a program imports, as module and name; "" stands for each other name of the module.
_IMPORTS: dict[tuple[str, str], str] = {
    ("pybricks.media.ev3dev", "SoundFile"): _SOUNDS,
    ("pybricks.media.ev3dev", "ImageFile"): _PICTURES,
    ("pybricks.media.ev3dev", "Image"): "from pybricks.parameters import Image",
    ("pybricks.media.ev3dev", "Font"): "from pybricks.parameters import Font",
    ("pybricks.media.ev3dev", ""): "Image and Font are in pybricks.parameters",
    ("pybricks.tools", "DataLog"): "print() sends lines to the computer, which can keep them",
    ("pybricks.tools", "print"): "print is always there",
    ("pybricks.parameters", "SoundFile"): _SOUNDS,
    ("pybricks.parameters", "Align"): "screen.draw_text() takes x and y",
    ("pybricks", "ev3brick"): _OLD_BRICK,
    ("pybricks.ev3brick", ""): _OLD_BRICK,
    ("pybricks.speaker", ""): _SOUNDS,
    ("pybricks.display", ""): "ev3.screen",
    ("pybricks.messaging", "BluetoothMailboxServer"): _MAILBOXES,
    ("pybricks.messaging", "BluetoothMailboxClient"): _MAILBOXES,
    ("pybricks.messaging", "LogicMailbox"): _MAILBOXES,
    ("pybricks.messaging", "NumericMailbox"): _MAILBOXES,
    ("pybricks.messaging", "TextMailbox"): _MAILBOXES,
    ("pybricks.iodevices", "Ev3devSensor"): "LUMPDevice of pybricks.iodevices reads any mode",
    ("threading", ""): _TASKS,
    ("_thread", ""): _TASKS,
    ("asyncio", ""): _TASKS,
    ("uasyncio", ""): _TASKS,
    ("time", ""): _TIME,
    ("utime", ""): _TIME,
    ("os", ""): "the brick has no files and no system",
    ("uos", ""): "the brick has no files and no system",
    ("socket", ""): "the brick has no network",
    ("usocket", ""): "the brick has no network",
    ("umqtt.robust", ""): "the brick has no network",
    ("umqtt.simple", ""): "the brick has no network",
    ("collections", ""): "lists and dicts",
    ("ucollections", ""): "lists and dicts",
    ("re", ""): "methods of str, such as split() and find()",
    ("ure", ""): "methods of str, such as split() and find()",
    ("math.round", ""): "round is always there",
}
_ONLY_OLD = ("pybricks.media.ev3dev", "pybricks.ev3brick", "pybricks.speaker", "pybricks.display")
"""Modules by which a program shows that it is for Pybricks 1 or 2."""
_ONLY_OLD_NAMES = (
    ("pybricks", "ev3brick"),
    ("pybricks.tools", "DataLog"),
    ("pybricks.messaging", "BluetoothMailboxServer"),
    ("pybricks.messaging", "BluetoothMailboxClient"),
    ("pybricks.messaging", "LogicMailbox"),
    ("pybricks.messaging", "NumericMailbox"),
    ("pybricks.messaging", "TextMailbox"),
)
"""Names in modules that there still are, by which it does, too."""
_ATTRIBUTES = {
    "say": "the brick cannot speak; show it with ev3.screen.print(), or beep",
    "play_file": _SOUNDS,
    "set_volume": "speaker.volume(percent)",
    "set_speech_options": "the brick cannot speak",
    "drive_time": "drive(speed, turn_rate), wait(time), then stop(); or straight() and turn()",
    "set_run_settings": "control.limits(speed, acceleration)",
    "set_pid_settings": "control.pid(kp, ki, kd, integral_deadzone, integral_rate), other scales",
    "set_dc_settings": "settings(max_voltage), in mV",
}
"""Methods that Pybricks 4 has nowhere."""
_NO_FILES = "the brick has no files; print() sends lines to the computer, which can keep them"
_OLD_BRICK_PARTS = {
    "sound": "ev3.speaker",
    "display": "ev3.screen",
    "light": "ev3.light.on(color) and ev3.light.off()",
    "buttons": "ev3.buttons.pressed()",
    "battery": "ev3.battery",
}
"""Parts of the module ``ev3brick`` of Pybricks 1."""
_OWNED_ATTRIBUTES = {
    ("Color", "PURPLE"): "Color.VIOLET or Color.MAGENTA",
    ("screen", "save"): _NO_FILES,
}
"""Attributes that other objects may have, by what they are attributes of."""
_STOPS = "stop() takes nothing; brake() and hold() are methods too"


@dataclass(frozen=True)
class Outdated:
    """A line that Pybricks 4 does not run.

    Attributes:
        file, line: where it is.
        what: what is not there any more.
        instead: what there is now.
    """

    file: str
    line: int
    what: str
    instead: str


def is_old_import(module: str, name: str) -> bool:
    """Whether only a program for Pybricks 1 or 2 imports that name of a module."""
    return module in _ONLY_OLD or (module, name) in _ONLY_OLD_NAMES


def outdated(program: HubProgram) -> list[Outdated]:
    """Lines of a program, and of the modules beside it, that Pybricks 4 does not run."""
    sources = [(program.name, program.source)]
    sources += [(module.file, module.source) for module in program.modules]
    own = {module.name for module in program.modules}
    trees: dict[str, ast.AST] = {}
    for file, source in sources:
        # What cannot be read, the hub's compiler has said.
        with contextlib.suppress(SyntaxError, ValueError):
            trees[file] = parse(source)
    # A module may import names for others, which take them all.
    used: set[str] = set()
    for tree in trees.values():
        used |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    found = []
    for file, tree in trees.items():
        lines = [*_imports(tree, own, used), *_uses(tree)]
        for line, what, instead in sorted(lines):
            found.append(Outdated(file, line, what, instead))
    return found


def outdated_note(program: HubProgram) -> str:
    """Text that names these lines; empty if there are none."""
    found = outdated(program)
    if not found:
        return ""
    lines = []
    for one in found:
        where = f"line {one.line}"
        if one.file != program.name:
            where = f"{one.file}, {where}"
        lines.append(f"  {where}: {one.what}: {one.instead}\n")
    return _HEADING + "".join(lines)


_Line = tuple[int, str, str]


def _imports(
    tree: ast.AST,
    own: set[str],
    used: set[str],
) -> Iterator[_Line]:
    """Imports that fail, but of modules beside the program (``own``). ``used``: all names that the
    program and its modules use."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        for alias in node.names:
            module = alias.name
            name = ""
            if isinstance(node, ast.ImportFrom):
                module = node.module or ""
                name = alias.name
            instead = _IMPORTS.get((module, name)) or _IMPORTS.get((module, ""))
            if instead is None or module in own:
                continue
            local_name = alias.asname or alias.name.partition(".")[0]
            if local_name not in used and name != "*":
                instead = "nothing here uses it; leave it out"
            yield node.lineno, name or module, instead


def _uses(tree: ast.AST) -> Iterator[_Line]:
    old_bricks = set(_names_of_old_brick(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield from _attribute(node, old_bricks)
        elif isinstance(node, ast.Call):
            yield from _call(node)
        elif isinstance(node, ast.Subscript):
            yield from _subscript(node)


def _names_of_old_brick(tree: ast.AST) -> Iterator[str]:
    """Names by which a program calls the module ``ev3brick``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "pybricks":
            for alias in node.names:
                if alias.name == "ev3brick":
                    yield alias.asname or alias.name


def _attribute(node: ast.Attribute, old_bricks: set[str]) -> Iterator[_Line]:
    if node.attr in _ATTRIBUTES:
        yield node.lineno, node.attr, _ATTRIBUTES[node.attr]
    owner = node.value.id if isinstance(node.value, ast.Name) else ""
    if owner in old_bricks and node.attr in _OLD_BRICK_PARTS:
        yield node.lineno, f"{owner}.{node.attr}", _OLD_BRICK_PARTS[node.attr]
    if isinstance(node.value, ast.Attribute):
        owner = node.value.attr
    instead = _OWNED_ATTRIBUTES.get((owner, node.attr))
    if instead is not None:
        yield node.lineno, f"{owner}.{node.attr}", instead
    if owner in ("ImageFile", "SoundFile"):
        instead = _PICTURES if owner == "ImageFile" else _SOUNDS
        yield node.lineno, f"{owner}.{node.attr}", instead


def _call(node: ast.Call) -> Iterator[_Line]:
    called = node.func
    first = node.args[0] if node.args else None
    if isinstance(called, ast.Name) and called.id == "Font":
        yield node.lineno, "Font(...)", "Font.DEFAULT and three more are all fonts that there are"
    if isinstance(called, ast.Name) and called.id == "open":
        yield node.lineno, "open", _NO_FILES
    if not isinstance(called, ast.Attribute):
        return
    if called.attr == "stop" and _is_of(first, "Stop"):
        yield node.lineno, "stop(Stop...)", _STOPS
    is_file = isinstance(first, ast.Constant) and isinstance(first.value, str)
    if called.attr == "load_image" and is_file:
        yield node.lineno, "load_image of a file", _PICTURES


def _subscript(node: ast.Subscript) -> Iterator[_Line]:
    called = node.value.func if isinstance(node.value, ast.Call) else None
    if isinstance(called, ast.Attribute) and called.attr == "pressed":
        yield node.lineno, "pressed()[...]", "a set has no order: Button.X in pressed()"


def _is_of(node: ast.expr | None, owner: str) -> bool:
    """Whether an expression is an attribute of a name."""
    is_attribute = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    return is_attribute and node.value.id == owner  # type: ignore[union-attr]
