"""Plain policies: the best action of a small network as plain numbers, computed by NumPy. Importing this loads no torch."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import DescriptionError

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

    @classmethod
    def load(cls, path: Path) -> PlainPolicy:
        """Read it from a file ``.npz``, whose arrays are ``NAME``, and ``weights_0``, ``biases_0`` and so on."""
        with np.load(path) as file:
            values: dict[str, Any] = {field.name: file[field.name] for field in fields(cls) if field.name not in _LAYERS}
            count = sum(name.startswith("biases_") for name in file)
            values |= {name: tuple(file[f"{name}_{i}"] for i in range(count)) for name in _LAYERS}
        return cls(**values)


_LAYERS = ("weights", "biases")
