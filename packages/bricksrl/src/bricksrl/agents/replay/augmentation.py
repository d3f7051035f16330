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

    def __init__(
        self,
        layout: ObservationLayout,
        observation: Mirror,
        action: Mirror,
    ) -> None:
        super().__init__()
        self.key = layout.keys[0]
        self.observation = observation
        self.action = action
        self.scale = torch.tensor(layout.scale or (1.0,))
        self.offset = torch.tensor(layout.offset or (0.0,))

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        """The batch, with new tensors for what is mirrored."""
        action = batch["action"]
        # one draw for a row: state, action and next state are mirrored together
        drawn = torch.rand(len(batch), 1, device=action.device) < 0.5
        for part in (batch, batch["next"]):
            observed = part[self.key]
            numbers = observed.flatten(1)  # [batch, n]
            scale = self.scale.to(numbers)
            offset = self.offset.to(numbers)
            # the mirror knows physical units only, such as where an angle wraps
            physical = (numbers - offset) / scale
            mirrored = self.observation(physical) * scale + offset
            part[self.key] = torch.where(drawn, mirrored, numbers).view_as(observed)
        batch["action"] = torch.where(drawn, self.action(action), action)
        return batch


class ShiftImages(Transform):  # type: ignore[misc]
    """Shifts each of the images of a batch at random, by up to ``most_px`` in each direction."""

    def __init__(
        self,
        images: Sequence[ImageShape],
        most_px: int,
    ) -> None:
        super().__init__()
        self.images = images
        self.most_px = most_px

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        for image in self.images:
            for part in (batch, batch["next"]):
                pictures = part[image.key]
                part[image.key] = shift_images(pictures, self.most_px, image.is_channels_last)
        return batch


def augmentations(env: EnvBase, settings: OffPolicySettings) -> Iterator[Transform]:
    """The augmentations of the settings for an environment."""
    task = interface_of(env).task
    layout = layout_of(env)
    if settings.shift_px and layout.images:
        yield ShiftImages(layout.images, settings.shift_px)
    if settings.mirror and task is not None and task.symmetric and keeps_actions(env):
        observation, action = mirrors(task)
        names = [entry.name for entry in task.entries]
        transformed = behind_transforms(observation, names, layout)
        # no mirroring at all is right where a number's image is not known
        if transformed is not None:
            yield MirrorRows(layout, transformed, action)


def behind_transforms(
    mirror: Mirror,
    names: Sequence[str],
    layout: ObservationLayout,
) -> Mirror | None:
    """The mirror of entries with ``names`` for what transforms make of them: the n-th number of an
    entry changes places with the n-th of its image, as in frames that follow one another. ``None``
    where a number has no image, or an unknown scale."""
    is_own = layout.names == tuple(names)
    # places of each entry's numbers in the layout: several where frames are stacked
    numbers = defaultdict[str, list[int]](list)
    for index, name in enumerate(layout.names):
        numbers[name].append(index)
    places = []
    signs = []
    for index, name in enumerate(layout.names):
        # a transform may have made another vector, or numbers that are none of the task's
        if len(layout.keys) > 1 or name not in names:
            return None
        entry = names.index(name)
        nth = numbers[name].index(index)
        image_name = names[mirror.places[entry]]
        images = numbers[image_name]
        sign = mirror.signs[entry]
        # a selection may have left the image out
        if nth >= len(images):
            return None
        # A number whose range is not known may be shifted, and the image of a shifted number is
        # not its negative; one that is its own image needs no unit.
        is_bounded = layout.high[index] - layout.low[index] < inf
        has_unit = is_own or layout.wraps[index] or is_bounded
        is_unmoved = images[nth] == index and sign > 0
        if not (has_unit or is_unmoved):
            return None
        places.append(images[nth])
        signs.append(sign)
    return Mirror(tuple(places), tuple(signs), layout.wraps)
