"""Conversion of an environment's transitions to recorded steps."""

from __future__ import annotations

import dataclasses
import functools
from datetime import UTC, datetime
from importlib import metadata
from typing import TYPE_CHECKING, Any

from brickhub import HOUSES
from bricksrl.data.recorded_episode import About, Step
from bricksrl.envs.env_interface import interface_of

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor
    from torchrl.envs import EnvBase

    from brickhub.hub.interface import Interface
    from brickhub.robot import Robot

_PACKAGES = (*HOUSES, "torch", "torchrl", "mujoco")


def step_of(transition: TensorDictBase, env: EnvBase, *, intervention: bool = False) -> Step:
    """Step from a transition of TorchRL's ``EnvBase.step``, copied, since the environment may reuse its tensors. ``env``:
    environment of the transition; its ``timing``, if any, is recorded."""
    after, timing = transition["next"], interface_of(env).timing
    times: dict[str, Any] = {} if timing is None else {"age_s": timing.age_s, "hub_time_s": timing.hub_time_s}
    images = {} if "image" not in after else {"image": _numbers(transition["image"]), "next_image": _numbers(after["image"])}
    return Step(
        observation=_numbers(transition["observation"]),
        action=_numbers(transition["action"]),
        reward=float(after["reward"]),
        next_observation=_numbers(after["observation"]),
        terminated=bool(after["terminated"]),
        truncated=bool(after["done"]) and not bool(after["terminated"]),
        intervention=intervention,
        **times,
        **images,
    )


def _numbers(tensor: Tensor) -> Any:
    return tensor.detach().cpu().numpy().copy()


def about(env: EnvBase, policy: str, *, seed: int | None = None, hub: str = "virtual") -> About:
    """Provenance of an episode that starts now.

    Args:
        policy: source of the actions.
        seed: seed of the episode.
        hub: how the robot is reached; ignored without a robot.
    """
    ours = interface_of(env)
    task, on_hub = ours.task, ours.robots > 0
    physics = getattr(ours.twin.body, "physics", None) if on_hub and hub == "virtual" and ours.twin is not None else None
    return About(
        policy=policy,
        seed=seed,
        started=datetime.now(UTC).astimezone().isoformat(timespec="milliseconds"),
        hub=hub if on_hub else "",
        program_hash=_program_hash(task.robot, task.interface) if on_hub and task is not None else None,
        versions=dict(_versions()),
        physics={} if physics is None else dataclasses.asdict(physics),
    )


@functools.lru_cache(maxsize=16)
def _program_hash(robot: Robot, interface: Interface) -> int:
    from brickhub.hub.program.generate import generate

    return generate(robot, interface).hash


@functools.lru_cache(maxsize=1)
def _versions() -> tuple[tuple[str, str], ...]:
    return tuple((name, metadata.version(name)) for name in _PACKAGES)
