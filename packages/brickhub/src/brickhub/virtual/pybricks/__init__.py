"""Stand-ins for ``pybricks.*`` and the modules of MicroPython, on a simulated clock."""

import functools
from typing import Any

from brickhub.hub.program.compile import U_PREFIXED
from brickhub.virtual.frozen import frozen_module
from brickhub.virtual.interpreter import Modules
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython import system
from brickhub.virtual.micropython.memory import Heap, check_of_calls, most_nested_calls
from brickhub.virtual.micropython.numbers import math_module, module, random_module, struct_module
from brickhub.virtual.micropython.streams import BytesIO, Console, IOBase, StringIO
from brickhub.virtual.micropython.transform import COMPREHENSIONS
from brickhub.virtual.pybricks.context import Context
from brickhub.virtual.pybricks.experimental import experimental_module
from brickhub.virtual.pybricks.hubs import hubs_module
from brickhub.virtual.pybricks.iodevices import iodevices_module
from brickhub.virtual.pybricks.parameters import enumeration, parameters_module
from brickhub.virtual.pybricks.pupdevices import pupdevices_module
from brickhub.virtual.pybricks.robotics import robotics_module
from brickhub.virtual.pybricks.tools import tools_module
from brickhub.virtual.pybricks.wireless import messaging_module


def modules(machine: Machine, console: Console) -> Modules:
    """Modules that a program on this machine can import: fresh ones, for one run.

    Returns:
        Modules by name, as a dict; exactly those of the robot's kind of hub.
    """
    hub = machine.robot.hub
    machine.runs_program = True
    context = Context(machine, console, enumeration("Port", " ".join(hub.model.ports)))
    messaging = messaging_module(context)
    parts = [
        hubs_module(context, hub.model),
        parameters_module(context),
        pupdevices_module(context),
        robotics_module(context),
    ]
    parts += [tools := tools_module(context, messaging.AppData), messaging]
    parts += (
        [iodevices_module(context), experimental_module(hub.model)] if hub.model.has_float else []
    )
    result = {f"pybricks.{part.__name__}": part for part in parts}
    firmware = machine.firmware
    result["pybricks"] = module(
        "pybricks", {"version": (f"{hub.value}hub", firmware.version, firmware.build)}
    )
    if hub.model.has_float:
        result["pybricks.geometry"] = tools
    heap = Heap(hub.model)
    machine.check_memory = heap.check
    language = [system.errno_module()]
    if hub.model.has_float:
        terminal = system.Terminal(console, machine.charge_call)
        language += [
            math_module(),
            random_module(machine.time_ms * 1000),
            struct_module(),
            system.json_module(),
        ]
        language += [module("io", {}, BytesIO, IOBase, StringIO), system.gc_module(heap.statistics)]
        language += [system.micropython_module(terminal, heap.statistics)]
        language += [system.select_module(machine.advance_to_alarm, machine.charge_call)]
        language += [system.sys_module(terminal, firmware.build, hub.model.machine)]
    result |= {part.__name__: part for part in language}
    result |= {f"u{part.__name__}": part for part in language if part.__name__ in U_PREFIXED}
    machine.branch(None)
    hooks: dict[str, Any] = {"@tick": machine.turn_loop, "@turn": machine.turn}
    hooks |= dict.fromkeys(("@branch", *COMPREHENSIONS), machine.branch)
    hooks["@callee"] = check_of_calls(most_nested_calls(hub))
    importable = Modules(result, hooks, heap.namespaces, hub.model.missing)
    importable.product = machine.charge_product
    importable.find_frozen = functools.partial(frozen_module, hub=hub.model)
    return importable
