"""Policies that an environment of ours has, by name: random, scripted, and best, which comes with
it, trained by ``python -m benchmarks policies``. Importing this loads no torch."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brickhub.tables import read_table
from bricksrl.agents.features.formula import scaled_entries, with_circles_and_goals
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.scripted import CONTROLLERS, ArrayPolicy, controller_of
from bricksrl.errors import DescriptionError

FOLDER = Path(__file__).with_name("trained")
TRAINED = {row["env"]: row for row in read_table(__package__, "trained/policies")}
"""Settings and mean return of each trained policy, by its environment."""
Floats = NDArray[np.float32]


class ArrayOperations:
    """`Operations` of NumPy."""

    sin = np.sin
    cos = np.cos

    @staticmethod
    def take(values: Floats, indices: NDArray[np.int64]) -> Floats:
        """The values at indices."""
        return values[..., indices]

    @staticmethod
    def scaled(
        values: Floats,
        scale: Floats,
        offset: Floats,
    ) -> Floats:
        """Values times a factor, plus an offset."""
        return values * scale + offset

    @staticmethod
    def joined(parts: Sequence[Floats]) -> Floats:
        """One part after the other."""
        return np.concatenate(parts, -1)


@dataclass(frozen=True)
class PlainPolicy:
    """A policy as numbers: features by `bricksrl.agents.features.formula`, then layers with ReLU,
    then tanh.

    Attributes:
        least, greatest: observations ``[n]`` are held within these.
        linear, scale, offset, angle_matrix, goal, reached, period, goal_scale: the formula's
            constants.
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
        """Action ``[*batch, m]`` in -1..1 for an observation ``[*batch, n]``. Raises
        DescriptionError for another n."""
        values = np.asarray(observation, np.float32)
        if values.shape[-1:] != self.least.shape:
            raise DescriptionError(
                f"the policy takes observations of {len(self.least)} numbers, not of shape "
                f"{values.shape}"
            )
        # An agent that acts is held within what it has learned on, as `SeenInputs` does.
        x = self.features(values.clip(self.least, self.greatest))
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight.T + bias, 0.0)
        action: Floats = np.tanh(x @ self.weights[-1].T + self.biases[-1])
        return action

    def features(self, observation: Floats) -> Floats:
        """Features ``[*batch, f]``: scaled entries, all sines, all cosines, all differences to
        goals."""
        linear = scaled_entries(observation, self, ArrayOperations)
        features: Floats = with_circles_and_goals(linear, observation, self, ArrayOperations)
        return features

    @classmethod
    def load(cls, path: Path) -> "PlainPolicy":
        """Read it from a file ``.npz``, whose arrays are ``NAME``, and ``weights_0``, ``biases_0``
        and so on."""
        with np.load(path) as file:
            count = sum(name.startswith("biases_") for name in file)
            values: dict[str, Any] = {}
            for field in fields(cls):
                name = field.name
                if name in _LAYERS:
                    values[name] = tuple(file[f"{name}_{layer}"] for layer in range(count))
                else:
                    values[name] = file[name]
        return cls(**values)


_LAYERS = ("weights", "biases")


def scores_to_beat(env_id: str) -> dict[str, float]:
    """Mean returns in an environment of ours: of random actions, a controller by hand, the paper,
    and the policy that comes with it."""
    scores = dict(REFERENCES.get(env_id, {}))
    if env_id in TRAINED:
        scores["ours"] = float(TRAINED[env_id]["return"])
    return scores


def path_of(env_id: str) -> Path:
    """File of the trained policy of an environment."""
    return FOLDER / f"{env_id}.npz"


def array_policies(
    env_id: str,
    task: Task,
    seed: int,
) -> dict[str, Callable[[], ArrayPolicy]]:
    """Factories of the policies of an environment, the best one last; ``seed`` is that of the
    random actions."""
    rng = np.random.default_rng(seed)
    size = len(task.interface.commands)
    policies: dict[str, Callable[[], ArrayPolicy]] = {
        "random": lambda: lambda _state: rng.uniform(-1.0, 1.0, size)
    }
    if env_id in CONTROLLERS:
        policies["scripted"] = lambda: controller_of(env_id, task)
    if env_id in TRAINED:
        best = PlainPolicy.load(path_of(env_id))
        policies["best"] = lambda: lambda state: best.act(state["observation"])
    return policies
