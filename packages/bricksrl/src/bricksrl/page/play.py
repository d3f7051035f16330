"""Episodes on the page: of a training run, or by the selected policy or a human until they are
ended, through emergency stops, resets and lost links."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.files import quoted
from brickhub.user_files import without_folder
from bricksrl.envs.env_interface import interface_of
from bricksrl.errors import BricksError, StoppedError
from bricksrl.page.live import LivePage
from bricksrl.teleoperation import at_rest
from bricksrl.training.callbacks import Callback, Episode, Phase, Progress, RunResult

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.envs.rollout import Driver
    from bricksrl.policies.policy import Player
    from bricksrl.training.config import TrainConfig

Steps = Generator[None, None, float | None]
"""An episode: it is reset first, and moves and is shown at each further step; its return, ``None``
if it was cut short."""
_COAST_MS = 500
"""Simulated time for which the coasting motors are shown after a stop."""
_PHASES = {
    Phase.PREFILL: "random start",
    Phase.TRAIN: "learning",
    Phase.OFFLINE: "learning from data",
}


class PageCallback(Callback):
    """Callback that shows a run on a page.

    Args:
        page: page that is already entered.
        stop: event that ends the run.
    """

    def __init__(
        self,
        page: LivePage,
        stop: threading.Event,
    ) -> None:
        self._page = page
        self._stop = stop
        self._episodes = 0

    def on_env(self, env: EnvBase) -> None:
        self._page.attach(env)

    def on_start(
        self,
        config: TrainConfig,
        run_dir: Path,
        episodes_done: int,
    ) -> None:
        self._episodes = config.episodes
        self._page.board.update_status(
            title=without_folder(config.env),
            subtitle=f"{without_folder(config.agent)}, seed {config.seed} · {run_dir}",
        )
        self._page.begin()

    def on_transition(
        self,
        episode: int,
        step: int,
        phase: Phase,
        transition: TensorDictBase,
    ) -> None:
        if step == 1:
            self._page.begin()
        self._page.note(episode=f"{episode}/{self._episodes}", phase=_PHASES[phase])
        self._page.show_step(transition)
        # At the end of an episode, as an evaluation may follow, which would block on the pause.
        if bool(transition["next", "done"]):
            self._page.clear_reset()

    def on_step(
        self,
        episode: int,
        step: int,
        phase: Phase,
    ) -> None:
        self._page.hold(self._stop.is_set)
        self._page.cut()

    def on_link_lost(
        self,
        episode: int,
        length: int,
        error: BricksError,
    ) -> None:
        self._page.clear_reset()
        self._page.board.update_status(message=f"{error}; trying to reach it again")

    def on_episode(
        self,
        episode: Episode,
        progress: Progress,
    ) -> None:
        self._page.board.update_status(message="")
        self._page.end(episode.return_, f"{episode.episode}/{self._episodes}")
        self._page.begin()

    def on_end(self, result: RunResult) -> None:
        message = ""
        if result.interrupted:
            message = f"interrupted; `bricksrl resume {quoted(result.run_dir)}` goes on"
        self._page.finish(message)


def resting_player(env: EnvBase, driver: Driver | None = None) -> Player:
    """Player that moves no motor, except as its driver says."""
    import torch

    from bricksrl.data.schema import describe_task
    from bricksrl.policies.policy import Player

    resting = torch.tensor(at_rest(describe_task(env.task).action))

    def act(state: TensorDictBase) -> TensorDictBase:
        action = None if driver is None else driver(state["observation"])
        return state.set("action", resting if action is None else action)

    return Player(act)


def play_on_page(
    env: EnvBase,
    page: LivePage,
    players: Mapping[str, Callable[[], Player]],
    *,
    episodes: int | None = None,
    stop: threading.Event | None = None,
) -> list[float]:
    """Play as `play_endlessly`, with the player that is selected at each step.

    Args:
        players: players by name; each is created when it is first selected.
    """
    from bricksrl.envs.rollout import link_lost, play
    from bricksrl.envs.transforms import own_frames

    # A policy is loaded when it is first selected, and keeps what it remembers.
    player = functools.cache(lambda name: players[name]())

    def episode(_number: str) -> Steps:
        start = env.reset()
        total = 0.0
        yield
        for frame in play(
            env,
            lambda state: player(page.policy).act(state),
            start,
            driver=page.driver,
            reset_policy=lambda: player(page.policy).reset(),
            goes_on=lambda: page.is_driven,
        ):
            for step in own_frames(env, frame):
                if link_lost(step):
                    raise interface_of(env).link_error
                page.show_step(step)
                total += float(step["next", "reward"])
            yield
        return None if interface_of(env).is_cut else total

    return play_endlessly(
        env,
        page,
        episode,
        episodes=episodes,
        stop=stop,
    )


def play_endlessly(
    env: Any,
    page: LivePage,
    episode: Callable[[str], Steps],
    *,
    episodes: int | None = None,
    stop: threading.Event | None = None,
) -> list[float]:
    """Play a number of episodes, or endlessly; returns the returns of the complete ones. Raises
    StoppedError if the robot was stopped, and ``stop`` is set.

    An emergency stop or an unreachable robot ends the episode; the next one begins after a reset on
    the page.

    Args:
        episode: the steps of an episode, given its number.
        stop: set if a stop is to end the playing, as by a key in the terminal.
    """
    returns = list[float]()
    stop = stop or threading.Event()
    page.attach(env)
    while episodes is None or len(returns) < episodes:
        number = f"{len(returns) + 1}"
        try:
            page.begin()
            return_ = _watched(
                page,
                episode(number),
                number,
                stop,
            )
            if return_ is not None:
                returns.append(return_)
                page.end(return_, number)
        except BricksError as error:
            message = f"{error}. Reset tries again."
            if isinstance(error, StoppedError):
                if stop.is_set():
                    raise
                message = "The robot was stopped by hand. Reset lets it start again."
                page.mark_stopped()
                # A virtual hub ends its program in this thread alone.
                env.close(raise_if_closed=False)
                twin = interface_of(env).twin
                # What coasts is seen to run down: a robot that froze would look like a lie.
                if twin is not None:
                    for _ in range(_COAST_MS // 10):
                        twin.machine.advance(10)
                        time.sleep(0.01)
            page.board.update_status(message=message)
            page.wait_for_reset(stop.is_set)
            if stop.is_set():
                raise StoppedError("the robot was stopped by hand") from error
            page.release()
            page.board.update_status(message="")
    return returns


def _watched(
    page: LivePage,
    steps: Steps,
    number: str,
    stop: threading.Event,
) -> float | None:
    """Take the steps of an episode, each when the page lets the robot go on; its return, ``None``
    if it was cut short."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return_: float | None = end.value
            return return_
        page.note(episode=number)
        page.hold(stop.is_set)
        if page.is_stopped or stop.is_set():
            raise StoppedError("the robot was stopped by hand")
        if page.is_reset_requested:
            return None
