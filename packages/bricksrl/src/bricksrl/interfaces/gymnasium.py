"""Gymnasium interface: ``gymnasium.make("bricksrl/RunAway-v0")`` after ``import bricksrl``.

Gymnasium calls each id that has a later version out of date. Here a later version is another task:
``Walker-v0`` is the paper's. ``gymnasium.make(gymnasium.spec("bricksrl/Walker-v0"))`` does not
warn.

The number of steps of an episode is Gymnasium's: that of the id without options, or
``gymnasium.make(..., max_episode_steps=N)``, shorter or longer; -1 is for no limit. With an option
that makes episodes longer, give the number too:
``gymnasium.make("bricksrl/Walker-v0", step_ms=100, max_episode_steps=250)``.

Wrappers show goals as Gymnasium's environments of robots have them, for hindsight experience replay
of other libraries.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase

from brickhub.fields import Count, check_value
from bricksrl.agents.features.observed import ObservationEncoder
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import is_simulation
from bricksrl.envs.rollout import link_lost
from bricksrl.envs.specs import clamped
from bricksrl.envs.task import check_measures, metrics_of, success_of
from bricksrl.envs.transforms import layout_of
from bricksrl.errors import (
    BricksError,
    DescriptionError,
    RenderingUnavailableError,
    UnknownOptionError,
)

if TYPE_CHECKING:
    from bricksrl.envs.env import HubEnv
    from bricksrl.envs.simulation import SimulatedEnv
    from bricksrl.envs.task import Task
    from bricktwin.twin.render.opengl import Renderer

Array = NDArray[np.float32]
Observation = Array | dict[str, NDArray[Any]]

_log = logging.getLogger(__name__)

_ENDLESS = 2**31 - 1
"""Limit of the environments inside, in steps: those here count the steps of their episodes."""


class GymnasiumEnv(gymnasium.Env[Observation, Array]):
    """A BricksRL environment with Gymnasium's interface.

    Observation and action are float32 arrays with the bounds of the task's tables; where a range is
    only nominal, the bounds are those that a hub can report. With cameras, the observation is a
    dict of this array, "observation", and the uint8 images, such as "image". ``info`` holds the
    task's metrics and the success of the episode so far, as ``success`` and, for Stable-Baselines3,
    as ``is_success``; the last of an episode is the episode's. A task with a `BaseEnv` of its own
    knows neither. Of an episode whose link breaks, metrics are those before, and it is no success.

    Args:
        env_id: id of the environment, such as ``"RunAway-v0"``.
        render_mode: ``None``, or ``"rgb_array"`` to draw a virtual robot.
        max_episode_steps: steps after which an episode is truncated; by default the task's. From
            ``gymnasium.make``, its wrapper truncates, and this environment does not.
        options, named: as in :func:`bricksrl.make`.

    Attributes:
        max_episode_steps: steps of an episode; ``None`` where Gymnasium's wrapper counts them.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        env_id: str,
        render_mode: str | None = None,
        options: EnvOptions | None = None,
        max_episode_steps: int | None = None,
        **named: Any,
    ) -> None:
        if is_simulation(env_id):
            if render_mode is not None:
                raise UnknownOptionError(
                    f"{env_id} simulates no body that could be drawn; omit render_mode"
                )
            if named.get("batch_size") or named.get("device", "cpu") != "cpu":
                remedy = "omit batch_size and device, or use bricksrl.make"
                raise UnknownOptionError(
                    f"Gymnasium's {env_id} is one environment on the CPU; {remedy}"
                )
            self.metadata = {"render_modes": []}
        self.env: HubEnv | SimulatedEnv = _made(env_id, options, **named)
        self.max_episode_steps = _limit(max_episode_steps, self.env.task)
        self._remove_inner_limit()
        # The hint is about episodes that Gymnasium ends earlier than the options say.
        self._hint = ""
        self._spec: EnvSpec | None = None
        fps = max(1, round(self.env.task.rate_hz))
        self.metadata = {**self.metadata, "render_fps": fps}
        self.render_mode = render_mode
        self._observations: list[torch.Tensor] = []
        # The info of the last step is kept for a step without an outcome.
        self._info: dict[str, Any] = {}
        self._ended = False
        self._renderer: Renderer | None = None
        vector = _box(self.env.task)
        self.observation_space: gymnasium.Space[Any] = vector
        images = self.env.task.images
        if images:
            boxes = {
                key: Box(0, 255, (side_px, side_px, 3), np.uint8) for key, side_px in images.items()
            }
            self.observation_space = Dict({"observation": vector, **boxes})
        self.action_space = Box(-1.0, 1.0, self.env.action_spec.shape)

    @property
    def spec(self) -> EnvSpec | None:
        """How ``gymnasium.make`` made this environment, which then leaves the time limit to it;
        ``None`` if it did not. Setting it raises UnknownOptionError if it has a time limit of ours,
        which Gymnasium does not know."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec
        if spec is None:
            return
        _refuse_max_steps(spec.kwargs)
        registered = gymnasium.registry.get(spec.id)
        self._hint = ""
        if registered is not None:
            self._hint = _longer(self.max_episode_steps, registered.max_episode_steps)
        # The wrapper counts the steps from here on.
        self.max_episode_steps = None

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode. A seed makes this and all later episodes reproducible."""
        self._warn_of_short_episodes()
        super().reset(seed=seed)
        if seed is not None:
            self.env.set_seed(seed)
            # The new seed makes another virtual robot, which the present renderer does not show.
            self._close_renderer()
        self._observations = []
        self._info = {}
        self._ended = False
        # There is no info, because nothing has happened yet that could be judged.
        return self._observation(self.env.reset()), {}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one step; returns observation, reward, terminated, truncated and info. Raises
        BricksError after the end of an episode."""
        if self._ended:
            raise BricksError(
                f"{self.env.task.id} got a step after the end of an episode; reset it first"
            )
        sent = TensorDict({"action": torch.tensor(action, dtype=torch.float32)}, batch_size=())
        result = self.env.step(sent)["next"]
        if link_lost(sent.set("next", result)):
            # The step has no outcome, so the metrics stay those of the step before.
            self._ended = True
            info = self._info | self._successes(False) | {"link_lost": True}
            return self._observation(result), 0.0, False, True, info
        self._observations.append(result["observation"].clone())
        steps = len(self._observations)
        is_over = self.max_episode_steps is not None and steps >= self.max_episode_steps
        terminated = bool(result["terminated"])
        truncated = is_over or bool(result["truncated"])
        self._ended = terminated or truncated
        # Episodes are judged after each step, because whoever ends one does not say so.
        episode = self.env.task_observations(torch.stack(self._observations))
        metrics = metrics_of(self.env.task, episode)
        is_success = success_of(self.env.task, episode)
        self._info = metrics | self._successes(is_success)
        reward = float(result["reward"])
        return self._observation(result), reward, terminated, truncated, dict(self._info)

    def render(self) -> NDArray[np.uint8] | None:
        """Image of the virtual robot, uint8 ``[height, width, 3]``; ``None`` without a render mode.
        Raises RenderingUnavailableError if the robot is real, or OpenGL is missing."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            from brickhub.virtual.faults import sound_body
            from bricktwin.twin.mujoco_body import MujocoBody
            from bricktwin.twin.render.opengl import Renderer

            # Faults belong to the robot's devices, and the body that is drawn is behind them.
            body = None if self.env.twin is None else sound_body(self.env.twin.body)
            if not isinstance(body, MujocoBody):
                raise RenderingUnavailableError(
                    f"the robot of {self.env.task.id} has no picture; use hub='virtual'"
                )
            self._renderer = Renderer(body)
        return self._renderer.render()

    def close(self) -> None:
        """Stop the robot and close the link. May be called twice."""
        self._close_renderer()
        self.env.close()

    def __getstate__(self) -> dict[str, Any]:
        """Pickled without an episode, as ``env`` is."""
        return {
            **self.__dict__,
            "_observations": [],
            "_info": {},
            "_ended": False,
            "_renderer": None,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._remove_inner_limit()

    def _remove_inner_limit(self) -> None:
        """Let the environment inside go on for ever, as this one, or Gymnasium, counts the
        steps."""
        self.env.task = replace(self.env.task, max_steps=_ENDLESS)

    def _successes(self, is_success: bool) -> dict[str, Any]:
        """Entries of ``info`` about success, by our name and by that of other libraries."""
        if self.env.task.base_env is not None:
            return {}
        return {"success": is_success, "is_success": is_success}

    def _warn_of_short_episodes(self) -> None:
        """Say once that Gymnasium ended an episode earlier than the options say."""
        if not self._hint or self._spec is None or self._ended:
            return
        registered = gymnasium.registry.get(self._spec.id)
        if registered is None:
            return
        # The wrapper ends an episode without saying so, but the number of steps shows it.
        if len(self._observations) == registered.max_episode_steps:
            _log.warning("%s: %s", self.env.task.id, self._hint)
            self._hint = ""

    def _close_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _observation(self, state: TensorDictBase) -> Observation:
        vector: Array = state["observation"].numpy()
        images = {key: state[key].numpy() for key in self.env.task.images}
        return {"observation": vector, **images} if images else vector


class GymnasiumVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Copies of a simulation as one batch: ``gymnasium.make_vec("bricksrl/WalkerSim-v0", 1024)``.

    The step after the end of an episode resets its copy, ignores the action and has no reward.
    ``info`` holds the task's metrics, ``success`` and ``is_success`` of the episodes that just
    ended. A seed is that of all copies. Arguments are those of `GymnasiumEnv` and:

    Args:
        autoreset_mode: one of Gymnasium's: ``NEXT_STEP`` as above; ``SAME_STEP`` resets a copy in
            the step that ends its episode, whose observation and info are then ``final_obs`` and
            ``final_info``; ``DISABLED`` leaves it to ``reset(options={"reset_mask": ended})``.
    """

    metadata = {  # noqa: RUF012 - as Gymnasium declares it
        "autoreset_mode": AutoresetMode.NEXT_STEP,
        "render_modes": [],
    }

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        options: EnvOptions | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **named: Any,
    ) -> None:
        if render_mode is not None:
            raise UnknownOptionError(
                f"{env_id} simulates no body that could be drawn; omit render_mode"
            )
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ", ".join(mode.value for mode in AutoresetMode)
            raise UnknownOptionError(
                f"there is no autoreset_mode {autoreset_mode!r}; choose one of {known}"
            ) from None
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.env: SimulatedEnv = _made(
            env_id,
            options,
            batch_size=num_envs,
            **named,
        )
        task = self.env.task
        self.num_envs = num_envs
        self._max_steps = _limit(max_episode_steps, task)
        # make_vec passes the limit on, from the registry or from the user.
        if max_episode_steps is not None:
            _refuse_max_steps(named)
            registered = gymnasium.registry.get(f"bricksrl/{env_id}")
            by_default = None if registered is None else registered.max_episode_steps
            remedy = _longer(task.max_steps, max_episode_steps)
            if by_default == max_episode_steps and remedy:
                _log.warning("%s: %s", task.id, remedy)
        self.env.task = replace(task, max_steps=_ENDLESS)
        self.single_observation_space = _box(self.env.task)
        self.single_action_space = Box(-1.0, 1.0, self.env.action_spec.shape[1:])
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        # Whole episodes are kept, because success and metrics are judged at their end.
        self._episodes = torch.zeros(num_envs, task.max_steps, len(task.entries))
        self._copies = torch.arange(num_envs)
        self._steps = torch.zeros_like(self._copies)
        self._ended = torch.zeros(num_envs, dtype=torch.bool)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode of all copies, or of those in ``options["reset_mask"]``, bool
        ``[copies]``. A seed makes these and all later episodes reproducible."""
        if isinstance(seed, list):
            raise UnknownOptionError(
                f"{self.env.task.id} has one seed for all copies; give a whole number"
            )
        super().reset(seed=seed)
        if seed is not None:
            self.env.set_seed(seed)
        mask = (options or {}).get("reset_mask")
        if mask is not None:
            copies = np.asarray(mask)
            is_mask = copies.dtype == np.bool_ and copies.shape == (self.num_envs,)
            if not is_mask or not copies.any():
                wanted = f"a reset_mask of {self.num_envs} bools, one of them True at least"
                raise UnknownOptionError(f"{self.env.task.id} needs {wanted}")
            return self._restart(torch.from_numpy(copies)), {}
        self._steps = torch.zeros_like(self._copies)
        self._ended = torch.zeros(self.num_envs, dtype=torch.bool)
        return self.env.reset()["observation"].cpu().numpy().copy(), {}

    def step(
        self,
        actions: Array,
    ) -> tuple[Array, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Take one step in all copies; returns observations, rewards, terminated, truncated and
        info."""
        starts = self._ended
        if self.autoreset_mode is AutoresetMode.DISABLED and starts.any():
            raise BricksError(
                f"{self.env.task.id} got a step after the end of an episode; reset with its "
                "reset_mask first"
            )
        batch = clamped(
            torch.as_tensor(actions, dtype=torch.float32),
            self.env.action_spec.shape,
            self.env.task.id,
        )
        sent = TensorDict({"action": batch}, self.env.batch_size, device=self.env.device)
        result = self.env.step(sent)["next"]
        # A copy that starts in this step has ignored its action, so it gets no reward and goes on.
        reward, terminated, truncated = (
            result[name].squeeze(-1).cpu().masked_fill(starts, 0)
            for name in ("reward", "terminated", "truncated")
        )
        if starts.any():
            observation = self._restart(starts)
        else:
            observation = result["observation"].cpu().numpy().copy()
        self._store(torch.from_numpy(observation))
        # In a copy that starts, the first step overwrites the start.
        self._steps += ~starts
        # The simulation inside has no limit (see `_ENDLESS`), so it is applied here.
        if self._max_steps is not None:
            truncated |= self._steps >= self._max_steps
        self._ended = terminated | truncated
        info = self._info()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            ended = self._ended.numpy()
            # As in Gymnasium, copies that go on have None here.
            final = np.full(self.num_envs, None, dtype=object)
            for copy in ended.nonzero()[0]:
                final[copy] = observation[copy]
            info = {
                "final_obs": final,
                "_final_obs": ended,
                "final_info": info,
                "_final_info": ended,
            }
            observation = self._restart(self._ended)
        return observation, reward.numpy(), terminated.numpy(), truncated.numpy(), info

    def _store(self, observations: torch.Tensor) -> None:
        """Keep the observations ``[copies, n]`` of this step; twice the room, if an episode became
        longer than all before."""
        if self._steps.max() >= self._episodes.shape[1]:
            more = torch.zeros_like(self._episodes)
            self._episodes = torch.cat((self._episodes, more), dim=1)
        self._episodes[self._copies, self._steps] = observations

    def _restart(self, copies: torch.Tensor) -> Array:
        """Observations of all copies after those of a mask have been reset."""
        mask = copies[:, None].to(self.env.device)
        done = dict.fromkeys(self.env.done_keys, mask)
        ended = TensorDict(done, self.env.batch_size, device=self.env.device)
        state = self.env.maybe_reset(ended)
        self._steps = self._steps.masked_fill(copies, 0)
        self._ended = self._ended & ~copies
        observation: Array = state["observation"].cpu().numpy().copy()
        return observation

    def _info(self) -> dict[str, Any]:
        """Metrics and success of the episodes that just ended, each with a mask of their copies, as
        in Gymnasium."""
        info: dict[str, Any] = {}
        # Judging is a function of batches, so episodes of the same length go in one.
        for steps in self._steps[self._ended].unique().tolist():
            is_of_length = self._ended & (self._steps == steps)
            copies = is_of_length.nonzero().squeeze(-1)
            episodes = self._episodes[copies, :steps]
            metrics = self.env.task.metrics(episodes)
            check_measures(metrics, f"metrics of {self.env.task.id}")
            success = self.env.task.success(episodes)
            outcome = {**metrics, "success": success, "is_success": success}
            for name, value in outcome.items():
                if name not in info:
                    info[name] = torch.zeros(self.num_envs, dtype=value.dtype).numpy()
                info[name][copies] = value
        masks = {f"_{name}": self._ended.numpy() for name in info}
        return info | masks

    def close_extras(self, **_kwargs: Any) -> None:
        """Close the simulation."""
        self.env.close(raise_if_closed=False)


def _limit(max_episode_steps: int | None, task: Task) -> int | None:
    """Steps of an episode: the task's unless others are given; ``None`` for no limit, which
    Gymnasium calls -1."""
    check_value("max_episode_steps", max_episode_steps, int | None)
    if max_episode_steps is None:
        return task.max_steps
    if max_episode_steps == -1:
        return None
    check_value("max_episode_steps", max_episode_steps, Count)
    return max_episode_steps


def _refuse_max_steps(named: dict[str, Any]) -> None:
    if "max_steps" in named:
        number = named["max_steps"]
        raise UnknownOptionError(
            f"Gymnasium counts the steps of an episode itself; give max_episode_steps={number} in "
            "place of max_steps"
        )


def _longer(steps: int | None, registered: int | None) -> str:
    """Remedy for an option that makes episodes longer than Gymnasium lets them be; empty if it does
    not."""
    if steps is None or registered is None or steps <= registered:
        return ""
    return (
        f"with these options an episode has {steps} steps, and Gymnasium ends it after "
        f"{registered}; "
        f"give max_episode_steps={steps}"
    )


def _made(
    env_id: str,
    options: EnvOptions | None,
    **named: Any,
) -> Any:
    env = make(env_id, options, **named)
    # TorchRL's transforms stand around the environment, where Gymnasium's users would not see them.
    if interface_of(env) is not env:
        raise UnknownOptionError(
            "Gymnasium has wrappers of its own; omit frame_stack, frame_skip and transform"
        )
    return env


def _box(task: Task) -> Box:
    """Space of a task's observation, without an image."""
    limits = np.array([entry.bounds for entry in task.entries], dtype=np.float32)
    return Box(limits[:, 0], limits[:, 1])


class _Goals:
    """Goals in the observation vector of an environment of ours, which ``_find_goals`` looks for,
    and rewards of other goals."""

    unwrapped: Any
    _size: int
    _parts: dict[str, list[int]]
    """Indices of the entries of each part of an observation."""

    def _find_goals(
        self,
        env: Any,
        vector: gymnasium.Space[Any],
    ) -> None:
        ours = env.unwrapped
        is_ours = isinstance(ours, GymnasiumEnv | GymnasiumVectorEnv)
        pairs = layout_of(ours.env).goals if is_ours else ()
        if not isinstance(vector, Box) or not pairs:
            raise DescriptionError(
                f"{env} has no goals in a vector of ours; take one that has, such as "
                "bricksrl/RoboArm-v0"
            )
        self._size = vector.shape[-1]
        goals = [goal for goal, _ in pairs]
        reached = [angle for _, angle in pairs]
        others = [index for index in range(self._size) if index not in goals]
        self._parts = {"observation": others, "achieved_goal": reached, "desired_goal": goals}

    def _split_space(self, vector: Any) -> gymnasium.Space[Any]:
        boxes: dict[str, gymnasium.Space[Any]] = {}
        for name, part in self._parts.items():
            boxes[name] = Box(vector.low[..., part], vector.high[..., part])
        return Dict(boxes)

    def observation(self, observation: Array) -> dict[str, Array]:
        """Parts of an observation vector."""
        return {name: observation[..., part] for name, part in self._parts.items()}

    def compute_reward(
        self,
        achieved_goal: Array,
        desired_goal: Array,
        info: Any,
    ) -> Any:
        """Reward of a step that reached ``achieved_goal [*batch, g]``: a number, or an array
        ``[*batch]``."""
        state = self._state(achieved_goal, desired_goal)
        action = torch.zeros(*state.shape[:-1], len(self._task.interface.commands))
        return _plain(self._task.reward(state, action, state))

    def compute_terminated(
        self,
        achieved_goal: Array,
        desired_goal: Array,
        info: Any,
    ) -> Any:
        """Whether such a step ends the episode: a bool, or an array ``[*batch]``."""
        return _plain(self._task.terminated(self._state(achieved_goal, desired_goal)))

    def compute_truncated(
        self,
        achieved_goal: Array,
        desired_goal: Array,
        info: Any,
    ) -> bool:
        """False: only time truncates an episode."""
        return False

    @property
    def _task(self) -> Task:
        task: Task = self.unwrapped.env.task
        return task

    def _state(
        self,
        achieved_goal: Array,
        desired_goal: Array,
    ) -> torch.Tensor:
        achieved = torch.as_tensor(np.asarray(achieved_goal, np.float32))
        desired = torch.as_tensor(np.asarray(desired_goal, np.float32))
        # The other entries stay 0, because rewards of goals depend only on goals and reached
        # entries.
        state = torch.zeros(*achieved.shape[:-1], self._size)
        state[..., self._parts["achieved_goal"]] = achieved
        state[..., self._parts["desired_goal"]] = desired
        return state


class GoalObservation(
    _Goals, gymnasium.ObservationWrapper[dict[str, Array], Array, Any], RecordConstructorArgs
):
    """An environment whose observation vector has entries ``X_goal`` and ``X_angle``, split as in
    Gymnasium-Robotics.

    The observation is a dict: "observation", all entries that are no goals; "desired_goal", the
    goals ``[g]``; "achieved_goal", the entries ``[g]`` that are to reach them. `compute_reward`
    says what a step would have paid with another goal.

    ``GoalObservation(gymnasium.make("bricksrl/RoboArmSim-v0", sparse=True))``

    Args:
        env: one of ours, from ``gymnasium.make``, whose reward and end depend on goals and reached
            entries alone.

    Raises:
        DescriptionError: the environment has no goals, or is not ours.
    """

    def __init__(self, env: gymnasium.Env[Array, Array]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        self._find_goals(env, env.observation_space)
        self.observation_space = self._split_space(env.observation_space)


class FeatureObservation(gymnasium.ObservationWrapper[Array, Array, Any], RecordConstructorArgs):
    """The features of our agents in place of raw numbers: angles as sine and cosine, goals as
    differences, all of order one.

    Other libraries learn little from angles that wrap and from ranges of thousands.
    ``FeatureObservation(gymnasium.make("bricksrl/Walker-v2"))``

    Args:
        env: one of ours, from ``gymnasium.make``, without a camera.

    Raises:
        DescriptionError: the environment is not ours, or observes images.
    """

    def __init__(self, env: gymnasium.Env[Array, Array]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        ours = env.unwrapped
        if not isinstance(ours, GymnasiumEnv) or not isinstance(env.observation_space, Box):
            raise DescriptionError(
                f"{env} has no vector of ours; take one that has, such as bricksrl/Walker-v1"
            )
        self._encoder = ObservationEncoder(layout_of(ours.env)).eval()
        self.observation_space = Box(-np.inf, np.inf, (self._encoder.size,))

    @torch.no_grad()
    def observation(self, observation: Array) -> Array:
        """Features ``[f]`` of an observation ``[n]``."""
        features: Array = self._encoder(torch.from_numpy(observation)).numpy()
        return features


class VectorGoalObservation(_Goals, VectorWrapper):
    """Copies of a simulation as one batch with goals, each as of `GoalObservation`.

    ``VectorGoalObservation(gymnasium.make_vec("bricksrl/RoboArmSim-v0", 64, sparse=True))``

    Args:
        envs: one of ours, from ``gymnasium.make_vec``, in any autoreset mode; final observations
            are split too.

    Raises:
        DescriptionError: the environment has no goals, or is not ours.
    """

    def __init__(self, envs: VectorEnv[Array, Array, Any]) -> None:
        super().__init__(envs)
        self._find_goals(envs, envs.single_observation_space)
        self.single_observation_space = self._split_space(envs.single_observation_space)
        self.observation_space = self._split_space(envs.observation_space)

    def reset(
        self,
        *,
        seed: Any = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Start an episode of all copies, or of those in ``options["reset_mask"]``."""
        observations, info = self.env.reset(seed=seed, options=options)
        return self.observation(observations), info

    def step(self, actions: Array) -> tuple[dict[str, Array], Any, Any, Any, dict[str, Any]]:
        """Take one step in all copies."""
        observations, *outcome, info = self.env.step(actions)
        if "final_obs" in info:
            for copy in info["_final_obs"].nonzero()[0]:
                info["final_obs"][copy] = self.observation(info["final_obs"][copy])
        reward, terminated, truncated = outcome
        return self.observation(observations), reward, terminated, truncated, info


def _plain(values: torch.Tensor) -> Any:
    """Values ``[*batch, 1]`` as a number, or an array ``[*batch]``."""
    array: NDArray[Any] = values.squeeze(-1).numpy()
    return array if array.ndim else array.item()
