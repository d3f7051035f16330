"""Encoders: observations and images to features; the first module of each network."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchrl.envs import EnvBase

from bricksrl.agents.settings import Settings
from bricksrl.envs.specs import ObservationLayout
from bricksrl.errors import DescriptionError


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled to -1..1, unbounded ones unchanged. With ``angles="sincos"`` wrapping angles become sine and
    cosine; ``angles="phases"`` adds sine and cosine of the differences between angles, goals excluded (the phases of a gait).
    With ``goals="difference"`` each goal adds its difference to the current value, for wrapping angles the shorter way.
    """

    def __init__(self, layout: ObservationLayout, angles: str = "phases", goals: str = "difference") -> None:
        super().__init__()
        wraps = [w and angles != "raw" for w in layout.wraps]
        angle_index = [i for i, w in enumerate(wraps) if w]
        linear_index = [i for i, w in enumerate(wraps) if not w]
        low, high = torch.tensor(layout.low), torch.tensor(layout.high)
        bounded = torch.isfinite(low) & torch.isfinite(high) & (high > low)
        scale = torch.where(bounded, 2.0 / (high - low), 1.0)
        offset = torch.where(bounded, -(high + low) / (high - low), 0.0)
        pairs = layout.goals if goals == "difference" else ()
        goal_index = {goal for goal, _ in layout.goals}
        own = [i for i in angle_index if i not in goal_index and angles == "phases"]
        first, second = torch.combinations(torch.tensor(own, dtype=torch.int64)).T
        one_rad = torch.eye(len(layout.low)) * (math.pi / 180.0)
        angle_matrix = torch.cat((one_rad[angle_index], one_rad[first] - one_rad[second])).T.contiguous()  # one column per angle
        self.angle_matrix, self.linear = _constant(angle_matrix), _constant(linear_index, torch.int64)
        self.scale, self.offset = _constant(scale[self.linear]), _constant(offset[self.linear])
        self.goal = _constant([goal for goal, _ in pairs], torch.int64)
        self.reached = _constant([reached for _, reached in pairs], torch.int64)
        self.period = _constant([360.0 if layout.wraps[goal] else math.inf for goal, _ in pairs])
        self.goal_scale = _constant([1 / 180.0 if layout.wraps[goal] else float(scale[goal]) for goal, _ in pairs])
        self.size = len(linear_index) + 2 * angle_matrix.shape[1] + len(pairs)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: scaled entries, then all sines, all cosines, all goal differences."""
        parts = [torch.addcmul(self.offset, observation.index_select(-1, self.linear), self.scale)]
        if self.angle_matrix.shape[1]:
            angle_rad = observation @ self.angle_matrix
            parts += [angle_rad.sin(), angle_rad.cos()]
        if len(self.goal):
            difference = observation.index_select(-1, self.goal) - observation.index_select(-1, self.reached)
            parts.append((difference - (difference / self.period).round() * 360.0) * self.goal_scale)
        return torch.cat(parts, -1)


def _constant(values: Tensor | list[Any], dtype: torch.dtype | None = None) -> nn.Buffer:
    """A tensor that moves with its module and is not in its state."""
    return nn.Buffer(torch.as_tensor(values, dtype=dtype), persistent=False)


class Keypoints(nn.Module):
    """Feature points: two convolutions, then a spatial softmax of each map (Finn et al., 2016). Maps are normalised to mean 0 and
    variance 1, so the softmax is sharp even before training: random filters find a coloured spot."""

    def __init__(self, image_px: int, channels: int = 16, points: int = 16) -> None:
        super().__init__()
        if image_px < 16:
            raise DescriptionError(f"images of {image_px} px are too small for keypoints; make them 16 px or larger")
        self.first = nn.Conv2d(3, channels, 8, stride=4, padding=2)
        self.second = nn.Conv2d(channels, points, 1)
        self.sharpness = nn.Parameter(torch.ones(points, 1))
        axis = torch.linspace(-1.0, 1.0, (image_px - 4) // 4 + 1)
        self.positions = _constant(torch.cartesian_prod(axis, axis))
        self.size = 2 * points

    def forward(self, images: Tensor) -> Tensor:
        """Images ``[batch, 3, side, side]`` to positions ``[batch, size]``, -1..1 from edge to edge."""
        maps = self.second(self.first(images).relu()).flatten(2)
        sharp = functional.layer_norm(maps, maps.shape[-1:]) * self.sharpness
        return (sharp.softmax(-1) @ self.positions).flatten(1)


class Convolutions(nn.Sequential):
    """The paper's image network ``[batch, 3, side, side]`` to ``[batch, 128]``: three convolutions, then dense layers."""

    size = 128

    def __init__(self, image_px: int) -> None:
        side_left = ((image_px - 8) // 4 - 3) // 2 - 1
        if side_left < 1:
            raise DescriptionError(f"images of {image_px} px are too small for the convolutions; make them 36 px or larger")
        convolutions = [nn.Conv2d(3, 32, 8, stride=4), nn.ReLU(), nn.Conv2d(32, 64, 4, stride=2), nn.ReLU()]
        convolutions += [nn.Conv2d(64, 64, 3), nn.ReLU(), nn.Flatten()]
        dense = (nn.Linear(64 * side_left**2, 256), nn.ReLU(), nn.Linear(256, self.size), nn.ReLU())
        super().__init__(OrderedDict(layers=nn.Sequential(*convolutions, *dense)))


class ImageEncoder(nn.Module):
    """Observations and images to joint features ``[*batch, size]``; convolutions come with the paper's dense layers."""

    in_keys = ("observation", "image")

    def __init__(self, layout: ObservationLayout, settings: Settings) -> None:
        super().__init__()
        self.numbers = ObservationEncoder(layout, settings.angles, settings.goals)
        self.image: Keypoints | Convolutions
        if settings.encoder == "keypoints":
            self.image, self.dense, size = Keypoints(layout.image_px), nn.Sequential(), self.numbers.size
        else:
            self.image, size = Convolutions(layout.image_px), 32
            self.dense = nn.Sequential(nn.Linear(self.numbers.size, 128), nn.ReLU(), nn.Linear(128, 32), nn.ReLU())
        self.size = self.image.size + size

    def forward(self, observation: Tensor, image: Tensor) -> Tensor:
        """Observations ``[*batch, n]`` and images uint8 ``[*batch, side, side, 3]`` to features."""
        images = image.reshape(-1, *image.shape[-3:]).permute(0, 3, 1, 2).float().mul_(1 / 255).sub_(0.5)
        return torch.cat((self.image(images).view(*image.shape[:-3], -1), self.dense(self.numbers(observation))), -1)


def make_encoder(env: EnvBase, settings: Settings) -> ObservationEncoder | ImageEncoder:
    """The encoder for an environment's observation, and image if it has one."""
    layout, kind = ObservationLayout.of(env), (settings.angles, settings.goals)
    return ImageEncoder(layout, settings) if layout.image_px else ObservationEncoder(layout, *kind)


def encoder_keys(encoder: nn.Module) -> list[str]:
    """Input keys of an encoder, in the order of its arguments."""
    return list(getattr(encoder, "in_keys", ("observation",)))


def encode(encoder: nn.Module, tensordict: Any) -> Any:
    """Features ``[*batch, f]``, a tensor, of what the encoder reads in a TensorDict."""
    return encoder(*(tensordict[key] for key in encoder_keys(encoder)))
