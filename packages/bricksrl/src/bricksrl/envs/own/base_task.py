"""Task of a user's ``BaseEnv``: what everybody asks of an environment."""

from __future__ import annotations

from brickhub.hub.interface import ClientChannel, ClientCommand, Interface, UntilDone
from bricksrl.envs.own.base_env import BaseEnv
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError


def task_of(env: BaseEnv) -> Task:
    """What everybody asks of an environment. Raises DescriptionError if a part of it is missing."""
    try:
        action, state = env.action_spec.space, env.observation_spec[env.observation_key].space
        commands = zip(action.low.flatten().tolist(), action.high.flatten().tolist(), strict=True)
        channels = zip(state.low.flatten().tolist(), state.high.flatten().tolist(), strict=True)
        return Task(
            id=f"{type(env).__name__}-v0",
            doc=type(env).__doc__ or "An environment with resets and steps of its own.",
            robot=env.robot,
            interface=Interface(
                tuple(ClientCommand(f"action_{i}", *ends) for i, ends in enumerate(commands)),
                tuple(ClientChannel(f"state_{i}", *ends) for i, ends in enumerate(channels)),
                UntilDone(),
            ),
            max_steps=env.max_episode_steps,
            reward=lambda previous, action, observation: observation.new_zeros((*observation.shape[:-1], 1)),
            success=lambda observations: observations.new_zeros(observations.shape[:-2]).bool(),
            metrics=lambda observations: {},
            scene=env.scene,
            program=env.program,
            commands="!" + "f" * env.action_dim,
            answer="!" + "f" * env.state_dim,
            base_env=env,
        )
    except (AttributeError, KeyError) as error:
        raise DescriptionError(f"{type(env).__name__}: {error}; set robot, program and specs, and call __init__") from None
