"""Effect of transforms on actions, rewards, steps and episodes, found by a step of theirs."""

from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.envs.transforms.chain import base_of
from bricksrl.envs.transforms.layout import layout_of, numbers_of
from bricksrl.envs.transforms.playback import ACTION_TOLERANCE, Playback, over, still
from bricksrl.envs.transforms.state import transform_state


def keeps_vectors(env: EnvBase) -> bool:
    """Whether an agent observes the vectors of the environment as they are, and nothing made of
    them, and its actions are the environment's."""
    base = base_of(env)
    if base is env:
        return True
    own = layout_of(base)
    seen = layout_of(env)
    # Names and units first, then keys: a renamed vector means the same, and is read elsewhere.
    has_same_numbers = numbers_of(env) == numbers_of(base)
    has_same_shapes = seen.vectors == own.vectors and seen.keys == own.keys
    return has_same_numbers and has_same_shapes and keeps_actions(env)


def keeps_actions(env: EnvBase) -> bool:
    """Whether an agent's actions are the environment's."""
    return base_of(env) is env or one_step(env).keeps_action


def changes_nothing(env: EnvBase) -> bool:
    """Whether an agent gets observations and rewards as the environment gives them, which gets its
    actions."""
    if base_of(env) is env or not keeps_vectors(env):
        return base_of(env) is env
    step = one_step(env)
    return step.count == 1 and bool((step.paid == 1.0).all())


@dataclass(frozen=True)
class StepBehind:
    """A step behind transforms, in terms of the environment's own steps.

    Attributes:
        paid: its reward ``[*batch, 1]`` where each of the own steps pays 1.
        count: number of own steps.
        keeps_action: whether their action is the agent's.
    """

    paid: Tensor
    count: int
    keeps_action: bool


def one_step(env: EnvBase) -> StepBehind:
    """What a step behind the transforms does."""
    base = base_of(env)

    def paying_one(_: int) -> TensorDictBase:
        return still(base).set("reward", torch.ones_like(base.reward_spec.zero()))

    playback = Playback(base, paying_one)
    view = over(env, playback)
    start = view.reset().update(view.full_action_spec.zero())
    action = start["action"]
    # No two numbers are equal, so that an exchange shows.
    action += torch.linspace(-0.9, 0.7, action.shape[-1], device=action.device)
    paid: Tensor = view.step(start.clone())["next", "reward"]
    acted = playback.acted[0]
    is_same = acted.shape == action.shape and torch.allclose(acted, action, atol=ACTION_TOLERANCE)
    return StepBehind(paid, len(playback.played) - 1, is_same)


def steps_of(env: EnvBase) -> int:
    """Steps of the environment itself in one behind its transforms."""
    return 1 if base_of(env) is env else one_step(env).count


def runs_on(env: EnvBase) -> bool:
    """Whether what transforms keep depends on the episodes before, such as running statistics."""
    base = base_of(env)
    view = over(env, Playback(base, lambda _: still(base)))
    kept = list[dict[str, Any]]()
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        for _ in range(2):
            torch.manual_seed(0)
            state = view.reset()
            kept.append(transform_state(view))
            view.step(view.rand_action(state))
    return not _equal(*kept)


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, dict | TensorDictBase):
        if one.keys() != other.keys():
            return False
        return all(_equal(one[key], other[key]) for key in one)
    if isinstance(one, Tensor):
        return torch.equal(one, other)
    return bool(one == other)
