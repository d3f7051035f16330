"""Settings of the agents, and the tuned ones by name. Plain data: importing this loads no torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bricksrl.errors import DescriptionError, UnknownNameError


@dataclass(frozen=True)
class SACSettings:
    """Soft actor-critic. The defaults are tuned for few robot steps; ``preset("paper")`` gives the paper's."""

    hidden: tuple[int, ...] = (128, 128)
    """Units of each hidden layer, of the actor and of the critics."""
    learning_rate: float = 1e-3
    """Adam's step size, for actor, critics and temperature."""
    batch_size: int = 128
    """Transitions in one update."""
    gamma: float = 0.99
    """Discount of the next step's value."""
    tau: float = 0.005
    """Share of the critics that goes into the target critics at each update."""
    updates_per_step: int = 2
    """Updates for each step of the robot."""
    prefill_episodes: int = 2
    """Episodes of uniform actions at the start."""
    initial_alpha: float = 0.1
    """Temperature (weight of the entropy) at the start; it is learned from there."""
    min_scale: float = 0.1
    """Lower limit of the standard deviation of an action before the tanh."""
    layer_norm: bool = True
    """Layer normalisation in the critics."""
    dropout: float = 0.0
    """Dropout rate in the critics."""
    angles: Literal["sincos", "raw"] = "sincos"
    """How the networks see an angle that wraps: as sine and cosine, or scaled to -1..1."""
    replay_size: int = 1_000_000
    """Transitions kept; the oldest go first."""

    def __post_init__(self) -> None:
        positive = ("learning_rate", "batch_size", "tau", "updates_per_step", "initial_alpha", "min_scale", "replay_size")
        for name in positive:
            if getattr(self, name) <= 0:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number above zero")
        for name in ("gamma", "tau", "dropout"):
            if not 0 <= getattr(self, name) <= 1:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number from 0 to 1")
        if not self.hidden or min(self.hidden) < 1:
            raise DescriptionError(f"hidden is {self.hidden}; give the units of at least one layer, as in (256, 256)")
        if self.prefill_episodes < 0:
            raise DescriptionError(f"prefill_episodes is {self.prefill_episodes}; give 0 or more")
        if self.angles not in ("sincos", "raw"):
            raise DescriptionError(f"angles is '{self.angles}'; choose sincos or raw")


PAPER = SACSettings(
    hidden=(256, 256),
    learning_rate=3e-4,
    batch_size=256,
    updates_per_step=1,
    prefill_episodes=10,
    initial_alpha=1.0,
    layer_norm=False,
    angles="raw",
)
"""The settings of the BricksRL paper."""

DROQ = SACSettings(hidden=(256, 256), learning_rate=3e-4, batch_size=256, updates_per_step=20, dropout=0.01)
"""DroQ: many updates a step, held together by dropout and layer normalisation."""

PRESETS = {"default": SACSettings(), "paper": PAPER, "droq": DROQ}


def preset(name: str) -> SACSettings:
    """The settings of that name.

    Raises:
        UnknownNameError: there are none.
    """
    try:
        return PRESETS[name]
    except KeyError:
        raise UnknownNameError(f"there is no preset '{name}'; choose one of {', '.join(sorted(PRESETS))}") from None
