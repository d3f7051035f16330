"""Arenas: environments of several robots in one world. Importing this imports neither torch nor
MuJoCo; making an arena does."""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.resources
from collections.abc import Sequence
from typing import TYPE_CHECKING

from brickhub.seed import check_seed
from bricksrl.errors import DescriptionError, UnknownNameError, hint

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.arenas.arena_task import ArenaTask
    from bricktwin.twin.physics import Physics

__all__ = ["ARENAS", "get_arena_task", "make_arena"]

ARENAS = {"Tag-v0": "tag:TAG", "Carry-v0": "carry:CARRY", "Guide-v0": "guide:GATE"}
"""Module and object of each task."""


def check_arena(env_id: str) -> None:
    """Raise UnknownNameError if there is no arena of this name, without an import of one, which
    loads torch."""
    if env_id not in ARENAS:
        raise UnknownNameError(
            f"there is no arena '{env_id}'{hint(env_id, ARENAS)}; choose {', '.join(ARENAS)}"
        )


def get_arena_task(env_id: str) -> ArenaTask:
    """Task of a name. Raises UnknownNameError if there is none."""
    check_arena(env_id)
    module_name, _, name = ARENAS[env_id].partition(":")
    # This import is late, because a task's module loads torch.
    module = importlib.import_module(f"bricksrl.envs.arenas.{module_name}")
    task: ArenaTask = getattr(module, name)
    return task


def arena_summary(env_id: str) -> str:
    """First paragraph of an arena's description, without its import, which loads torch."""
    module_name, _, _ = ARENAS[env_id].partition(":")
    source = importlib.resources.files(__name__) / f"{module_name}.py"
    tree = ast.parse(source.read_text(encoding="utf-8"))
    description = ast.get_docstring(tree) or ""
    summary, _, _ = description.partition("\n\n")
    return " ".join(summary.split())


def make_arena(
    env: str | ArenaTask,
    *,
    seed: int | None = None,
    physics: Physics | None = None,
    realtime: bool = False,
    deaf: bool = False,
    batch_size: int | Sequence[int] = 0,
    device: str = "cpu",
) -> EnvBase:
    """An environment of several robots, in TorchRL's multi-agent conventions.

    Args:
        env: a name of `ARENAS`, or a task of your own.
        physics: physics of the virtual robots.
        realtime: run in real time.
        deaf: no robot hears what the others tell it.
        batch_size, device: number of copies (``8``, or ``[8]`` as in TorchRL) of a kinematic
            simulation without hubs, contacts and loads, and the device of its tensors; 0 for the
            arena itself.

    Raises:
        UnknownNameError: there is no such arena.
        RunError: there is no such device.
        DescriptionError: the seed is invalid, the task has no simulation, or its robots tell one
            another nothing and are to be deaf.
    """
    check_seed(seed)
    task = get_arena_task(env) if isinstance(env, str) else env
    if deaf and not task.told:
        raise DescriptionError(f"the robots of {task.id} tell one another nothing; omit deaf")
    from bricksrl.envs.arenas.arena_env import ArenaEnv, ArenaSimulation
    from bricksrl.envs.simulation import batch_shape

    shape = batch_shape(batch_size)
    if shape:
        if task.arena.loads:
            raise DescriptionError(
                f"{task.id} has no kinematic simulation, which would lack what the robots push; "
                "leave out batch_size, or let the "
                "team learn with copies=0"
            )
        if realtime or physics is not None:
            raise DescriptionError(
                f"the kinematic simulation of {task.id} has no time and no physics; omit realtime "
                "and physics"
            )
        arena: ArenaSimulation | ArenaEnv = ArenaSimulation(
            task,
            shape[0],
            seed=seed,
            device=device,
            deaf=deaf,
        )
    elif device != "cpu":
        raise DescriptionError(
            f"{task.id} with its hubs runs on the CPU; omit device, or give a batch_size"
        )
    else:
        arena = ArenaEnv(
            task,
            seed=seed,
            physics=physics,
            realtime=realtime,
            deaf=deaf,
        )
    arena.remake = functools.partial(
        make_arena,
        env,
        physics=physics,
        realtime=realtime,
        deaf=deaf,
        batch_size=batch_size,
        device=device,
    )
    return arena
