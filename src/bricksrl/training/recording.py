"""What a run does is kept: every transition goes into the dataset in the run's folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.errors import BricksError
from bricksrl.training.config import TrainConfig
from bricksrl.training.observer import Episode, Observer, Phase, Progress, RunResult

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.data.recorder import Recorder

DATA_FOLDER = "data"
"""Of the dataset, in the folder of a run."""


@contextmanager
def recorded(config: TrainConfig, env: EnvBase, run_dir: Path, observer: Observer) -> Iterator[Observer]:
    """An observer that records and passes all on to ``observer``; or that one itself where the run is not to be recorded.

    However the run ends, what was done of an episode until then is recorded too.

    Raises:
        DataError: the dataset of a run that goes on is damaged or of another kind.
    """
    if not config.record:
        yield observer
        return
    from bricksrl.data.description import describe
    from bricksrl.data.recorder import Recorder

    with Recorder(run_dir / DATA_FOLDER, describe(env, config.options, name=config.env)) as recorder:
        yield _RunRecorder(config, env, recorder, observer)


class _RunRecorder(Observer):
    def __init__(self, config: TrainConfig, env: EnvBase, recorder: Recorder, inner: Observer) -> None:
        self._config, self._env, self._recorder, self._inner = config, env, recorder, inner

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        self._inner.on_start(config, run_dir, episodes_done)

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        self._inner.on_step(episode, step, phase)

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        from bricksrl.data.steps import about, step_of

        if step == 1:
            policy = "random" if phase is Phase.PREFILL else self._config.agent
            from bricksrl.training.reproducible import derive_seed

            seed = derive_seed(self._config.seed, "episode", episode)
            self._recorder.begin(about(self._env, policy, seed=seed, hub=self._config.hub))
        by_hand = bool(transition.get("intervention", False))
        self._recorder.add(step_of(transition, self._env, intervention=by_hand))
        self._inner.on_transition(episode, step, phase, transition)

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        self._recorder.commit(whole=False)
        self._inner.on_link_lost(episode, length, error)

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self._recorder.commit(success=episode.success)
        self._inner.on_episode(episode, progress)

    def on_end(self, result: RunResult) -> None:
        self._inner.on_end(result)

    def on_catching_up(self, updates: int) -> None:
        self._inner.on_catching_up(updates)
