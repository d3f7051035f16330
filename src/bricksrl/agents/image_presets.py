"""Settings of the agents that learn from images. Plain data: importing this loads no torch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from bricksrl.agents.settings import CommonSettings, EntropySettings, LayerSettings, NoiseSettings, ReplaySettings, TargetSettings
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ImageSettings(TargetSettings, ReplaySettings, LayerSettings, CommonSettings):
    """What all agents have in common that learn from images. The defaults are tuned for few robot steps on one processor core."""

    hidden: tuple[int, ...] = (128, 128)
    batch_size: int = 64
    gamma: float = 0.9
    updates_per_step: int = 1
    prefill_episodes: int = 5
    angles: Literal["phases", "sincos", "raw"] = "sincos"
    replay_size: int = 15_000
    """Images kept, one for each step and one for each reset; the oldest go first."""
    tau: float = 0.01
    encoder: Literal["keypoints", "convolutions"] = "keypoints"
    """What makes numbers of an image: places where learned features are, or the paper's convolutions with dense layers."""
    shift_px: int = 0
    """Each image that is learned from is moved by up to so many px, drawn anew each time; 4 is usual for convolutions."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.replay_size < 2:
            raise DescriptionError(f"replay_size is {self.replay_size}; a step has two images, give 2 or more")
        self._zero_or_more("shift_px")
        self._one_of("encoder", "keypoints", "convolutions")


@dataclass(frozen=True)
class ImageSACSettings(EntropySettings, ImageSettings):
    """Soft actor-critic from images."""

    initial_alpha: float = 0.1


@dataclass(frozen=True)
class ImageTD3Settings(NoiseSettings, ImageSettings):
    """Twin delayed deep deterministic policy gradient from images."""

    actor_delay: int = 2


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
