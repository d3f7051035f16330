"""Encoders: vectors and images to features; the first module of each network."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase

from bricksrl.agents.features.observed import ObservationEncoder
from bricksrl.agents.image_networks import Convolutions, Keypoints, pixels
from bricksrl.agents.settings import Settings
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.transforms import layout_of


class Encoder(nn.Module):
    """All vectors and images that are observed (``in_keys``) to joint features ``[*batch, size]``:
    each image through its own network, of which convolutions come with the paper's dense layers for
    the numbers."""

    def __init__(
        self,
        layout: ObservationLayout,
        settings: Settings,
    ) -> None:
        super().__init__()
        self.in_keys = layout.keys
        # of a policy that others are added to: what it was learned with stays
        self.is_frozen = False
        self.images = layout.images
        self._dims = [len(shape) for _, shape in layout.vectors]
        self.numbers = ObservationEncoder(
            layout,
            settings.angles,
            settings.goals,
            normalize=settings.normalize,
        )
        kinds = {"keypoints": Keypoints, "convolutions": Convolutions}
        make_network = kinds[settings.encoder]
        networks = [make_network(image.side_px, image.channels) for image in self.images]
        self.networks = nn.ModuleList(networks)
        numbers_size = self.numbers.size
        # empty, which passes everything on; without images the numbers need no layers of their own
        self.dense = nn.Sequential()
        if self.images and numbers_size and settings.encoder == "convolutions":
            # sizes of the BricksRL paper
            self.dense = nn.Sequential(
                nn.Linear(numbers_size, 128),
                nn.ReLU(),
                nn.Linear(128, 32),
                nn.ReLU(),
            )
            numbers_size = 32
        images_size = sum(network.size for network in networks)
        self.size = numbers_size + images_size

    def forward(self, *inputs: Tensor) -> Tensor:
        """Vectors and images ``[*batch, *shape]``, in the order of ``in_keys``, to features."""
        # vectors come first among the keys
        images = inputs[len(self._dims) :]
        parts = []
        for image, shape, network in zip(
            images,
            self.images,
            self.networks,
            strict=True,
        ):
            # convolutions know one dimension of a batch: all of them are one there
            features = network(pixels(image, shape))
            parts.append(features.view(*image.shape[:-3], -1))
        if self._dims:
            numbers = self.numbers(self._joined(inputs))
            parts.append(self.dense(numbers))
        # most robots have no camera: a copy less in each action and update
        return parts[0] if len(parts) == 1 else torch.cat(parts, -1)

    def see(self, tensordict: Any) -> None:
        """Note the range of observations that are learned on, unless the encoder is frozen."""
        if self._dims and not self.is_frozen:
            # vectors come first among the keys, so that what follows them is not read
            inputs = [tensordict[key] for key in self.in_keys]
            numbers = self.numbers.in_units(self._joined(inputs))
            self.numbers.seen.see(numbers)

    def _joined(self, inputs: Sequence[Tensor]) -> Tensor:
        """The numbers of all vectors."""
        vectors = []
        # not strict: images follow the vectors
        for value, dims in zip(inputs, self._dims, strict=False):
            vectors.append(value.flatten(-dims).float())
        return vectors[0] if len(vectors) == 1 else torch.cat(vectors, -1)


def make_encoder(env: EnvBase, settings: Settings) -> Encoder:
    """The encoder of all that an environment observes."""
    return Encoder(layout_of(env), settings)


def encoder_keys(encoder: nn.Module) -> list[str]:
    """Input keys of an encoder, in the order of its arguments."""
    return list(getattr(encoder, "in_keys", ("observation",)))


def encode(encoder: nn.Module, tensordict: Any) -> Any:
    """Features ``[*batch, f]``, a tensor, of what the encoder reads in a TensorDict."""
    inputs = [tensordict[key] for key in encoder_keys(encoder)]
    return encoder(*inputs)
