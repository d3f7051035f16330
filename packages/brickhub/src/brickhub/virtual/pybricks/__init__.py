"""Stand-ins for ``pybricks.*`` and the modules of MicroPython, on a simulated clock."""

import functools
from types import ModuleType
from typing import Any

from brickhub.hub.program.compile import U_PREFIXED
from brickhub.robot.hardware import port_name
from brickhub.virtual.frozen import frozen_module
from brickhub.virtual.interpreter import Modules
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython import system
from brickhub.virtual.micropython.memory import Heap, check_of_calls, most_nested_calls
from brickhub.virtual.micropython.numbers import math_module, module, random_module, struct_module
from brickhub.virtual.micropython.streams import BytesIO, Console, IOBase, StringIO
from brickhub.virtual.micropython.transform import COMPREHENSIONS
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.ev3.ev3devices import ev3devices_modules
from brickhub.virtual.pybricks.ev3.image import image_names
from brickhub.virtual.pybricks.experimental import experimental_module
from brickhub.virtual.pybricks.hubs import hubs_module
from brickhub.virtual.pybricks.iodevices import iodevices_module
from brickhub.virtual.pybricks.parameters import enumeration, parameters_module
from brickhub.virtual.pybricks.pupdevices import pupdevices_modules
from brickhub.virtual.pybricks.robotics import robotics_module
from brickhub.virtual.pybricks.tools import tools_module
from brickhub.virtual.pybricks.wireless import messaging_module

_DEVICE_MODULES = {"pupdevices": pupdevices_modules, "ev3devices": ev3devices_modules}
"""Modules of the motors and sensors that a hub takes, by the name of the first one."""


def modules(machine: Machine, console: Console) -> Modules:
    """Modules that a program on this machine can import: fresh ones, for one run.

    Returns:
        Modules by name, as a dict; exactly those of the robot's kind of hub.
    """
    hub = machine.robot.hub
    machine.runs_program = True
    ports = enumeration("Port", " ".join(map(port_name, hub.model.ports)))
    for alias, port in hub.model.port_aliases:
        setattr(ports, alias, getattr(ports, port_name(port)))
    context = Context(machine, console, ports)
    heap = Heap(hub.model)
    machine.check_memory = heap.check
    importable_modules = {
        **_pybricks_modules(context),
        **_language_modules(machine, console, heap),
    }
    # The rest of the hub catches up before the program's first line.
    machine.branch(None)
    # The transformed program calls these, under names that no program can write.
    hooks: dict[str, Any] = {"@tick": machine.turn_loop, "@turn": machine.turn}
    for name in ("@branch", *COMPREHENSIONS):
        hooks[name] = machine.branch
    hooks["@callee"] = check_of_calls(most_nested_calls(hub))
    importable = Modules(
        importable_modules,
        hooks,
        heap.namespaces,
        hub.model.missing,
    )
    importable.product = machine.charge_product
    importable.find_frozen = functools.partial(frozen_module, hub=hub.model)
    return importable


def _pybricks_modules(context: Context) -> dict[str, ModuleType]:
    """``pybricks`` and the modules in it, by name."""
    machine = context.machine
    hub = machine.robot.hub
    messaging = messaging_module(context)
    parts = [
        hubs_module(context, hub.model),
        parameters_module(context),
        robotics_module(context),
    ]
    tools = tools_module(context, messaging.AppData)
    parts += [tools, messaging]
    # The Move hub, the only one without floats, has none of these either.
    if hub.model.has_float:
        parts += [iodevices_module(context), experimental_module(hub.model)]
    result = {f"pybricks.{part.__name__}": part for part in parts}
    screen_pixels = hub.model.screen_pixels
    if screen_pixels is not None:
        names = image_names(context, screen_pixels)
        vars(result["pybricks.parameters"]).update(names)
    for part in _DEVICE_MODULES[hub.model.devices](context):
        result[f"pybricks.{part.__name__}"] = part
    # On every hub a program finds its motors and sensors under this name.
    result.setdefault("pybricks.pupdevices", result[f"pybricks.{hub.model.devices}"])
    firmware = machine.firmware
    name = hub.model.firmware_name or f"{hub.value}hub"
    version = (name, firmware.version, firmware.build)
    result["pybricks"] = module("pybricks", {"version": version})
    # Programs still import the tools under this older name.
    if hub.model.has_float:
        result["pybricks.geometry"] = tools
    return result


def _language_modules(
    machine: Machine,
    console: Console,
    heap: Heap,
) -> dict[str, ModuleType]:
    """MicroPython's own modules, by name, also with the prefix ``u`` where they have it."""
    model = machine.robot.hub.model
    language = [system.errno_module()]
    if model.has_float:
        terminal = system.Terminal(console, machine.charge_call)
        build = machine.firmware.build
        language += [
            math_module(),
            random_module(machine.time_ms * 1000),
            struct_module(),
            system.json_module(),
            module("io", {}, BytesIO, IOBase, StringIO),
            system.gc_module(heap.statistics),
            system.micropython_module(terminal, heap.statistics),
            system.select_module(machine.advance_to_alarm, machine.charge_call),
            system.sys_module(terminal, build, model.machine),
        ]
    result = {part.__name__: part for part in language}
    for part in language:
        if part.__name__ in U_PREFIXED:
            result[f"u{part.__name__}"] = part
    return result
