"""Units that running statistics keep."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform, VecNorm
from torchrl.envs.transforms import VecNormV2

from bricksrl.envs.specs import Number, observed_specs
from bricksrl.envs.transforms.chain import transforms_at
from bricksrl.envs.transforms.rows import has_unit


class KeepUnits(Transform):  # type: ignore[misc]
    """After running statistics: entries with a range, angles and goals in their units again, as the
    statistics change and what was remembered would not mean the same any more. The rest stays
    normalised. ``numbers``: of each vector before the ``statistics``."""

    def __init__(
        self,
        statistics: VecNorm | VecNormV2,
        numbers: Mapping[str, Sequence[Number]],
    ) -> None:
        super().__init__()
        specs = observed_specs(statistics.parent)
        self.kept: dict[tuple[Any, Any], Tensor] = {}
        """Which numbers keep their units, by the keys of a vector before and behind."""
        for key, out in zip(statistics.in_keys, statistics.out_keys, strict=True):
            if key in numbers:  # and not a reward or an image
                kept = torch.tensor([has_unit(number.entry) for number in numbers[key]])
                self.kept[key, out] = kept.view(specs[key].shape)

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        chain = transforms_at(self.container)
        statistics = copy.copy(chain[chain.index(self) - 1])  # in a copy of the chain its own
        statistics.in_keys = [key for key, _ in self.kept]
        statistics.out_keys = [out for _, out in self.kept]
        before = statistics.denorm(next_tensordict)
        for (key, out), kept in self.kept.items():
            if out in next_tensordict:
                value = next_tensordict[out]
                next_tensordict[out] = torch.where(kept.to(value.device), before[key], value)
        return next_tensordict

    def _reset(
        self,
        _tensordict: TensorDictBase,
        tensordict_reset: TensorDictBase,
    ) -> TensorDictBase:
        return self._call(tensordict_reset)
