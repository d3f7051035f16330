"""State of transforms: what they keep from episode to episode."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.nn.parameter import Parameter, is_lazy
from torchrl.envs import EnvBase

from bricksrl.envs.transforms.chain import transforms_of
from bricksrl.envs.transforms.rows import RUNNING


def transform_state(env: EnvBase) -> dict[str, Any]:
    """What transforms keep from episode to episode, such as statistics, as plain tensors; networks
    do not change."""
    kept: dict[str, Any] = {}
    for place, transform in enumerate(transforms_of(env)):
        for name, value in transform.state_dict(keep_vars=True).items():
            if not (isinstance(value, Parameter) or is_lazy(value)):
                kept[f"{place}.{name}"] = copy.deepcopy(value)
    # Empty groups, of statistics that nothing was measured for yet, are left out.
    return {name: value for name, value in kept.items() if isinstance(value, Tensor) or value}


def load_transform_state(
    env: EnvBase,
    state: dict[str, Any],
    *,
    frozen: bool = False,
) -> None:
    """Inverse of `transform_state`; ``frozen``: statistics do not run on."""
    env.__dict__.pop("_known", None)
    for place, transform in enumerate(transforms_of(env)):
        present = transform.state_dict(keep_vars=True)
        part = {}
        for full_name, value in state.items():
            number, _, name = full_name.partition(".")
            if number == str(place) and not is_lazy(present.get(name)):
                part[name] = value
        # A copy: a transform goes on counting in the tensors that it loads.
        transform.load_state_dict(copy.deepcopy(part), strict=False)
        if frozen and isinstance(transform, RUNNING):
            transform.freeze()


@contextmanager
def unaffected(env: EnvBase) -> Iterator[None]:
    """Nothing that transforms keep, nor torch's generator, is changed by what happens inside."""
    generator = torch.get_rng_state()
    state = transform_state(env)
    try:
        yield
    finally:
        torch.set_rng_state(generator)
        load_transform_state(env, state)
