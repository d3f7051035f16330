"""Modules that are frozen into the firmware, written anew: MicroPython that the virtual hub runs
where a program imports it."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources

from brickhub.hub.transport import HubModule
from brickhub.robot.hardware import HubModel


@dataclass(frozen=True)
class FrozenModule:
    """Module of the firmware that is itself a program.

    Attributes:
        name: by which a program imports it; its file here has the name without the first
            underscore.
        is_on: whether the firmware of a kind of hub has it.
    """

    name: str
    is_on: Callable[[HubModel], bool]


FROZEN = (
    FrozenModule("_builtin_port_view", lambda hub: hub.has_float),
    FrozenModule("_imu_calibrate", lambda hub: hub.has_imu),
)
"""As in the manifests of the firmware (``bricks/*/manifest.py``)."""


def frozen_module(name: str, hub: HubModel) -> HubModule | None:
    """The frozen module of that name; ``None`` if the firmware of the hub has none."""
    if not any(module.name == name and module.is_on(hub) for module in FROZEN):
        return None
    file = f"{name.removeprefix('_')}.py"
    text = resources.files(__package__).joinpath(file).read_text(encoding="utf-8")
    return HubModule(name, f"{name}.py", text.split("# --- the hub's part ---\n", 1)[1])
