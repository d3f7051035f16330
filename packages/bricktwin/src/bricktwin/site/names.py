"""Names that a program can use, for the page's editor, and the devices of the bench."""

import inspect
from typing import Any

from brickhub.hub.transports import profile
from brickhub.hub.transports.usb import LEGO_VENDOR, PRODUCTS
from brickhub.robot import HubKind, MotorKind, SensorKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules
from brickhub.virtual.stimuli import COLORS


class _NoConsole:
    """A console of which nothing is asked."""


def pybricks_names() -> dict[str, Any]:
    """What a program for the Prime hub can name: ``modules`` with their names, ``members`` of
    classes, ``parts`` of a hub with their members."""
    machine = Machine(FittedBench(HubKind.PRIME))
    names: dict[str, list[str]] = {}
    members: dict[str, list[str]] = {}
    importable = modules(machine, _NoConsole())  # type: ignore[arg-type]
    for module_name, module in sorted(importable.items()):
        public = _public(module)
        names[module_name] = public
        for name in public:
            value = getattr(module, name)
            # Colors and icons are members of what is no class on the hub.
            is_named = isinstance(value, type) or not inspect.isroutine(value)
            if is_named and module_name.startswith("pybricks"):
                members[name] = _public(value)
    members["Color"] = list(COLORS)
    hub = importable["pybricks.hubs"].PrimeHub()
    members["PrimeHub"] = _public(hub)
    parts = {name: _public(getattr(hub, name)) for name in members["PrimeHub"]}
    return {"modules": names, "members": members, "parts": parts}


def _public(owner: object) -> list[str]:
    return [name for name in dir(owner) if not name.startswith("_")]


def device_table() -> dict[str, Any]:
    """Motors and sensors by the class of a program, with what each of them senses; buttons and
    display of the hubs, likewise."""
    motors = sorted({"Motor", "DCMotor", *(kind.model.class_name for kind in MotorKind)})
    sensors = {kind.value: list(map(str, kind.model.senses)) for kind in SensorKind}
    hubs = {}
    for kind in HubKind:
        model = kind.model
        panel = {
            "buttons": list(model.buttons),
            "display": model.has_display,
            "screen": model.screen_pixels,
        }
        hubs[model.class_name] = panel
        # An EV3 Brick has the name of the Prime hub too, whose it is.
        if model.alias:
            hubs.setdefault(model.alias, panel)
    return {"motors": motors, "sensors": sensors, "hubs": hubs}


def link_names() -> dict[str, Any]:
    """What a page has to name to a browser: how it asks for a hub with ``bluetooth``, and on a
    ``cable``; and the characteristic of Bluetooth that takes a ``command``."""
    return {
        "bluetooth": {
            "filters": [{"services": [profile.SERVICE_UUID]}],
            "optionalServices": [profile.DEVICE_INFORMATION_UUID],
        },
        "cable": {
            "filters": [
                {"usbVendorId": LEGO_VENDOR, "usbProductId": product} for product in PRODUCTS
            ]
        },
        "command": profile.COMMAND_EVENT_UUID,
    }
