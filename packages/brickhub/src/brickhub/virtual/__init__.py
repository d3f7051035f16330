"""Virtual hub: a Pybricks hub in software and simulated time, with any body as its robot.

It runs a LEGO hub's program: MicroPython's dialect, Pybricks' modules, the firmware's motor
control. Motors and sensors belong to a :class:`Body`: motors without load (:class:`BenchBody`), or
a twin of ``bricktwin.twin``.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brickhub.virtual.bench_body import BenchBody as BenchBody
    from brickhub.virtual.body import Body as Body
    from brickhub.virtual.run import run_file as run_file
    from brickhub.virtual.virtual_transport import VirtualHub as VirtualHub

__all__ = ["BenchBody", "Body", "VirtualHub", "run_file"]

_MODULES = {
    "BenchBody": "bench_body",
    "Body": "body",
    "VirtualHub": "virtual_transport",
    "run_file": "run",
}


# Each name is imported at first use, so that whoever needs one of them does not load the others.
def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
