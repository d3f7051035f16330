"""Encoders: observations and images to the features that networks learn from.

An encoder is the first module of each network; `EncodeObservation` is the same as a transform of TorchRL's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.data import Unbounded
from torchrl.envs import EnvBase
from torchrl.envs.transforms import ObservationTransform

from bricksrl.agents.images import Convolutions, Keypoints
from bricksrl.agents.settings import Settings
from bricksrl.entry import Entry
from bricksrl.envs.specs import entries_of


@dataclass(frozen=True)
class ObservationLayout:
    """The meaning of an observation ``[n]``, entry by entry, as features and hindsight need it.

    Attributes:
        low, high: bounds; infinite where there are none.
        wraps: angles in degrees that run around from 360 to 0.
        goals: pairs of places: of a goal, and of the entry that is to reach it.
        image_px: side of the square image beside the observation; 0 for none.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    wraps: tuple[bool, ...]
    goals: tuple[tuple[int, int], ...] = ()
    image_px: int = 0

    @classmethod
    def of(cls, env: EnvBase) -> ObservationLayout:
        """The layout of an environment's observation: from its task where it has one, else the bounds of its spec."""
        spec = env.full_observation_spec_unbatched
        image_px = int(spec["image"].shape[-2]) if "image" in spec.keys() else 0  # noqa: SIM118  a Composite
        entries = entries_of(env)
        bounds = tuple(e.low for e in entries), tuple(e.high for e in entries)
        return cls(*bounds, tuple(e.wraps for e in entries), _goal_pairs(entries), image_px)


def _goal_pairs(entries: Sequence[Entry]) -> tuple[tuple[int, int], ...]:
    """Each entry ``X_goal`` with the entry ``X_angle`` of the same kind; none where a goal lacks one."""
    places = {entry.name: place for place, entry in enumerate(entries)}
    goals = [place for name, place in places.items() if name.endswith("_goal")]
    pairs = [(goal, places.get(entries[goal].name.removesuffix("_goal") + "_angle")) for goal in goals]
    found = tuple((goal, reached) for goal, reached in pairs if reached is not None)
    alike = all(entries[goal].wraps == entries[reached].wraps for goal, reached in found)
    return found if alike and len(found) == len(goals) else ()


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled from their range to -1..1, unbounded ones stay as they are. With ``angles="sincos"`` each wrapping
    angle gives its sine and its cosine instead, so that 359 and 1 degrees are neighbours; with ``angles="phases"`` so does each
    difference between two of them, goals left out: a gait is how legs move against each other. With ``goals="difference"`` each
    goal also gives the difference that is left to it, the shorter one around where it is an angle that wraps.
    """

    def __init__(
        self,
        layout: ObservationLayout,
        angles: Literal["phases", "sincos", "raw"] = "phases",
        goals: Literal["difference", "plain"] = "difference",
    ) -> None:
        super().__init__()
        wraps = [w and angles != "raw" for w in layout.wraps]
        angle_index = [i for i, w in enumerate(wraps) if w]
        linear_index = [i for i, w in enumerate(wraps) if not w]
        low, high = torch.tensor(layout.low), torch.tensor(layout.high)
        bounded = torch.isfinite(low) & torch.isfinite(high) & (high > low)
        scale = torch.where(bounded, 2.0 / (high - low), 1.0)
        offset = torch.where(bounded, -(high + low) / (high - low), 0.0)
        pairs = layout.goals if goals == "difference" else ()
        own = [i for i in angle_index if i not in {goal for goal, _ in layout.goals}]
        phases = list(itertools.combinations(own, 2)) if angles == "phases" else []
        turn = torch.zeros(len(layout.low), len(angle_index) + len(phases))  # a column for each angle and each difference
        for column, i in enumerate(angle_index):
            turn[i, column] = math.pi / 180.0
        for column, (i, j) in enumerate(phases, len(angle_index)):
            turn[i, column], turn[j, column] = math.pi / 180.0, -math.pi / 180.0
        self.turn, self.linear = _constant(turn), _constant(linear_index, torch.int64)
        self.scale, self.offset = _constant(scale[self.linear]), _constant(offset[self.linear])
        self.goal = _constant([goal for goal, _ in pairs], torch.int64)
        self.reached = _constant([reached for _, reached in pairs], torch.int64)
        self.around = _constant([360.0 if layout.wraps[goal] else math.inf for goal, _ in pairs])
        self.goal_scale = _constant([1 / 180.0 if layout.wraps[goal] else float(scale[goal]) for goal, _ in pairs])
        self.size = len(linear_index) + 2 * turn.shape[1] + len(pairs)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: the scaled entries in their order, then all sines, all cosines, and all differences to goals."""
        parts = [torch.addcmul(self.offset, observation.index_select(-1, self.linear), self.scale)]
        if self.turn.shape[1]:
            angle_rad = observation @ self.turn
            parts += [angle_rad.sin(), angle_rad.cos()]
        if len(self.goal):
            left = observation.index_select(-1, self.goal) - observation.index_select(-1, self.reached)
            parts.append((left - (left / self.around).round() * 360.0) * self.goal_scale)
        return torch.cat(parts, -1)


def _constant(values: Tensor | list[Any], dtype: torch.dtype | None = None) -> nn.Buffer:
    """A tensor that moves with its module and is not part of its state."""
    return nn.Buffer(torch.as_tensor(values, dtype=dtype), persistent=False)


class ImageEncoder(nn.Module):
    """Observations and images to features ``[*batch, size]``, joined; the paper's convolutions with its dense layers for both."""

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
        found = self.image(image.reshape(-1, *image.shape[-3:])).view(*image.shape[:-3], -1)
        return torch.cat((found, self.dense(self.numbers(observation))), -1)


def make_encoder(env: EnvBase, settings: Settings) -> ObservationEncoder | ImageEncoder:
    """The encoder for what an environment shows: its observation, and its image where it has one."""
    layout = ObservationLayout.of(env)
    if layout.image_px:
        return ImageEncoder(layout, settings)
    return ObservationEncoder(layout, settings.angles, settings.goals)


def encoder_keys(encoder: nn.Module) -> list[str]:
    """The entries that an encoder reads, in the order of its arguments."""
    return ["observation", "image"] if isinstance(encoder, ImageEncoder) else ["observation"]


class EncodeObservation(ObservationTransform):  # type: ignore[misc]
    """An encoder as a transform: adds "features" ``[*batch, size]`` to what an environment or a replay buffer gives."""

    def __init__(self, encoder: ObservationEncoder, out_key: str = "features") -> None:
        super().__init__(in_keys=["observation"], out_keys=[out_key])
        self.encoder = encoder

    def _apply_transform(self, observation: Tensor) -> Tensor:
        features: Tensor = self.encoder(observation)
        return features

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Any) -> Any:
        """The environment's spec and the features', which have no bounds."""
        shape = (*observation_spec.shape, self.encoder.size)
        observation_spec[self.out_keys[0]] = Unbounded(shape, device=observation_spec.device)
        return observation_spec
