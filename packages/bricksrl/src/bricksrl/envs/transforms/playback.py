"""Playback: transforms on outcomes that no robot makes."""

import copy
from collections.abc import Callable, Sequence
from typing import Any

from tensordict import TensorDictBase
from torch import Tensor
from torch.nn.parameter import UninitializedBuffer, is_lazy
from torchrl.envs import Compose, EnvBase, TransformedEnv

from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.specs import SPECS, SpecsEnv
from bricksrl.envs.transforms.chain import transforms_of

ACTION_TOLERANCE = 1e-4
"""Largest difference of two actions, in -1..1, that are the same but for single precision."""


class Playback(SpecsEnv):
    """Plays outcomes of an environment: the first one at the reset, the next ones at each step.
    ``outcome``: the n-th."""

    def __init__(
        self,
        env: EnvBase,
        outcome: Callable[[int], TensorDictBase],
        batch: Sequence[int] = (),
    ) -> None:
        specs = {}
        for name in SPECS:
            spec = getattr(env, name)
            specs[name] = spec.expand(*batch, *spec.shape).clone()
        task = interface_of(env).task
        super().__init__(specs, task, batch=(*batch, *env.batch_size))
        self.outcome = outcome
        self.played = [outcome(0)]
        self.acted: list[Tensor] = []

    def _reset(
        self,
        _tensordict: Any = None,
        **_: Any,
    ) -> Any:
        return self.played[0].exclude("reward").clone()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.acted.append(tensordict["action"])
        self.played.append(self.outcome(len(self.played)))
        return self.played[-1].clone()


def over(env: EnvBase, base: EnvBase) -> EnvBase:
    """A base, such as a playback, behind copies of an environment's transforms, in their state."""
    chain = transforms_of(env)
    # What `deepcopy` finds in its memo it does not copy: so they are copied without the
    # environment.
    memo = dict[int, Any]()
    level = env
    while isinstance(level, TransformedEnv):
        memo[id(level)] = None
        if isinstance(level.transform, Compose):
            memo[id(level.transform)] = None
        level.transform.empty_cache()
        level = level.base_env
    for transform in chain:
        for buffer in transform.buffers():
            # A buffer without a shape cannot be copied. The stub of its class is wrong.
            if is_lazy(buffer):
                empty: Any = UninitializedBuffer
                memo[id(buffer)] = empty(False, buffer.device, buffer.dtype)
    copied = copy.deepcopy(chain, memo)
    for transform in copied:
        transform.reset_parent()
    return TransformedEnv(base, Compose(*copied)) if copied else base


def still(env: EnvBase) -> TensorDictBase:
    """An outcome of nothing: zeros, which end nothing."""
    outcome: TensorDictBase = env.full_observation_spec.zero().update(env.full_done_spec.zero())
    return outcome.set("reward", env.reward_spec.zero())
