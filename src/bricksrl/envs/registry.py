"""Environments by name. Importing this imports neither torch nor MuJoCo; making an environment does."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

import gymnasium

from bricksrl.envs.task import Task
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import DescriptionError, UnknownNameError

if TYPE_CHECKING:
    from bricksrl.envs.env import HubEnv
    from bricksrl.twin.physics import Physics, RandomPhysics

_OWN = {task.id: task for task in (RUN_AWAY, SPINNING)}
_tasks = dict(_OWN)


def make(
    env_id: str,
    hub: str = "virtual",
    *,
    seed: int | None = None,
    realtime: bool = False,
    physics: Physics | RandomPhysics | None = None,
) -> HubEnv:
    """An environment, ready to be reset.

    Args:
        env_id: one of :func:`list_envs`.
        hub: how to reach the robot; ``"virtual"`` runs the hub program on a simulated one.
        seed: of everything random; the same seed and actions give the same episodes, bit for bit.
        realtime: let a virtual robot take as long as a real one.
        physics: of the virtual robot: ``None`` for a freshly charged one on a smooth floor; a ``RandomPhysics`` draws
            another one for every episode.

    Raises:
        UnknownNameError: there is no such environment or no such kind of hub.
    """
    task = get_task(env_id)
    if hub != "virtual":
        raise UnknownNameError(f"there is no hub '{hub}'; only hub='virtual' can be used so far, Bluetooth is not there yet")
    from bricksrl.envs.env import Connection, HubEnv
    from bricksrl.hub.link import HubLink
    from bricksrl.twin.virtual_hub import VirtualHub

    def connect(twin_seed: int) -> Connection:
        twin = VirtualHub(task.robot, scene=task.scene, physics=physics, seed=twin_seed, realtime=realtime)
        return Connection(HubLink(twin, task.robot, task.interface), twin.reset, twin)

    return HubEnv(task, connect, seed=seed)


def list_envs() -> dict[str, str]:
    """Each environment's id and what it is about, in one line."""
    return {env_id: task.summary for env_id, task in sorted(_tasks.items())}


def get_task(env_id: str) -> Task:
    """The task behind an environment.

    Raises:
        UnknownNameError: there is none of that name.
    """
    try:
        return _tasks[env_id]
    except KeyError:
        known = ", ".join(sorted(_tasks))
        by_lower = {name.lower(): name for name in _tasks}
        close = difflib.get_close_matches(env_id.lower(), by_lower, n=1)
        hint = f"did you mean '{by_lower[close[0]]}'? There are" if close else "there are"
        raise UnknownNameError(f"there is no environment '{env_id}'; {hint} {known}") from None


def register(task: Task) -> None:
    """Make a task of your own available by its id: to :func:`make` and, as ``bricksrl/<id>``, to Gymnasium.

    Registering the same id again replaces the earlier task.

    Raises:
        DescriptionError: the id is one of the environments that come with BricksRL.
    """
    if task.id in _OWN:
        raise DescriptionError(f"{task.id} comes with BricksRL; give your task another name or version")
    _tasks[task.id] = task
    _offer_to_gymnasium(task)


def register_with_gymnasium() -> None:
    """Offer all environments to ``gymnasium.make`` as ``bricksrl/<id>``."""
    for task in _tasks.values():
        _offer_to_gymnasium(task)


def _offer_to_gymnasium(task: Task) -> None:
    gym_id = f"bricksrl/{task.id}"
    gymnasium.registry.pop(gym_id, None)
    gymnasium.register(
        id=gym_id,
        entry_point="bricksrl.envs.gymnasium_env:GymnasiumEnv",
        max_episode_steps=task.max_steps,
        kwargs={"env_id": task.id},
    )


register_with_gymnasium()
