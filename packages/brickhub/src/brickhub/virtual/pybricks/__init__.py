"""Stand-ins for ``pybricks.*`` and the modules of MicroPython, on a simulated clock."""

from __future__ import annotations

from types import ModuleType

from brickhub.robot import HubKind
from brickhub.virtual.interpreter import Modules
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.memory import Heap, check_of_calls, most_nested_calls
from brickhub.virtual.micropython.numbers import math_module, module, random_module, struct_module
from brickhub.virtual.micropython.streams import Console
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
from brickhub.virtual.pybricks.parameters import parameters_module, ports
from brickhub.virtual.pybricks.pupdevices import pupdevices_module
from brickhub.virtual.pybricks.robotics import robotics_module
from brickhub.virtual.pybricks.tools import tools_module

FIRMWARE_VERSION = "4.0.1"
FIRMWARE_BUILD = "v4.0.1 on 2026-06-23"
_MACHINES = {
    HubKind.PRIME: "SPIKE Prime Hub with STM32F413VG",
    HubKind.ESSENTIAL: "SPIKE Essential Hub with STM32F413RG",
    HubKind.TECHNIC: "Technic Hub with STM32L431RC",
    HubKind.CITY: "Powered Up City Hub with STM32F030RC",
    HubKind.MOVE: "BOOST Move Hub with STM32F070RB",
}
_MISSING_BUILTINS = {
    HubKind.TECHNIC: ("memoryview",),
    HubKind.CITY: ("memoryview",),
    HubKind.MOVE: ("bytearray", "complex", "enumerate", "float", "input", "memoryview", "reversed", "set"),
}
"""Builtin names that the configuration of the firmware leaves out."""
_U_PREFIXED = ("sys", "select", "struct", "math", "random", "json", "io", "errno")


def modules(machine: Machine, console: Console) -> Modules:
    """Modules that a program on this machine can import: fresh ones, for one run.

    Returns:
        Modules by name, as a dict; exactly those of the robot's kind of hub.
    """
    hub = machine.robot.hub
    machine.runs_program = True
    context = Context(machine, console, ports(hub.model))
    has_display = hub is HubKind.PRIME
    messaging = messaging_module(context)
    pybricks = {
        "hubs": hubs_module(context, hub),
        "parameters": parameters_module(context, has_display),
        "pupdevices": pupdevices_module(context),
        "iodevices": iodevices_module(context),
        "robotics": robotics_module(context),
        "tools": tools_module(context, has_display, messaging.AppData),
        "messaging": messaging,
    }
    if hub is HubKind.MOVE:
        del pybricks["iodevices"]
    result = {f"pybricks.{name}": part for name, part in pybricks.items()}
    result["pybricks"] = module("pybricks", {"version": (f"{hub.value}hub", FIRMWARE_VERSION, FIRMWARE_BUILD)})
    if hub.model.has_float:
        result["pybricks.geometry"] = pybricks["tools"]
    heap = Heap(hub)
    machine.check_memory = heap.check
    language = _language_modules(machine, console, heap)
    result.update(language)
    result.update({f"u{name}": language[name] for name in _U_PREFIXED if name in language})
    machine.branch(None)
    hooks = machine.turn_loop, machine.turn, machine.branch, check_of_calls(most_nested_calls(hub))
    return Modules(result, *hooks, heap.namespaces, missing_builtins=_MISSING_BUILTINS.get(hub, ()))


def _language_modules(machine: Machine, console: Console, heap: Heap) -> dict[str, ModuleType]:
    hub = machine.robot.hub
    if hub is HubKind.MOVE:
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
        "sys": sys_module(console, keyboard, machine.charge_call, FIRMWARE_VERSION, _MACHINES[hub]),
    }
