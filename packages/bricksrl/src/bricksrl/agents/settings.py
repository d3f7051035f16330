"""Settings of algorithms: frozen dataclasses with ranges as annotations.

Field docstrings are the help of ``bricksrl settings AGENT``. Importing this loads no torch.
"""

import itertools
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from brickhub.fields import Range as Range  # noqa: PLC0414  users find it beside its shorthands
from brickhub.fields import check_fields
from bricksrl.errors import DescriptionError

# settings come from files: a typing error must not ask for all of the memory
MAX_UNITS = 2**14
"""Most units of a hidden layer."""
MAX_WEIGHTS = 2**26
"""Most weights between the hidden layers of a network."""
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
        are_sizes = all(isinstance(units, int) and 1 <= units <= MAX_UNITS for units in self.hidden)
        if not self.hidden or not are_sizes:
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
class TargetSettings:
    """Settings of target networks, beside those of an algorithm with value functions."""

    tau: Annotated[float, Range(0.0, 1.0, above=True)] = 0.005
    """Step of target networks towards the others at each update (soft update); TD3: at each update
    of the actor."""
    critic_norm: Norm = "layer"
    """Normalisation in the critics, before each ReLU."""


@dataclass(frozen=True)
class CriticSettings:
    """Settings of plain critics, beside those of target networks."""

    reset_every: Annotated[int, NotNegative] = 0
    """Updates after which the networks start anew and learn from the replay again (Nikishin et al.,
    2022); 0 for never."""
    critic_loss: Literal["squared", "smooth-l1"] = "squared"
    """Loss of the critics' errors: squared, or of their size beyond 1."""


@dataclass(frozen=True)
class EntropySettings:
    """Settings of maximum-entropy policies, beside those of an algorithm with value functions."""

    alpha_init: Annotated[float, Positive] = 0.2
    """Initial temperature (weight of the entropy); it is learned."""
    target_entropy: Annotated[float, Range(-1e6, 1e6)] = -1.0
    """Target entropy per action entry; uniform actions have 0.69."""
    min_scale: Annotated[float, Positive] = 0.1
    """Lower limit of the standard deviation of an action before the tanh."""


PARTS = (TargetSettings, CriticSettings, EntropySettings)
"""Settings that are none alone: an algorithm inherits them beside `OffPolicySettings`."""


@dataclass(frozen=True)
class Presets:
    """Settings of an algorithm by the name of a preset."""

    default: Any
    """Tuned for few robot steps."""
    images: Any
    """The default for an environment with a camera."""
    paper: Any
    """The values of the BricksRL paper, and those of the algorithm's authors for what the paper
    does not state."""


# What the presets of several algorithms share. An algorithm states what is its own beside its
# settings; a name that these do not have is an error there.
IMAGES: dict[str, Any] = {
    "hidden": (128, 128),
    "learning_rate": 1e-3,
    "batch_size": 64,
    "angles": "sincos",
    "goals": "plain",
}
"""From images, on one processor core: small networks and batches, as the images cost most."""
IMAGES_OFF_POLICY: dict[str, Any] = {
    **IMAGES,
    "gamma": 0.9,
    "updates_per_step": 1.0,
    "prefill_episodes": 5,
    "buffer_size": 15_000,
}
"""The same for `OffPolicySettings`; so few transitions with images fit into memory."""
IMAGES_TARGETS: dict[str, Any] = {**IMAGES_OFF_POLICY, "tau": 0.01}
"""The same with `TargetSettings`."""
PAPER: dict[str, Any] = {
    "hidden": (256, 256),
    "learning_rate": 3e-4,
    "batch_size": 256,
    "angles": "raw",
    "goals": "plain",
    "encoder": "convolutions",
}
"""Networks and optimiser of the BricksRL paper."""
PAPER_OFF_POLICY: dict[str, Any] = {
    **PAPER,
    "gamma": 0.99,
    "updates_per_step": 1.0,
    "prefill_episodes": 10,
    # the paper relabels, mirrors and scales nothing
    "hindsight": 0.0,
    "new_goals": 0.0,
    "mirror": False,
    "scale_rewards": False,
}
"""The same for `OffPolicySettings`."""
PAPER_TARGETS: dict[str, Any] = {**PAPER_OFF_POLICY, "tau": 0.005, "critic_norm": "none"}
"""The same with `TargetSettings`."""
