"""Stand-ins for ``pybricks.*`` and the modules of MicroPython, on a simulated clock."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

from brickhub.virtual.interpreter import Modules
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython import system
from brickhub.virtual.micropython.memory import Heap, check_of_calls, most_nested_calls
from brickhub.virtual.micropython.numbers import math_module, module, random_module, struct_module
from brickhub.virtual.micropython.streams import Console
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.hubs import hubs_module
from brickhub.virtual.pybricks.iodevices import iodevices_module
from brickhub.virtual.pybricks.parameters import enumeration, parameters_module
from brickhub.virtual.pybricks.pupdevices import pupdevices_module
from brickhub.virtual.pybricks.robotics import robotics_module
from brickhub.virtual.pybricks.tools import tools_module
from brickhub.virtual.pybricks.wireless import messaging_module

_U_PREFIXED = ("sys", "select", "struct", "math", "random", "json", "io", "errno")


def modules(machine: Machine, console: Console) -> Modules:
    """Modules that a program on this machine can import: fresh ones, for one run.

    Returns:
        Modules by name, as a dict; exactly those of the robot's kind of hub.
    """
    hub = machine.robot.hub
    machine.runs_program = True
    context = Context(machine, console, enumeration("Port", " ".join(hub.model.ports)))
    messaging = messaging_module(context)
    parts = [hubs_module(context, hub.model), parameters_module(context), pupdevices_module(context), robotics_module(context)]
    parts += [tools := tools_module(context, messaging.AppData), messaging]
    parts += [iodevices_module(context)] if hub.model.has_float else []
    result = {f"pybricks.{part.__name__}": part for part in parts}
    firmware = machine.firmware
    result["pybricks"] = module("pybricks", {"version": (f"{hub.value}hub", firmware.version, firmware.build)})
    if hub.model.has_float:
        result["pybricks.geometry"] = tools
    heap = Heap(hub.model)
    machine.check_memory = heap.check
    language = {part.__name__: part for part in _language_modules(machine, console, heap)}
    result.update(language)
    result.update({f"u{name}": language[name] for name in _U_PREFIXED if name in language})
    machine.branch(None)
    hooks = machine.turn_loop, machine.turn, machine.branch, check_of_calls(most_nested_calls(hub))
    importable = Modules(result, *hooks, heap.namespaces, missing_builtins=hub.model.missing)
    importable.product = machine.charge_product
    return importable


def _language_modules(machine: Machine, console: Console, heap: Heap) -> Iterator[ModuleType]:
    hub = machine.robot.hub.model
    yield system.errno_module()
    if hub.has_float:
        terminal = system.Terminal(console, machine.charge_call)
        yield from (math_module(), random_module(machine.time_ms * 1000), struct_module())
        yield from (system.json_module(), system.io_module(), system.gc_module(heap.statistics))
        yield system.micropython_module(terminal, heap.statistics)
        yield system.select_module(machine.advance_to_alarm, machine.charge_call)
        yield system.sys_module(terminal, machine.firmware.version, hub.machine)
