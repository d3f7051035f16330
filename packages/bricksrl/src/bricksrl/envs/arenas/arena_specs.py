"""Specs and grouped tensors of an arena, in TorchRL's multi-agent conventions."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded

from bricksrl.envs.specs import NominalBounded, clamped
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torch import Tensor
    from torchrl.envs import EnvBase

    from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask


def set_specs(env: EnvBase, task: ArenaTask) -> None:
    """Set the specs of an environment: observation, action and reward of each group, common ends.

    ==========================  =================  =======================================
    key                         shape              meaning
    ==========================  =================  =======================================
    ``(group, observation)``    ``[robots, n]``    of each robot of the group
    ``(group, action)``         ``[robots, 2]``    in -1..1
    ``(group, reward)``         ``[robots, 1]``    of each robot
    ``terminated``, ...         ``[1]``            of the episode, as for one robot
    ``link_lost``               ``[1]``            the link to one of them broke in this step
    ``success``                 ``[1]``            of the task, in this state
    ==========================  =================  =======================================
    """
    batch = env.batch_size
    env.group_map = {group: list(names) for group, names in task.groups.items()}
    observations, actions, rewards = {}, {}, {}
    is_bounded = all(isfinite(end) for entry in task.entries for end in (entry.low, entry.high))
    for group, names in task.groups.items():
        shape = (*batch, len(names))
        bounded = NominalBounded.of(task.entries, shape, env.device) if is_bounded else Unbounded((*shape, len(task.entries)))
        observations[group] = Composite(observation=bounded, shape=shape)
        actions[group] = Composite(action=Bounded(-1.0, 1.0, (*shape, 2)), shape=shape)
        rewards[group] = Composite(reward=Unbounded((*shape, 1)), shape=shape)
    flag = Binary(1, shape=(*batch, 1), dtype=torch.bool)
    env.observation_spec = Composite(**observations, link_lost=flag, success=flag.clone(), shape=batch, device=env.device)
    env.action_spec = Composite(**actions, shape=batch, device=env.device)
    env.reward_spec = Composite(**rewards, shape=batch, device=env.device)
    ends = {name: flag.clone() for name in ("done", "terminated", "truncated")}
    env.done_spec = Composite(**ends, shape=batch, device=env.device)


def frame(task: ArenaTask, state: ArenaState, link_lost: Tensor, *outcome: Tensor, device: Any = None) -> TensorDictBase:
    """Output of a reset or, with the outcome of a step (reward, terminated, truncated), of a step."""
    batch, ends = link_lost.shape[:-1], {}
    robots = (*batch, len(task.robots))
    per_robot = {"observation": _checked(task, "observe", task.observe(state), (*robots, len(task.entries)))}
    flag = (*batch, 1)
    if outcome:
        reward, terminated, truncated = outcome
        per_robot["reward"] = _checked(task, "reward", reward, (*robots, 1))
        terminated = _checked(task, "terminated", terminated, flag, torch.bool)
        ends = {"terminated": terminated, "truncated": truncated, "done": terminated | truncated}
    flags = {"link_lost": link_lost, "success": _checked(task, "success", task.success(state), flag, torch.bool), **ends}
    return TensorDict({**flags, **split_by_group(task, batch, **per_robot)}, batch, device=device)


def _checked(task: ArenaTask, name: str, value: Any, shape: tuple[int, ...], dtype: torch.dtype = torch.float32) -> Tensor:
    """What a function of a task returns. Raises DescriptionError unless it is a tensor of this shape and type."""
    if not isinstance(value, torch.Tensor) or value.shape != shape or value.dtype != dtype:
        given = f"of shape {list(value.shape)} and {value.dtype}" if isinstance(value, torch.Tensor) else f"{value!r:.40}"
        raise DescriptionError(f"{name} of {task.id} is {given}; compute a tensor of shape {list(shape)} and {dtype}")
    return value


def split_by_group(task: ArenaTask, batch: torch.Size, **per_robot: Tensor) -> dict[str, TensorDictBase]:
    """Tensors ``[*batch, robots, n]``, split by group."""
    return {
        group: TensorDict(
            {name: value[..., task.places(group), :] for name, value in per_robot.items()}, (*batch, len(task.groups[group]))
        )
        for group in task.groups
    }


def joined_actions(task: ArenaTask, tensordict: TensorDictBase) -> Tensor:
    """Actions ``[*batch, robots, 2]`` in the arena's order, `clamped`."""
    parts: list[Tensor] = [torch.empty(0)] * len(task.robots)
    for group, names in task.groups.items():
        actions = clamped(tensordict[group, "action"], (*tensordict.batch_size, len(names), 2), f"{group} of {task.id}")
        for index, action in zip(task.places(group), actions.unbind(-2), strict=True):
            parts[index] = action
    return torch.stack(parts, -2)
