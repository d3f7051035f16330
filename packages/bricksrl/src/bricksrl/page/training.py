"""Live page of a training run: a callback that shows it, and lets the page pause and reset it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.files import quoted
from brickhub.user_files import without_folder
from bricksrl.page.live import LivePage
from bricksrl.training.callbacks import Callback, Episode, Phase, Progress, RunResult

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.errors import BricksError
    from bricksrl.training.config import TrainConfig

_PHASES = {Phase.PREFILL: "random start", Phase.TRAIN: "learning", Phase.OFFLINE: "learning from data"}


class PageCallback(Callback):
    """Callback that shows a run on a page.

    Args:
        page: page that is already entered.
        stop: event that ends the run.
    """

    def __init__(self, page: LivePage, stop: threading.Event) -> None:
        self._page, self._stop = page, stop
        self._episodes = 0

    def on_env(self, env: EnvBase) -> None:
        self._page.attach(env)

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        self._episodes = config.episodes
        self._page.board.update_status(
            title=without_folder(config.env), subtitle=f"{without_folder(config.agent)}, seed {config.seed} · {run_dir}"
        )
        self._page.begin()

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        if step == 1:
            self._page.begin()
        self._page.note(episode=f"{episode}/{self._episodes}", phase=_PHASES[phase])
        self._page.show_step(transition)
        if bool(transition["next", "done"]):
            self._page.clear_reset()  # before an evaluation, which would block on the pause

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        self._page.hold(self._stop.is_set)
        self._page.cut()

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        self._page.clear_reset()
        self._page.board.update_status(message=f"{error}; trying to reach it again")

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self._page.board.update_status(message="")
        self._page.end(episode.return_, f"{episode.episode}/{self._episodes}")
        self._page.begin()

    def on_end(self, result: RunResult) -> None:
        if result.interrupted:
            self._page.finish(f"interrupted; `bricksrl resume {quoted(result.run_dir)}` goes on")
        else:
            self._page.finish("")
