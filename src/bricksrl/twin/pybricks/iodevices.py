"""``pybricks.iodevices``: the devices exist, and none of them is plugged in or near."""

from __future__ import annotations

import errno
from types import ModuleType
from typing import Any

from bricksrl.twin.micropython.numbers import module
from bricksrl.twin.pybricks.context import Context, RunLoop, bound, os_error
from bricksrl.twin.pybricks.parameters import Parameters


class _Wired:
    _loop: RunLoop
    _parameters: Parameters

    def __init__(self, port: Any, *args: Any, **kwargs: Any) -> None:
        self._loop.assert_blocking()
        self._parameters.port_letter(port)
        raise os_error(errno.ENODEV)


class _Wireless:
    _loop: RunLoop

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._loop.assert_blocking()
        raise os_error(errno.ETIMEDOUT)


def iodevices_module(context: Context, parameters: Parameters) -> ModuleType:
    names: dict[str, Any] = {}
    for name in ("PUPDevice", "UARTDevice"):
        own: Any = bound(type(name, (_Wired,), {}), context)
        own._parameters = parameters
        names[name] = own
    for name in ("LWP3Device", "XboxController"):
        names[name] = bound(type(name, (_Wireless,), {}), context)
    return module("pybricks.iodevices", names)
