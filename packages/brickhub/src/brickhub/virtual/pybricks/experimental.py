"""``pybricks.experimental``: what is left there in version 4 (``pb_module_experimental.c``).

What older programs imported from it, such as ``getchar``, is not there any more.
"""

from types import ModuleType
from typing import Any

from brickhub.robot.hardware import HubModel
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.arguments import get_int


def hello_world(foo: Any, bar: Any = None) -> int:
    """The firmware's example of a function: the square of ``foo``."""
    return get_int(foo) ** 2


def restore_firmware() -> None:
    """Would replace Pybricks by LEGO's firmware."""
    raise NotImplementedError("the virtual hub has no other firmware to restore; use a real hub")


def experimental_module(hub: HubModel) -> ModuleType:
    """The module of a kind of hub."""
    names: dict[str, Any] = {"hello_world": hello_world}
    # Only SPIKE's hubs, which are rechargeable, keep LEGO's firmware, and can restore it.
    if hub.is_rechargeable:
        names["restore_firmware"] = restore_firmware
    return module("experimental", names)
