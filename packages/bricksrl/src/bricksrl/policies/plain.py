"""Plain policies: the best action of a small network as plain numbers, computed by NumPy. Importing this loads no torch."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.policies.policy import Policy

Floats = NDArray[np.float32]
FULL_TURN_DEG = 360.0


@dataclass(frozen=True)
class PlainPolicy:
    """A policy as numbers: the features of `bricksrl.agents.encoder.ObservationEncoder`, then layers with ReLU, then tanh.

    Attributes:
        least, greatest: observations ``[n]`` are held within these.
        linear, scale, offset: indices, factors and offsets of the scaled entries.
        angle_matrix: ``[n, angles]``, from observations to the angles, in rad, whose sine and cosine are features.
        goal, reached, period, goal_scale: indices of the goals and of what is to reach them; their period and factor.
        weights, biases: of each layer, ``[out, in]`` and ``[out]``; the last ones give the action.
    """

    least: Floats
    greatest: Floats
    linear: NDArray[np.int64]
    scale: Floats
    offset: Floats
    angle_matrix: Floats
    goal: NDArray[np.int64]
    reached: NDArray[np.int64]
    period: Floats
    goal_scale: Floats
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def act(self, observation: Any) -> Floats:
        """Action ``[*batch, m]`` in -1..1 for an observation ``[*batch, n]``. Raises DescriptionError for another n."""
        values = np.asarray(observation, np.float32)
        if values.shape[-1:] != self.least.shape:
            raise DescriptionError(f"the policy takes observations of {len(self.least)} numbers, not of shape {values.shape}")
        x = self.features(values.clip(self.least, self.greatest))
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight.T + bias, 0.0)
        action: Floats = np.tanh(x @ self.weights[-1].T + self.biases[-1])
        return action

    def features(self, observation: Floats) -> Floats:
        """Features ``[*batch, f]``: scaled entries, all sines, all cosines, all differences to goals."""
        angle_rad = observation @ self.angle_matrix
        difference = observation[..., self.goal] - observation[..., self.reached]
        difference = (difference - (difference / self.period).round() * FULL_TURN_DEG) * self.goal_scale
        linear = observation[..., self.linear] * self.scale + self.offset
        return np.concatenate((linear, np.sin(angle_rad), np.cos(angle_rad), difference), -1)

    def save(self, path: Path) -> None:
        """Write it to a file ``.npz``; equal policies give equal files."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in _LAYERS}
        layers = {f"{name}_{i}": array for name in _LAYERS for i, array in enumerate(getattr(self, name))}
        np.savez_compressed(path, **arrays, **layers)

    @classmethod
    def load(cls, path: Path) -> PlainPolicy:
        """Inverse of `save`."""
        with np.load(path) as file:
            values: dict[str, Any] = {field.name: file[field.name] for field in fields(cls) if field.name not in _LAYERS}
            count = sum(name.startswith("biases_") for name in file)
            values |= {name: tuple(file[f"{name}_{i}"] for i in range(count)) for name in _LAYERS}
        return cls(**values)


_LAYERS = ("weights", "biases")


def plain_of(policy: Policy) -> PlainPolicy:
    """The numbers of an agent's policy. Raises DescriptionError for one with images, transforms, or other layers than an `mlp` of
    linear layers with ReLU."""
    from tensordict.nn import NormalParamExtractor
    from torch import nn

    from bricksrl.agents.encoder import Encoder
    from bricksrl.agents.networks import Actor

    actors = [module for module in policy.modules() if isinstance(module, Actor)]
    encoder, body = (actors[0].encoder, actors[0].body) if len(actors) == 1 else (None, None)
    layers = list(body) if isinstance(body, nn.Sequential) else []
    are_plain = bool(layers) and all(isinstance(layer, nn.Linear | nn.ReLU) for layer in layers)
    if not are_plain or not isinstance(encoder, Encoder) or encoder.images or encoder.numbers.normalize:
        raise DescriptionError("only linear layers with ReLU on plain observations can be written as plain numbers")
    numbers, linear = encoder.numbers, [layer for layer in layers if isinstance(layer, nn.Linear)]
    ends = (*numbers.seen.bounds(), numbers.linear, numbers.scale, numbers.offset, numbers.angle_matrix)
    tensors = (*ends, numbers.goal, numbers.reached, numbers.period, numbers.goal_scale)
    weights = [layer.weight.detach().cpu().numpy() for layer in linear]
    biases = [layer.bias.detach().cpu().numpy() for layer in linear]
    if isinstance(actors[0].head, NormalParamExtractor):  # the best action is that of the location
        m = len(biases[-1]) // 2
        weights[-1], biases[-1] = weights[-1][:m], biases[-1][:m]
    arrays: list[Any] = [tensor.cpu().numpy() for tensor in tensors]
    return PlainPolicy(*arrays, tuple(weights), tuple(biases))
