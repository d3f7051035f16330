"""Settings of algorithms: frozen dataclasses with ranges as annotations.

Field docstrings are the help of ``bricksrl settings AGENT``. Importing this loads no torch.
"""

import itertools
from dataclasses import dataclass
from typing import Annotated, Literal

from brickhub.fields import Range as Range  # noqa: PLC0414  users find it beside its shorthands
from brickhub.fields import check_fields
from bricksrl.errors import DescriptionError

MAX_UNITS = 2**14
MAX_WEIGHTS = 2**26
"""Limits of layer sizes and hidden weights, as settings come from files."""
Positive = Range(above=True)
NotNegative = Range()
Share = Range(0.0, 1.0)
ShareBelowOne = Range(0.0, 1.0, below=True)
Norm = Literal["none", "layer", "rms", "batch"]
"""Normalisation of the hidden layers of a network: ``nn.LayerNorm``, ``nn.RMSNorm``,
``nn.BatchNorm1d``."""


@dataclass(frozen=True)
class Settings:
    """Settings of all learning algorithms. Defaults are tuned for few robot steps."""

    learning_rate: Annotated[float, Positive] = 1e-3
    """Adam's step size."""
    adam_beta: Annotated[float, ShareBelowOne] = 0.9
    """Share of the past in Adam's mean of the gradients (beta 1)."""
    batch_size: Annotated[int, Range(1)] = 256
    """Transitions in one update."""
    hidden: tuple[int, ...] = (256, 256)
    """Units of each hidden layer, of the policy and of the critics."""
    network: str = ""
    """Your own networks instead of multilayer perceptrons: FILE.py:NAME, a function of the sizes in
    and out."""
    angles: Literal["phases", "sincos", "raw"] = "phases"
    """Features of angles that wrap: sine and cosine, also of differences (phases) or not (sincos),
    or scaled (raw)."""
    goals: Literal["difference", "plain"] = "difference"
    """Features of a goal: itself and its difference to the current value, or itself only."""
    normalize: bool = False
    """Scale numbers by the mean and deviation of what was seen, instead of by their range; angles
    stay sine and cosine."""
    encoder: Literal["keypoints", "convolutions"] = "keypoints"
    """Image features: learned keypoints, or the paper's convolutions with dense layers."""

    def __post_init__(self) -> None:
        check_fields(type(self), vars(self))
        if not self.hidden or not all(
            isinstance(units, int) and 1 <= units <= MAX_UNITS for units in self.hidden
        ):
            valid = (
                f"the units of at least one layer, up to {MAX_UNITS:,} in each, as in (256, 256)"
            )
            raise DescriptionError(f"hidden is {self.hidden}; give {valid}")
        weights = sum(before * after for before, after in itertools.pairwise(self.hidden))
        if weights > MAX_WEIGHTS:
            raise DescriptionError(
                f"hidden is {self.hidden}: {weights:,} weights a network; give up to "
                f"{MAX_WEIGHTS:,}"
            )


@dataclass(frozen=True)
class OffPolicySettings(Settings):
    """Settings of algorithms with value functions and a replay buffer."""

    gamma: Annotated[float, Share] = 0.95
    """Discount of the next step's value."""
    updates_per_step: Annotated[float, Positive] = 2.0
    """Updates of the critics for each robot step (update-to-data ratio); copies that step together
    count as one robot."""
    actor_delay: Annotated[int, Range(1)] = 1
    """The actor is updated in every n-th update of the critics."""
    prefill_episodes: Annotated[int, NotNegative] = 1
    """Episodes of uniform actions at the start."""
    buffer_size: Annotated[int, Range(2)] = 1_000_000
    """Transitions kept in the replay buffer; the oldest are overwritten first."""
    memory_mapped: bool = False
    """Keep the replay buffer in a temporary file rather than in memory."""
    n_step: Annotated[int, Range(1, 64)] = 1
    """Steps whose rewards are summed before a value is bootstrapped (n-step returns)."""
    scale_rewards: bool = True
    """Where the rewards of the initial random episodes are small, learn them in the power of ten
    that is nearest to them."""
    hindsight: Annotated[float, Share] = 0.3
    """In a task with goals: share of each batch whose goal is replaced by what was reached a few
    steps later."""
    new_goals: Annotated[float, Share] = 0.3
    """In a task with goals: share of each batch with goals redrawn from their range."""
    mirror: bool = True
    """Where task and robot are symmetric: mirror half of the rows of each batch from left to
    right."""
    shift_px: Annotated[int, Range(0, 64)] = 0
    """Random shift of each image in a batch, in px, as augmentation; 4 is usual for
    convolutions."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hindsight + self.new_goals > 1:
            raise DescriptionError(
                f"hindsight and new_goals add up to {self.hindsight + self.new_goals:g}; give up "
                "to 1 in all"
            )


@dataclass(frozen=True)
class TargetSettings(OffPolicySettings):
    """Settings of algorithms with target networks."""

    tau: Annotated[float, Range(0.0, 1.0, above=True)] = 0.005
    """Step of target networks towards the others at each update (soft update); TD3: at each update
    of the actor."""
    critic_norm: Norm = "layer"
    """Normalisation in the critics, before each ReLU."""


@dataclass(frozen=True)
class CriticSettings(TargetSettings):
    """Settings of algorithms with target networks and plain critics."""

    reset_every: Annotated[int, NotNegative] = 0
    """Updates after which the networks start anew and learn from the replay again (Nikishin et al.,
    2022); 0 for never."""
    critic_loss: Literal["squared", "smooth-l1"] = "squared"
    """Loss of the critics' errors: squared, or of their size beyond 1."""
