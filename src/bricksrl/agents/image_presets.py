"""Settings of the agents that learn from images. Plain data: importing this loads no torch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ImageSettings:
    """What all agents have in common that learn from images. The defaults are tuned for few robot steps on one processor core."""

    hidden: tuple[int, ...] = (128, 128)
    """Units of each hidden layer, of the actor and of the critics."""
    learning_rate: float = 1e-3
    """Adam's step size."""
    adam_beta: float = 0.9
    """Share of the past in Adam's mean of the gradients."""
    batch_size: int = 64
    """Transitions in one update."""
    gamma: float = 0.9
    """Discount of the next step's value."""
    updates_per_step: int = 1
    """Updates of the critics for each step of the robot."""
    actor_delay: int = 1
    """The actor learns in every n-th update of the critics."""
    prefill_episodes: int = 5
    """Episodes of uniform actions at the start."""
    angles: Literal["phases", "sincos", "raw"] = "sincos"
    """How the networks see angles that wrap, as in `OffPolicySettings`."""
    replay_size: int = 15_000
    """Images kept, one for each step and one for each reset; the oldest go first."""
    encoder: Literal["keypoints", "convolutions"] = "keypoints"
    """What makes numbers of an image: places where learned features are, or the paper's convolutions with dense layers."""
    shift_px: int = 0
    """Each image that is learned from is moved by up to so many px, drawn anew each time; 4 is usual for convolutions."""
    tau: float = 0.01
    """Share of the critics that goes into the target critics at each update."""
    layer_norm: bool = True
    """Layer normalisation in the critics."""

    def __post_init__(self) -> None:
        self._above_zero("learning_rate", "batch_size", "updates_per_step", "actor_delay", "tau")
        self._share("gamma", "adam_beta", "tau")
        if self.adam_beta == 1.0:
            raise DescriptionError("adam_beta is 1, which learns nothing; give a number below 1")
        if not self.hidden or min(self.hidden) < 1:
            raise DescriptionError(f"hidden is {self.hidden}; give the units of at least one layer, as in (128, 128)")
        if self.replay_size < 2:
            raise DescriptionError(f"replay_size is {self.replay_size}; a step has two images, give 2 or more")
        for name in ("prefill_episodes", "shift_px"):
            if getattr(self, name) < 0:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give 0 or more")
        if self.angles not in ("phases", "sincos", "raw"):
            raise DescriptionError(f"angles is '{self.angles}'; choose phases, sincos or raw")
        if self.encoder not in ("keypoints", "convolutions"):
            raise DescriptionError(f"encoder is '{self.encoder}'; choose keypoints or convolutions")

    def _above_zero(self, *names: str) -> None:
        for name in names:
            if not getattr(self, name) > 0:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number above zero")

    def _share(self, *names: str) -> None:
        for name in names:
            if not 0 <= getattr(self, name) <= 1:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give a number from 0 to 1")


@dataclass(frozen=True)
class ImageSACSettings(ImageSettings):
    """Soft actor-critic from images."""

    initial_alpha: float = 0.1
    """Temperature (weight of the entropy) at the start; it is learned from there."""
    entropy: float = -1.0
    """Entropy for each entry of an action that the temperature is learned for; uniform actions have 0.69."""
    min_scale: float = 0.1
    """Lower limit of the standard deviation of an action before the tanh."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("initial_alpha", "min_scale")


@dataclass(frozen=True)
class ImageTD3Settings(ImageSettings):
    """Twin delayed deep deterministic policy gradient from images."""

    actor_delay: int = 2
    """Actor and targets learn in every n-th update of the critics."""
    exploration_noise: float = 0.3
    """Standard deviation of the noise on the actions while learning; actions are in -1..1."""
    target_noise: float = 0.1
    """Standard deviation of the noise on the target actor's actions."""
    target_noise_limit: float = 0.5
    """Limit of that noise to either side."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("target_noise_limit")
        for name in ("exploration_noise", "target_noise"):
            if getattr(self, name) < 0:
                raise DescriptionError(f"{name} is {getattr(self, name)}; give 0 or more")


_PAPER = ImageSACSettings(
    hidden=(256, 256),
    learning_rate=3e-4,
    batch_size=256,
    gamma=0.99,
    updates_per_step=1,
    prefill_episodes=10,
    angles="raw",
    encoder="convolutions",
    tau=0.005,
    layer_norm=False,
    initial_alpha=1.0,
)
_COMMON = ("hidden", "learning_rate", "batch_size", "gamma", "prefill_episodes", "angles", "encoder", "tau", "layer_norm")

IMAGE_PRESETS: dict[str, dict[str, ImageSACSettings | ImageTD3Settings]] = {
    "default": {"sac": ImageSACSettings(), "td3": ImageTD3Settings()},
    "paper": {
        "sac": _PAPER,
        "td3": replace(
            ImageTD3Settings(exploration_noise=0.1, target_noise=0.2), **{name: getattr(_PAPER, name) for name in _COMMON}
        ),
    },
}
"""Settings by name of the preset and of the agent, as `PRESETS` has them for agents without images."""
