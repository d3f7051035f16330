"""TorchRL transforms of the batches that a replay buffer gives: augmentations."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import inf

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, Transform

from bricksrl.agents.image_networks import shift_images
from bricksrl.agents.settings import OffPolicySettings
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.specs import ImageShape, ObservationLayout
from bricksrl.envs.task import Mirror, mirrors
from bricksrl.envs.transforms import keeps_actions, layout_of


class MirrorRows(Transform):  # type: ignore[misc]
    """Mirrors each row of a batch with a probability of 1/2: on a symmetric robot a mirrored step
    is a step too. ``observation``: of the layout's vector, in physical units."""

    def __init__(self, layout: ObservationLayout, observation: Mirror, action: Mirror) -> None:
        super().__init__()
        self.key = layout.keys[0]
        self.observation = observation
        self.action = action
        self.scale = torch.tensor(layout.scale or (1.0,))
        self.offset = torch.tensor(layout.offset or (0.0,))

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        """The batch, with new tensors for what is mirrored."""
        drawn = torch.rand(len(batch), 1, device=batch["action"].device) < 0.5
        for part in (batch, batch["next"]):
            seen = part[self.key].flatten(1)
            scale = self.scale.to(seen)
            offset = self.offset.to(seen)
            image = self.observation((seen - offset) / scale) * scale + offset
            part[self.key] = torch.where(drawn, image, seen).view_as(part[self.key])
        batch["action"] = torch.where(drawn, self.action(batch["action"]), batch["action"])
        return batch


class ShiftImages(Transform):  # type: ignore[misc]
    """Shifts each of the images of a batch at random, by up to ``most_px`` in each direction."""

    def __init__(self, images: Sequence[ImageShape], most_px: int) -> None:
        super().__init__()
        self.images = images
        self.most_px = most_px

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        for image in self.images:
            for part in (batch, batch["next"]):
                part[image.key] = shift_images(
                    part[image.key], self.most_px, image.is_channels_last
                )
        return batch


def augmentations(env: EnvBase, settings: OffPolicySettings) -> Iterator[Transform]:
    """The augmentations of the settings for an environment."""
    task = interface_of(env).task
    layout = layout_of(env)
    if settings.shift_px and layout.images:
        yield ShiftImages(layout.images, settings.shift_px)
    if settings.mirror and task is not None and task.symmetric and keeps_actions(env):
        observation, action = mirrors(task)
        seen = behind_transforms(observation, [entry.name for entry in task.entries], layout)
        if seen is not None:
            yield MirrorRows(layout, seen, action)


def behind_transforms(
    mirror: Mirror, names: Sequence[str], layout: ObservationLayout
) -> Mirror | None:
    """The mirror of entries with ``names`` for what transforms make of them: the n-th number of an
    entry changes places with the n-th of its image, as in frames that follow one another. ``None``
    where a number has no image, or an unknown scale."""
    numbers = defaultdict[str, list[int]](list)
    is_own = layout.names == tuple(names)
    for index, name in enumerate(layout.names):
        numbers[name].append(index)
    places = []
    signs = []
    for index, name in enumerate(layout.names):
        if len(layout.keys) > 1 or name not in names:
            return None
        entry = names.index(name)
        nth = numbers[name].index(index)
        images = numbers[names[mirror.places[entry]]]
        sign = mirror.signs[entry]
        has_unit = is_own or layout.wraps[index] or layout.high[index] - layout.low[index] < inf
        if nth >= len(images) or not (has_unit or (images[nth] == index and sign > 0)):
            return None
        places.append(images[nth])
        signs.append(sign)
    return Mirror(tuple(places), tuple(signs), layout.wraps)
