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


_MARK = "# --- the hub's part ---\n"
FROZEN = (
    FrozenModule("_builtin_port_view", lambda hub: hub.has_float),
    FrozenModule("_imu_calibrate", lambda hub: hub.has_imu),
)
"""As in the manifests of the firmware (``bricks/*/manifest.py``)."""


def frozen_module(name: str, hub: HubModel) -> HubModule | None:
    """The frozen module of that name; ``None`` if the firmware of the hub has none."""
    names_of_hub = [module.name for module in FROZEN if module.is_on(hub)]
    if name not in names_of_hub:
        return None
    # `resources` finds the file even if the package lies in an archive.
    file = resources.files(__package__).joinpath(f"{name.removeprefix('_')}.py")
    text = file.read_text(encoding="utf-8")
    # What stands before the mark is for people and tools, and a hub's memory has no room for it.
    _, source = text.split(_MARK, 1)
    return HubModule(name, f"{name}.py", source)
