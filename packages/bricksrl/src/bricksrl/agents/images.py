"""Image encoders and augmentation."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from bricksrl.agents.encoder import ObservationEncoder
from bricksrl.agents.settings import Settings
from bricksrl.envs.specs import ObservationLayout
from bricksrl.errors import DescriptionError


def normalise_images(images: Tensor) -> Tensor:
    """Images uint8 ``[batch, side, side, 3]`` as ``[batch, 3, side, side]`` in -0.5..0.5, channels last in memory."""
    return images.permute(0, 3, 1, 2).float().mul_(1 / 255).sub_(0.5)


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
        self.register_buffer("positions", torch.cartesian_prod(axis, axis), persistent=False)
        self.size = 2 * points

    def forward(self, images: Tensor) -> Tensor:
        """Images uint8 ``[batch, side, side, 3]`` to positions ``[batch, size]``, -1..1 from edge to edge."""
        maps = self.second(self.first(normalise_images(images)).relu()).flatten(2)
        sharp = functional.layer_norm(maps, maps.shape[-1:]) * self.sharpness
        return (sharp.softmax(-1) @ self.get_buffer("positions")).flatten(1)


class Convolutions(nn.Module):
    """The paper's image network: three convolutions, then dense layers of 256 and 128 units."""

    size = 128

    def __init__(self, image_px: int) -> None:
        super().__init__()
        side_left = ((image_px - 8) // 4 - 3) // 2 - 1
        if side_left < 1:
            raise DescriptionError(f"images of {image_px} px are too small for the convolutions; make them 36 px or larger")
        convolutions = [nn.Conv2d(3, 32, 8, stride=4), nn.ReLU(), nn.Conv2d(32, 64, 4, stride=2), nn.ReLU()]
        convolutions += [nn.Conv2d(64, 64, 3), nn.ReLU(), nn.Flatten()]
        self.layers = nn.Sequential(*convolutions, nn.Linear(64 * side_left**2, 256), nn.ReLU(), nn.Linear(256, 128), nn.ReLU())

    def forward(self, images: Tensor) -> Tensor:
        """Images uint8 ``[batch, side, side, 3]`` to ``[batch, 128]``."""
        features: Tensor = self.layers(normalise_images(images))
        return features


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
        image_features = self.image(image.reshape(-1, *image.shape[-3:])).view(*image.shape[:-3], -1)
        return torch.cat((image_features, self.dense(self.numbers(observation))), -1)


def shift_images(images: Tensor, max_px: int) -> Tensor:
    """Images ``[batch, side, side, 3]``, each shifted randomly; edges are repeated. As in DrQ (Kostrikov et al., 2021)."""
    batch, side = images.shape[:2]
    shift = torch.randint(-max_px, max_px + 1, (2, batch, 1), device=images.device)
    rows, columns = (torch.arange(side, device=images.device) + shift).clamp_(0, side - 1)
    return images[torch.arange(batch, device=images.device)[:, None, None], rows[:, :, None], columns[:, None, :]]
