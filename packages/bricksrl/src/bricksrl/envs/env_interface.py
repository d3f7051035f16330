"""Interface of environments: what the run loop, recording, page, evaluation and plugins need of
one, with its defaults."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bricksrl.errors import BricksError, CameraError, HubError

if TYPE_CHECKING:
    from torch import Tensor

    from brickhub.kits.virtual_kit import VirtualRobot
    from bricksrl.envs.connection import Connection, Reconnect
    from bricksrl.envs.episode_state import EpisodeState
    from bricksrl.envs.hub_policy import HubPolicy
    from bricksrl.envs.task import Task


Connect = Callable[[int], "Connection"]
"""Makes the connection to a robot, given a seed for a virtual one."""


class BricksEnv:
    """An environment of ours, by default a simulation: it moves no robot, cannot be paused and
    judges what the agent observes.

    It is pickled and copied as the call that makes it: a fresh one with the same options and seed.

    Attributes:
        task: the task; ``None`` for an environment that is not ours.
        robots: number of robots, real or virtual, that `stop`, `pause` and `resume` reach; 0 for a
            simulation.
        reconnect: reconnection after the link broke; ``None`` without a link.
        link_error: error of the last step that ended with ``link_lost``.
        in_reach: of a virtual robot, may be set before the first reset: while it returns False, the
            link is broken.
        on_button: called in a step at whose end a watched button is down, and was not before.
        remake: makes it, given a seed; ``None`` if there cannot be two of it, as of a robot.
        connect_to: makes the connections to a hub that acts by a policy, or as before by none;
            ``None`` where each step needs this computer, as `by_steps_because` says.
    """

    task: Task | None = None
    robots: int = 0
    reconnect: Reconnect | None = None
    link_error: HubError | CameraError = HubError("no link has broken")
    in_reach: Callable[[], bool] = staticmethod(lambda: True)
    on_button: Callable[[], None] = staticmethod(lambda: None)
    remake: Callable[..., object] | None = None
    connect_to: Callable[[HubPolicy | None], Connect] | None = None
    by_steps_because: str = "it is no robot of ours with a hub"
    _seed: int | None = None

    def __reduce__(self) -> tuple[Callable[[], object], tuple[()]]:
        if self.remake is None:
            env_id = type(self).__name__ if self.task is None else self.task.id
            raise BricksError(
                f"{env_id} cannot be pickled with its link to a robot; pass a function that makes "
                "it, such as "
                f"functools.partial(bricksrl.make, '{env_id}', hub='ble')"
            )
        return functools.partial(self.remake, seed=self._seed), ()

    @property
    def twin(self) -> VirtualRobot | None:
        """The virtual hub of a single robot; ``None`` for a real robot or none. A new seed makes a
        new one."""
        return None

    @property
    def episode(self) -> EpisodeState | None:
        """State of the present episode of a single robot; ``None`` without one, and while the robot
        is placed."""
        return None

    def act_by_trials(self, _policy: HubPolicy | None) -> None:
        """Let the hub act by a policy, a trial at a time, from the next reset on; by none, the
        computer acts step by step again. Without effect where `connect_to` is ``None``."""

    @property
    def is_paused(self) -> bool:
        """True while a pause is requested."""
        return False

    @property
    def is_cut(self) -> bool:
        """True if a pause truncated the current episode, which then does not count."""
        return False

    @property
    def timing(self) -> EpisodeState | None:
        """Times of the last step, ``age_s`` and ``hub_time_s``; ``None`` without a robot. Raises
        BricksError if no step was made yet."""
        return None

    def stop(self) -> None:
        """Stop motors and program at once, even during a step; step and reset raise StoppedError
        until `resume`. Raises HubError if the hub could not be reached; its watchdog then stops the
        motors."""

    @property
    def has_stopped(self) -> bool:
        """Whether the motors are known to be stopped after `stop`: by the hub's word, not by that
        of whoever asked for it."""
        return True

    def pause(self) -> None:
        """Hold the robot still after the current step, until `resume`."""

    def resume(self) -> None:
        """End `pause` or `stop`: the robot may move again after the next reset."""

    def watch(self, _watcher: Callable[[Connection], None]) -> Callable[[], None]:
        """Call ``watcher`` with the present connection to a single robot and with each later one: a
        new seed makes a new virtual robot.

        Returns:
            A function that removes the watcher.
        """
        return lambda: None

    def task_observations(self, observations: Tensor) -> Tensor:
        """Input of the task's success and metrics for the observations ``[steps, n]`` of the whole
        current episode: by default these."""
        return observations

    def walk_metrics(self) -> dict[str, float]:
        """Metrics of a virtual robot's true motion: distance, speed, straightness; errors of its
        dead reckoning."""
        return {}


def interface_of(env: Any) -> BricksEnv:
    """The interface of any environment: of the one under the transforms if that is ours, else the
    defaults."""
    # Our own environments need no import of TorchRL.
    if isinstance(env, BricksEnv):
        return env
    from torchrl.envs import TransformedEnv

    while isinstance(env, TransformedEnv) and not isinstance(env, BricksEnv):
        env = env.base_env
    return env if isinstance(env, BricksEnv) else BricksEnv()
