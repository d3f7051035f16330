"""TorchRL transforms of the batches that a replay buffer gives: augmentations."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, Transform

from bricksrl.agents.settings import OffPolicySettings
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.task import Mirror, mirrors
from bricksrl.envs.transforms import keeps_vectors


class MirrorRows(Transform):  # type: ignore[misc]
    """Mirrors each row of a batch with a probability of 1/2: on a symmetric robot a mirrored step is a step too."""

    def __init__(self, observation: Mirror, action: Mirror) -> None:
        super().__init__()
        self.observation, self.action = observation, action

    def forward(self, batch: TensorDictBase) -> TensorDictBase:
        """The batch, with new tensors for what is mirrored."""
        drawn = torch.rand(len(batch), 1, device=batch["action"].device) < 0.5
        for part, name, mirror in (
            (batch, "observation", self.observation),
            (batch["next"], "observation", self.observation),
            (batch, "action", self.action),
        ):
            part[name] = torch.where(drawn, mirror(part[name]), part[name])
        return batch


def augmentations(env: EnvBase, settings: OffPolicySettings) -> Iterator[Transform]:
    """The augmentations of the settings for an environment."""
    task = interface_of(env).task
    if settings.mirror and task is not None and task.symmetric and keeps_vectors(env):  # not what transforms have made of it
        yield MirrorRows(*mirrors(task))
