"""Environments made ready for an agent: with transforms of their options, actions in -1..1, their
own steps noted."""

from itertools import pairwise
from typing import Any

import torch
from torchrl import set_auto_unwrap_transformed_env
from torchrl.envs import ActionScaling, CatFrames, Compose, EnvBase, Transform, TransformedEnv

from brickhub.user_files import calling, load_object
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.specs import ImageShape, observed_specs, specs_of
from bricksrl.envs.transforms.chain import insert, transforms_at
from bricksrl.envs.transforms.frame_skip import FrameSkip
from bricksrl.envs.transforms.keep_units import KeepUnits
from bricksrl.envs.transforms.layout import numbers_of
from bricksrl.envs.transforms.own_steps import Tap
from bricksrl.envs.transforms.rows import RUNNING
from bricksrl.errors import DescriptionError


def prepare(env: EnvBase) -> None:
    """Prepare the transforms of an environment for an agent: its own steps are noted, running
    statistics keep units. To do it again changes nothing."""
    while isinstance(env, TransformedEnv):
        inner = env.base_env
        chain = transforms_at(env)
        pairs = list(enumerate(pairwise([*chain, None])))
        # From the last one on, so that the places of those before stay.
        for place, (transform, after) in reversed(pairs):
            runs = isinstance(transform, RUNNING) and not transform.frozen
            if runs and not isinstance(after, KeepUnits):
                insert(env, place + 1, KeepUnits(transform, numbers_of(transform.parent)))
        is_innermost = not isinstance(inner, TransformedEnv)
        has_tap = bool(chain) and isinstance(chain[0], Tap)
        if is_innermost and not inner.batch_size and not has_tap:
            insert(env, 0, Tap())
        env = inner


def with_unit_actions(env: EnvBase) -> EnvBase:
    """An environment whose actions are in -1..1, by TorchRL's ``ActionScaling`` where they have
    another range. Raises DescriptionError for actions that no agent gives, and without a reward."""
    action = specs_of(env, "action").get("action", None)
    reward = specs_of(env, "reward").get("reward", None)
    if action is None or reward is None:
        raise DescriptionError(
            "the environment has no 'action' or no 'reward'; let its transforms keep these names"
        )
    if len(action.shape) != 1 or action.dtype != torch.float32:
        kind = f"{type(action).__name__} {list(action.shape)}, {action.dtype}"
        raise DescriptionError(
            f"an agent gives no such action ({kind}); let it take float32 [n] with a range"
        )
    space = action.space
    is_unit = (space.low == -1.0).all() and (space.high == 1.0).all()
    if bool(is_unit):
        return env
    if isinstance(env, TransformedEnv):
        return env.append_transform(ActionScaling())
    return TransformedEnv(env, ActionScaling())


@set_auto_unwrap_transformed_env(False)  # type: ignore[untyped-decorator]
def transformed(env: EnvBase, options: EnvOptions) -> EnvBase:
    """An environment with the transforms of its options, prepared for an agent. Raises
    DescriptionError if a user's transform is none, or raises."""
    if options.transform is not None:
        with torch.random.fork_rng(devices=[]):
            # what it draws, such as a frozen network, is the same wherever it is made
            torch.manual_seed(0)
            found = load_object(options.transform, "transform")
            with calling(options.transform, "cannot be applied"):
                if isinstance(found, type) and issubclass(found, Transform):
                    found = found()
                is_transform = isinstance(found, Transform)
                env = TransformedEnv(env, found) if is_transform else found(env)
        if not isinstance(env, EnvBase):
            raise DescriptionError(
                f"{options.transform} gives a {type(env).__name__}; let it return a TransformedEnv"
            )
    if options.frame_skip > 1:
        env = TransformedEnv(env, FrameSkip(options.frame_skip))
    if options.frame_stack > 1:
        env = TransformedEnv(env, Compose(*_stacking(env, options.frame_stack)))
    env = with_unit_actions(env)
    prepare(env)
    return env


def _stacking(env: EnvBase, count: int) -> list[Transform]:
    """Stacks of vectors and images along their numbers or channels."""
    specs = observed_specs(env)
    stacks = []
    for dim in (-1, -3):
        keys = [key for key, spec in specs.items() if _stack_dim(key, spec) == dim]
        if keys:
            stacks.append(CatFrames(count, dim, in_keys=keys))
    return stacks


def _stack_dim(key: str, spec: Any) -> int:
    is_image = len(spec.shape) == 3
    if is_image and not ImageShape.of(key, spec).is_channels_last:
        return -3
    return -1
