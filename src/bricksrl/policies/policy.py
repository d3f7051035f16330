"""Policy: what was learned, ready to act; in TorchRL's way, and on plain arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

if TYPE_CHECKING:
    from collections.abc import Callable


class Policy(TensorDictModuleBase):  # type: ignore[misc]
    """The best actions of a trained agent, without exploring: ``env.rollout(100, policy)``, or `act` on an observation.

    Args:
        module: reads "observation", and "image" where it sees, and writes "action".
        reset: forgets what was planned; `reset` calls it.
    """

    def __init__(self, module: TensorDictModuleBase, reset: Callable[[], None]) -> None:
        super().__init__()
        self.in_keys, self.out_keys = list(module.in_keys), ["action"]
        self.module, self._reset = module.eval(), reset

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            action = self.module(tensordict.select(*self.in_keys))["action"]
        return tensordict.set("action", action)

    def act(self, observation: Any, image: Any = None) -> Any:
        """The action ``[*batch, m]``, in -1..1, for an observation ``[*batch, n]``: an array for an array, a tensor for a tensor.

        Args:
            image: uint8 ``[*batch, side, side, 3]``, for a policy that sees.
        """
        given = torch.as_tensor(observation, dtype=torch.float32)
        seen = {"observation": given} if image is None else {"observation": given, "image": torch.as_tensor(image)}
        action: Tensor = self(TensorDict(seen, given.shape[:-1]))["action"]
        return action if isinstance(observation, Tensor) else np.asarray(action)

    def reset(self) -> None:
        """An episode starts: for policies that carry out what they planned before."""
        self._reset()
