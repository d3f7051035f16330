"""Task of a user's ``BaseEnv``: what everybody asks of an environment, from its class and its specs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from brickhub.hub.interface import Interface, UntilDone
from brickhub.hub.link.own_client import ClientChannel, ClientCommand
from bricksrl.envs.own.base_env import BaseEnv
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


def task_of(env: BaseEnv) -> Task:
    """The task of an environment. Raises DescriptionError if its specs are missing, or have other shapes than it says."""
    from bricksrl.envs.task import Task

    name = type(env).__name__
    try:
        action, observation = env.action_spec, env.observation_spec[env.observation_key]
        robot, program, actions, states = env.robot, env.program, env.action_dim, env.state_dim
    except (AttributeError, KeyError) as error:
        raise DescriptionError(f"{name} lacks {error}; set robot, program, action_spec and observation_spec") from None
    commands = tuple(ClientCommand(f"action_{i}", *ends) for i, ends in enumerate(_bounds(name, action, actions)))
    channels = tuple(ClientChannel(f"state_{i}", *ends) for i, ends in enumerate(_bounds(name, observation, states)))
    return Task(
        id=f"{name}-v0",
        doc=(type(env).__doc__ or f"{name}, with resets and steps of its own.").strip(),
        robot=robot,
        interface=Interface(commands, channels, UntilDone(env.longest_step_ms)),
        max_steps=env.max_episode_steps,
        reward=lambda previous, action, observation: observation.new_zeros((*observation.shape[:-1], 1)),
        success=lambda observations: observations.new_zeros(observations.shape[:-2]).bool(),
        metrics=lambda observations: {},
        scene=env.scene,
        program=program,
        commands="!" + "f" * actions,
        answer="!" + "f" * states,
        base_env=env,
    )


def _bounds(name: str, spec: Any, count: int) -> list[tuple[float, float]]:
    low, high = spec.space.low.flatten().tolist(), spec.space.high.flatten().tolist()
    if len(low) != count:
        raise DescriptionError(f"{name} has a spec of {len(low)} numbers, and says {count}; correct one of them")
    return list(zip(low, high, strict=True))
