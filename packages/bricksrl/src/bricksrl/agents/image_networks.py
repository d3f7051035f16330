"""Networks of images, learned with the agent; how images enter them, and their random shift."""

from collections import OrderedDict

import torch
from torch import Tensor, nn
from torch.nn import functional

from bricksrl.envs.specs import ImageShape
from bricksrl.errors import DescriptionError


class Keypoints(nn.Module):
    """Feature points: two convolutions, then a spatial softmax of each map (Finn et al., 2016).
    Maps are normalised to mean 0 and variance 1, so the softmax is sharp even before training:
    random filters find a coloured spot."""

    def __init__(
        self,
        image_px: int,
        colors: int = 3,
        channels: int = 16,
        points: int = 16,
    ) -> None:
        super().__init__()
        if image_px < 16:
            raise DescriptionError(
                f"images of {image_px} px are too small for keypoints; make them 16 px or larger"
            )
        self.first = nn.Conv2d(
            colors,
            channels,
            8,
            stride=4,
            padding=2,
        )
        self.second = nn.Conv2d(channels, points, 1)
        self.sharpness = nn.Parameter(torch.ones(points, 1))
        # as many places along a side as the first convolution leaves: (side + 2 * 2 - 8) / 4 + 1
        axis = torch.linspace(-1.0, 1.0, (image_px - 4) // 4 + 1)
        self.positions = nn.Buffer(torch.cartesian_prod(axis, axis), persistent=False)
        self.size = 2 * points

    def forward(self, images: Tensor) -> Tensor:
        """Images ``[batch, colors, side, side]`` to positions ``[batch, size]``, -1..1 from edge to
        edge."""
        maps = self.second(self.first(images).relu()).flatten(2)
        sharp = functional.layer_norm(maps, maps.shape[-1:]) * self.sharpness
        # the expected place of each map: [batch, points, places] times [places, 2]
        expected = sharp.softmax(-1) @ self.positions
        return expected.flatten(1)


class Convolutions(nn.Sequential):
    """The paper's image network ``[batch, colors, side, side]`` to ``[batch, 128]``: three
    convolutions, then dense layers."""

    size = 128

    def __init__(
        self,
        image_px: int,
        colors: int = 3,
    ) -> None:
        # what the three convolutions leave of a side: kernels of 8, 4 and 3 px, strides of 4, 2, 1
        side_left = ((image_px - 8) // 4 - 3) // 2 - 1
        if side_left < 1:
            raise DescriptionError(
                f"images of {image_px} px are too small for the convolutions; make them 36 px "
                "or larger"
            )
        convolutions = [
            nn.Conv2d(colors, 32, 8, stride=4),
            nn.ReLU(),
            nn.Conv2d(32, 64, 4, stride=2),
            nn.ReLU(),
            nn.Conv2d(64, 64, 3),
            nn.ReLU(),
            nn.Flatten(),
        ]
        dense = [
            nn.Linear(64 * side_left**2, 256),
            nn.ReLU(),
            nn.Linear(256, self.size),
            nn.ReLU(),
        ]
        super().__init__(OrderedDict(layers=nn.Sequential(*convolutions, *dense)))


def pixels(images: Tensor, shape: ImageShape) -> Tensor:
    """Images ``[*batch, *shape]`` as ``[batch, channels, side, side]``, -0.5 (black) to 0.5
    (white)."""
    flat = images.reshape(-1, *images.shape[-3:])
    if shape.is_channels_last:
        flat = flat.permute(0, 3, 1, 2)
    span = shape.high - shape.low
    return flat.float().mul(1 / span).sub_(0.5 + shape.low / span)


def shift_images(
    images: Tensor,
    max_px: int,
    is_channels_last: bool = True,
) -> Tensor:
    """Images ``[batch, side, side, 3]``, each shifted randomly; edges are repeated. As in DrQ
    (Kostrikov et al., 2021)."""
    if not is_channels_last:
        return shift_images(images.movedim(1, -1), max_px).movedim(-1, 1)
    batch, side = images.shape[:2]
    shift = torch.randint(
        -max_px,
        max_px + 1,
        (2, batch, 1),
        device=images.device,
    )
    rows, columns = (torch.arange(side, device=images.device) + shift).clamp_(0, side - 1)
    # indices broadcast to [batch, side, side]: a shift of rows and one of columns for each image
    each_image = torch.arange(batch, device=images.device)[:, None, None]
    return images[each_image, rows[:, :, None], columns[:, None, :]]
