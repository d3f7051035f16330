"""Stand-ins for ``pybricks.*`` and the modules of MicroPython, on a simulated clock."""

from __future__ import annotations

from types import ModuleType

from brickhub.virtual.call_stack import check_of_calls, most_nested_calls
from brickhub.virtual.console import Console
from brickhub.virtual.heap import Heap
from brickhub.virtual.interpreter import Modules
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.numbers import math_module, module, random_module, struct_module
from brickhub.virtual.micropython.system import (
    Keyboard,
    errno_module,
    gc_module,
    io_module,
    json_module,
    micropython_module,
    select_module,
    sys_module,
)
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.hubs import hubs_module
from brickhub.virtual.pybricks.iodevices import iodevices_module
from brickhub.virtual.pybricks.messaging import messaging_module
from brickhub.virtual.pybricks.parameters import Parameters
from brickhub.virtual.pybricks.pupdevices import pupdevices_module
from brickhub.virtual.pybricks.robotics import robotics_module
from brickhub.virtual.pybricks.tools import tools_module

FIRMWARE_VERSION = "4.0.1"
FIRMWARE_BUILD = "v4.0.1 on 2026-06-23"
_U_PREFIXED = ("sys", "select", "struct", "math", "random", "json", "io", "errno")


def modules(machine: Machine, console: Console) -> Modules:
    """Modules that a program on this machine can import: fresh ones, for one run.

    Returns:
        Modules by name, as a dict; exactly those of the robot's kind of hub.
    """
    hub = machine.robot.hub
    machine.runs_program = True
    context = Context(machine, console)
    parameters = Parameters(hub.model)
    messaging = messaging_module(context)
    pybricks = {
        "hubs": hubs_module(context, hub.model),
        "parameters": parameters.module(),
        "pupdevices": pupdevices_module(context, parameters),
        "iodevices": iodevices_module(context, parameters),
        "robotics": robotics_module(context),
        "tools": tools_module(context, messaging.AppData),
        "messaging": messaging,
    }
    if not hub.model.has_float:
        del pybricks["iodevices"]
    result = {f"pybricks.{name}": part for name, part in pybricks.items()}
    result["pybricks"] = module("pybricks", {"version": (f"{hub.value}hub", FIRMWARE_VERSION, FIRMWARE_BUILD)})
    if hub.model.has_float:
        result["pybricks.geometry"] = pybricks["tools"]
    heap = Heap(hub.model)
    machine.check_memory = heap.check
    language = _language_modules(machine, console, heap)
    result.update(language)
    result.update({f"u{name}": language[name] for name in _U_PREFIXED if name in language})
    machine.branch(None)
    hooks = machine.turn_loop, machine.turn, machine.branch, check_of_calls(most_nested_calls(hub))
    return Modules(result, *hooks, heap.namespaces, missing_builtins=hub.model.missing)


def _language_modules(machine: Machine, console: Console, heap: Heap) -> dict[str, ModuleType]:
    hub = machine.robot.hub.model
    if not hub.has_float:
        return {"errno": errno_module()}
    keyboard = Keyboard()
    return {
        "errno": errno_module(),
        "micropython": micropython_module(keyboard, console, heap.statistics),
        "math": math_module(),
        "random": random_module(machine.time_ms * 1000),
        "struct": struct_module(),
        "json": json_module(),
        "io": io_module(),
        "gc": gc_module(heap.statistics),
        "select": select_module(machine.advance_to_alarm, machine.charge_call),
        "sys": sys_module(console, keyboard, machine.charge_call, FIRMWARE_VERSION, hub.machine),
    }
