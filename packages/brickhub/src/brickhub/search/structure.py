"""Structured policies: a few bounded numbers decide how a robot acts on what it observes."""

from collections.abc import Sequence
from importlib import resources
from typing import Protocol

from brickhub.entry import Entry

_HUBS_PART = "# --- the hub's part ---\n"


class Structure(Protocol):
    """A structured policy.

    Attributes:
        numbers: the numbers ``[p]``, with their ranges.
    """

    numbers: tuple[Entry, ...]

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> Sequence[float]:
        """Actions ``[m]`` on an observation ``[n]`` by numbers ``[p]``, in their units; what is
        beyond -1..1 is clamped."""


class HubStructure(Structure, Protocol):
    """A structured policy that a hub can act by."""

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""


def source_by(structure: HubStructure, numbers: Sequence[float]) -> str:
    """MicroPython that acts by numbers ``[p]``: ``act(observed)``."""
    # Five digits are a hundredth of a degree, which is finer than motors turn.
    listed = ", ".join(f"{number:.5g}" for number in numbers)
    lines = [
        structure.hub_source(),
        f"NUMBERS = ({listed},)",
        "",
        "",
        "def act(observed):",
        "    return act_by(observed, NUMBERS)",
    ]
    return "\n".join(lines) + "\n"


def formula_source(name: str) -> str:
    """The hub's part of a file in ``onboard``, with what it imports on a hub."""
    file = resources.files(f"{__package__}.onboard").joinpath(f"{name}.py")
    text = file.read_text(encoding="utf-8")
    part = text.split(_HUBS_PART, 1)[1].strip()
    return f"import umath\n\n\n{part}\n\n"
