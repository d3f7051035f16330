"""TorchRL transforms of the batches that a replay buffer gives: augmentations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from math import inf

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase, Transform

from bricksrl.agents.settings import OffPolicySettings
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.task import Mirror, mirrors
from bricksrl.envs.transforms import base_of, layout_of


class MirrorRows(Transform):  # type: ignore[misc]
    """Mirrors each row of a batch with a probability of 1/2: on a symmetric robot a mirrored step is a step too. ``observation``:
    of the numbers of the layout's only vector, in their units."""

    def __init__(self, layout: ObservationLayout, observation: Mirror, action: Mirror) -> None:
        super().__init__()
        ((self.key, _),) = layout.vectors
        self.observation, self.action = observation, action
        self.scale, self.offset = torch.tensor(layout.scale or 1.0), torch.tensor(layout.offset or 0.0)

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        """The batch, with new tensors for what is mirrored."""
        drawn = torch.rand(len(batch), 1, device=batch["action"].device) < 0.5
        for part in (batch, batch["next"]):
            given = part[self.key].flatten(1)
            part[self.key] = torch.where(drawn, self._in_mirror(given), given).view_as(part[self.key])
        batch["action"] = torch.where(drawn, self.action(batch["action"]), batch["action"])
        return batch

    def _in_mirror(self, vector: Tensor) -> Tensor:
        return self.observation((vector - self.offset) / self.scale) * self.scale + self.offset


def mirror_through(layout: ObservationLayout, mirror: Mirror, names: Sequence[str]) -> Mirror | None:
    """The mirror of the numbers of a layout, frame by frame, from that of entries with ``names``; ``None`` if it has others, or
    lacks an image."""
    images = {name: (names[place], sign) for name, place, sign in zip(names, mirror.places, mirror.signs, strict=True)}
    numbers, count = list[tuple[str, int, int]](), Counter[tuple[str, int]]()
    for number in zip(layout.names, layout.frames, strict=True):
        numbers.append((*number, count[number]))  # a frame that is there several times has others like it
        count[number] += 1
    found = [(*images.get(name, ("", 1)), frame, nth) for name, frame, nth in numbers]
    places = [(image, frame, nth) for image, _, frame, nth in found]
    if not set(places) <= set(numbers):
        return None
    return Mirror(tuple(map(numbers.index, places)), tuple(sign for _, sign, _, _ in found), layout.wraps)


def augmentations(env: EnvBase, settings: OffPolicySettings) -> Iterator[Transform]:
    """The augmentations of the settings for an environment."""
    task, layout = interface_of(env).task, layout_of(env)
    if not settings.mirror or task is None or not task.symmetric or layout.images or len(layout.vectors) != 1:
        return
    observation, action = mirrors(task)
    found = mirror_through(layout, observation, [entry.name for entry in task.entries])
    in_units = all(wraps or high - low < inf for low, high, wraps in zip(layout.low, layout.high, layout.wraps, strict=True))
    if found is not None and (in_units or base_of(env) is env):
        yield MirrorRows(layout, found, action)
