"""Specs and grouped tensors of an arena, in TorchRL's multi-agent conventions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded

from bricksrl.envs.specs import clamped

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
    for group, names in task.groups.items():
        shape = (*batch, len(names))
        # unbounded: a robot that tips or slides may exceed the nominal bounds
        observations[group] = Composite(observation=Unbounded((*shape, len(task.entries))), shape=shape)
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
    batch, per_robot, ends = link_lost.shape[:-1], {"observation": task.observe(state)}, {}
    if outcome:
        per_robot["reward"], terminated, truncated = outcome
        ends = {"terminated": terminated, "truncated": truncated, "done": terminated | truncated}
    flags = {"link_lost": link_lost, "success": task.success(state), **ends}
    return TensorDict({**flags, **split_by_group(task, batch, **per_robot)}, batch, device=device)


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
