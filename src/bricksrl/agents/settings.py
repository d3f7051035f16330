"""What settings of agents are made of: parts that several have, with their checks. Plain data: importing this loads no torch.

An agent's settings inherit the parts they need. No part inherits another one's fields: where two ways lead to a field,
a dataclass takes the default of the part that is named first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

from bricksrl.errors import DescriptionError

LARGEST, MOST_UNITS = 2**24, 2**14
"""Of any setting, and of a layer: settings come from files too, and one that fills the memory is a mistake or worse."""


class Checked:
    """A part of settings: its ``__post_init__`` checks what it has, and calls that of the part after it."""

    def __post_init__(self) -> None:
        """The last part of all."""

    def _above_zero(self, *names: str) -> None:
        for name in names:
            if not 0 < getattr(self, name) <= LARGEST:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number above zero, and up to {LARGEST:,}")

    def _zero_or_more(self, *names: str) -> None:
        for name in names:
            if not 0 <= getattr(self, name) <= LARGEST:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give 0 or more, and up to {LARGEST:,}")

    def _share(self, *names: str) -> None:
        for name in names:
            if not 0 <= getattr(self, name) <= 1:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number from 0 to 1")

    def _one_of(self, name: str, *choices: str) -> None:
        if getattr(self, name) not in choices:
            *others, last = choices
            raise DescriptionError(f"{name} is '{getattr(self, name)}'; choose {', '.join(others)} or {last}")


@dataclass(frozen=True)
class CommonSettings(Checked):
    """What all agents have in common that learn. The defaults are tuned for few robot steps."""

    learning_rate: float = 1e-3
    """Adam's step size."""
    adam_beta: float = 0.9
    """Share of the past in Adam's mean of the gradients."""
    batch_size: int = 256
    """Transitions in one update."""
    updates_per_step: int = 2
    """Updates of the critics for each step of the robot."""
    angles: Literal["phases", "sincos", "raw"] = "phases"
    """How the networks see angles that wrap: as sine and cosine, with those of their differences too, or scaled to -1..1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise DescriptionError(f"{field.name} is {value}; give a finite number")
        self._above_zero("learning_rate", "batch_size", "updates_per_step")
        self._share("adam_beta")
        if self.adam_beta == 1.0:
            raise DescriptionError("adam_beta is 1, which learns nothing; give a number below 1")
        self._one_of("angles", "phases", "sincos", "raw")


@dataclass(frozen=True)
class LayerSettings(Checked):
    """For multilayer perceptrons."""

    hidden: tuple[int, ...] = (256, 256)
    """Units of each hidden layer, of the actor and of the critics."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.hidden or min(self.hidden) < 1 or max(self.hidden) > MOST_UNITS:
            wanted = f"the units of at least one layer, up to {MOST_UNITS:,} in each"
            raise DescriptionError(f"hidden is {self.hidden}; give {wanted}, as in (256, 256)")


@dataclass(frozen=True)
class LearnerSettings(CommonSettings):
    """What all agents have in common that learn from observations without images."""

    goals: Literal["difference", "plain"] = "difference"
    """What the networks see of a goal: also how far it is from what it is a goal for, or itself only."""

    # What an agent does that learns from a dataset alone; others have settings of these names.
    prefill_episodes = 0
    replay_size = 1
    actor_delay = 1
    hindsight = 0.0
    new_goals = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._one_of("goals", "difference", "plain")


@dataclass(frozen=True)
class ReplaySettings(Checked):
    """What all agents have in common that learn values from a replay buffer, with images or without."""

    gamma: float = 0.95
    """Discount of the next step's value."""
    actor_delay: int = 1
    """The actor learns in every n-th update of the critics."""
    prefill_episodes: int = 1
    """Episodes of uniform actions at the start."""
    replay_size: int = 1_000_000
    """Transitions kept; the oldest go first."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("actor_delay", "replay_size")
        self._share("gamma")
        self._zero_or_more("prefill_episodes")


@dataclass(frozen=True)
class TargetSettings(Checked):
    """For critics that learn from slowly following copies of themselves."""

    tau: float = 0.005
    """Share of the critics that goes into the target critics at each update."""
    layer_norm: bool = True
    """Layer normalisation in the critics."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("tau")
        self._share("tau")


@dataclass(frozen=True)
class ActorSettings(Checked):
    """For actors that may be taken from an agent that imitates."""

    actor_layer_norm: bool = False
    """Layer normalisation in the actor."""


@dataclass(frozen=True)
class EntropySettings(Checked):
    """For actors that are as random as the entropy asks for."""

    initial_alpha: float = 0.2
    """Temperature (weight of the entropy) at the start; it is learned from there."""
    entropy: float = -1.0
    """Entropy for each entry of an action that the temperature is learned for; uniform actions have 0.69."""
    min_scale: float = 0.1
    """Lower limit of the standard deviation of an action before the tanh."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("initial_alpha", "min_scale")


@dataclass(frozen=True)
class NoiseSettings(Checked):
    """For actors without randomness of their own, as TD3's."""

    exploration_noise: float = 0.3
    """Standard deviation of the noise on the actions while learning; actions are in -1..1."""
    target_noise: float = 0.1
    """Standard deviation of the noise on the target actor's actions."""
    target_noise_limit: float = 0.5
    """Limit of that noise to either side."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("target_noise_limit")
        self._zero_or_more("exploration_noise", "target_noise")
