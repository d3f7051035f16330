"""Arenas in PettingZoo's parallel API (the extra ``arenas``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from tensordict import TensorDict

from bricksrl.envs.arenas import make_arena
from bricksrl.errors import RunError, UnknownOptionError, hint, installed

if TYPE_CHECKING:
    from bricksrl.envs.arenas.arena_env import ArenaEnv
    from bricksrl.envs.arenas.arena_task import ArenaTask
    from bricktwin.twin.render.opengl import Renderer

with installed("PettingZoo", RunError, '"bricksrl[arenas]"'):
    from pettingzoo import ParallelEnv

Array = NDArray[np.float32]
_SIZE_PX = (480, 360)
"""Width and height of a picture of the arena."""


class ArenaParallelEnv(ParallelEnv):  # type: ignore[misc]
    """Several robots of an arena, by their names.

    Args:
        env: a name of `bricksrl.envs.arenas.ARENAS`, or a task of your own.
        render_mode: ``None``, or ``"rgb_array"`` to draw the arena.
        named: keyword arguments of `make_arena`, without ``batch_size`` and ``device``.

    Attributes:
        state_space: space of `state`.
        np_random: generator of wrappers, such as SuperSuit's, that draw from their environment's;
            the robots have their own.
    """

    def __init__(
        self,
        env: str | ArenaTask,
        render_mode: str | None = None,
        **named: Any,
    ) -> None:
        if named.get("batch_size"):
            raise UnknownOptionError(
                "PettingZoo's arenas are single ones; omit batch_size, or use make_arena"
            )
        if render_mode not in (None, "rgb_array"):
            given = f"{render_mode!r}{hint(str(render_mode), ('rgb_array',))}"
            raise UnknownOptionError(
                f"an arena has no render_mode {given}; choose rgb_array, or omit it"
            )
        self._env: ArenaEnv = make_arena(env, **named)
        task = self._env.task
        # Steps without a fixed time are shown one a second.
        step_ms = task.interfaces[0].settle.fixed_ms or 1000.0
        fps = max(1, round(1000.0 / step_ms))
        self.metadata = {
            "name": task.id,
            "is_parallelizable": True,
            "render_modes": ["rgb_array"],
            "render_fps": fps,
        }
        self.render_mode = render_mode
        self._renderer: Renderer | None = None
        self.possible_agents = list(task.robots)
        self.agents: list[str] = []
        bounds = [entry.bounds for entry in task.entries]
        low, high = np.array(bounds, np.float32).T
        robots = len(task.robots)
        self.observation_spaces = {name: Box(low, high) for name in task.robots}
        self.state_space = Box(np.tile(low, robots), np.tile(high, robots))
        shape = (task.action_size,)
        self.action_spaces = {name: Box(-1.0, 1.0, shape, np.float32) for name in task.robots}
        self._state: Any = None
        self.np_random, _ = np_random(named.get("seed"))

    def observation_space(self, agent: str) -> Box:
        """Space of a robot's observation."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Space of a robot's action."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Start an episode, reproducibly with a seed."""
        if seed is not None:
            self._env.set_seed(seed)
            # The new seed makes another world, which the present renderer does not show.
            self._close_renderer()
            self.np_random, _ = np_random(seed)
        self._state = self._env.reset()
        self.agents = list(self.possible_agents)
        return self._per_robot(self._state, "observation"), {name: {} for name in self.agents}

    def step(
        self,
        actions: dict[str, Array],
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """One step of all robots; the episode ends for all at once. Infos say whether a link broke,
        and whether the task's aim is reached. Raises RunError without an episode, or an action of
        each."""
        task = self._env.task
        if set(actions) != set(self.agents) or not self.agents:
            raise RunError(
                f"{task.id} got actions of {', '.join(actions) or 'none'}; reset it, then give "
                "one of each agent"
            )
        for group, names in task.groups.items():
            group_actions = np.stack([actions[name] for name in names])
            self._state[group, "action"] = torch.tensor(group_actions, dtype=torch.float32)
        out = self._env.step(TensorDict(self._state))["next"]
        # The ends belong to this step, and not to the state of the next one.
        self._state = out.exclude("terminated", "truncated", "done")
        is_success = bool(out["success"])
        info = {
            "link_lost": bool(out["link_lost"]),
            "success": is_success,
            # The name is the one that Stable-Baselines3 and Gymnasium-Robotics look for.
            "is_success": is_success,
        }
        observations = self._per_robot(out, "observation")
        rewards = {}
        for name, reward in self._per_robot(out, "reward").items():
            rewards[name] = float(reward[0])
        terminated = dict.fromkeys(self.agents, bool(out["terminated"]))
        truncated = dict.fromkeys(self.agents, bool(out["truncated"]))
        # Each robot has its own info, because a wrapper may write into it.
        infos: dict[str, dict[str, Any]] = {name: dict(info) for name in self.agents}
        if bool(out["done"]):
            # An empty list is PettingZoo's sign that the episode has ended for all.
            self.agents = []
        return observations, rewards, terminated, truncated, infos

    def state(self) -> Array:
        """Observations of all robots, in the order of `possible_agents`, for critics that see
        everything. Raises RunError before the first episode."""
        if self._state is None:
            raise RunError(
                f"{self._env.task.id} has no state before its first episode; reset it first"
            )
        observations = self._per_robot(self._state, "observation")
        return np.concatenate(list(observations.values()))

    def _per_robot(
        self,
        tensordict: Any,
        name: str,
    ) -> dict[str, Array]:
        task = self._env.task
        values = {}
        for group, names in task.groups.items():
            parts = tensordict[group, name].unbind(0)
            for robot, value in zip(names, parts, strict=True):
                # The values are copied, because the next step may write into the tensor.
                values[robot] = value.numpy().copy()
        # The order is that of the agents and not that of the groups.
        return {robot: values[robot] for robot in task.robots}

    def render(self) -> NDArray[np.uint8] | None:
        """Image of the arena from above, uint8 ``[height, width, 3]``; ``None`` without a render
        mode. Raises RenderingUnavailableError if OpenGL is missing."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            from bricktwin.twin.render.opengl import Renderer

            # All bodies are in one world, so that of the first robot shows the others too.
            body = self._env.world.bodies[0]
            self._renderer = Renderer(body, *_SIZE_PX, "arena")
        return self._renderer.render()

    def close(self) -> None:
        """Stop all robots. May be called twice."""
        self._close_renderer()
        self._env.close(raise_if_closed=False)

    def __getstate__(self) -> dict[str, Any]:
        """Pickled without an episode, as the arena is."""
        return {**self.__dict__, "agents": [], "_state": None, "_renderer": None}

    def _close_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
