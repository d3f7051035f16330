"""Recording of runs: all transitions go into a dataset in the run's folder."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from tensordict import TensorDictBase
from torchrl.envs import EnvBase

from brickhub.seed import derive_seed
from brickhub.user_files import without_folder
from bricksrl.data.recorder import Recorder
from bricksrl.data.schema import describe
from bricksrl.data.transitions import about, step_of
from bricksrl.envs.env_interface import interface_of
from bricksrl.errors import BricksError
from bricksrl.training.callbacks import Callback, Episode, Phase, Progress
from bricksrl.training.config import TrainConfig

DATA_FOLDER = "data"
"""Name of the dataset's folder in a run."""


def open_recorder(config: TrainConfig, env: EnvBase, run_dir: Path) -> AbstractContextManager[Recorder | None]:
    """The recorder of a run as a context; ``None`` if recording is off. Raises DataError if its dataset is damaged or unfit."""
    if not config.record or config.updates or env.batch_size:
        return nullcontext()
    return Recorder(run_dir / DATA_FOLDER, describe(env, config.options, name=config.env))


class Recording(Callback):
    """Records one robot, episode by episode."""

    def __init__(self, config: TrainConfig, env: EnvBase, recorder: Recorder) -> None:
        self._config, self._env, self._recorder = config, env, recorder
        self._is_cut = False

    def on_transition(self, episode: int, step: int, phase: Phase, transition: TensorDictBase) -> None:
        if step == 1:
            policy = "random" if phase is Phase.PREFILL else without_folder(self._config.agent)
            seed = derive_seed(self._config.seed, "episode", episode)
            self._recorder.begin(about(self._env, policy, seed=seed, hub=self._config.hub))
        self._recorder.add(step_of(transition, self._env, intervention=bool(transition.get("intervention", False))))
        self._is_cut = interface_of(self._env).is_cut  # by a pause; an evaluation may follow before the end

    def on_link_lost(self, episode: int, length: int, error: BricksError) -> None:
        self._recorder.commit(whole=False)

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self._recorder.commit(success=None if self._is_cut else episode.success, whole=not self._is_cut)
