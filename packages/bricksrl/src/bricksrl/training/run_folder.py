"""Folder of a run: config, metrics, checkpoint, learning curve, evaluation. Never overwritten by
another run."""

import csv
import io
import itertools
import json
import platform
import re
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from brickhub import HOUSES
from brickhub.fields import check_value
from brickhub.files import atomic_folder, reading, write_durably, writing
from brickhub.user_files import without_folder
from bricksrl.data.dataset import refuse_within_dataset
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.reference_returns import reference_lines
from bricksrl.envs.task import MEASURED, MEASURED_TOO
from bricksrl.errors import RunError, WriteError
from bricksrl.training.callbacks import Episode, Phase
from bricksrl.training.config import TrainConfig, code_in
from bricksrl.training.existing_run import CONFIG, existing_run
from bricksrl.training.trust import remember, require_trusted

DATA_FOLDER = "data"
"""Name of the dataset's folder in a run."""


class Origin(NamedTuple):
    """Origin of a run: its environment and the options of its first robot, its agent and seed."""

    env: str
    options: EnvOptions
    agent: str
    seed: int
    is_offline: bool
    """Whether the run learned from data alone."""


class RunFolder:
    """Paths and files of one run; ``best_path`` is of the best evaluation. Raises DescriptionError
    if the path is none."""

    def __init__(self, path: Path | str) -> None:
        check_value("run", path, Path | str)
        self.path = path = Path(path)
        self.config_path = path / CONFIG
        self.metrics_path = path / "metrics.csv"
        self.checkpoint_path = path / "checkpoint.bin"
        self.best_path = path / "best.bin"
        self.curve_path = path / "learning_curve.png"
        self.evaluation_path = path / "evaluation.json"

    @classmethod
    def create(
        cls,
        config: TrainConfig,
        state: dict[str, Any],
    ) -> "RunFolder":
        """Create a folder with config and first checkpoint, atomically. Raises RunError if it
        exists, or WriteError."""
        # This import loads torch, which is not needed to read a folder.
        from bricksrl.training.checkpoint import save_checkpoint

        paths = _default_paths(config) if config.run_dir is None else [config.run_dir]
        for path in paths:
            refuse_within_dataset(path)
            if path.exists():
                continue
            try:
                # A folder appears with all its files or not at all, so that each run can be
                # resumed.
                with atomic_folder(path) as temporary:
                    folder = cls(temporary)
                    folder.write_config(config)
                    folder.write_episodes([])
                    save_checkpoint(folder.checkpoint_path, state)
            except WriteError:
                # Another process created it in the meantime, for example one of several seeds.
                if path.exists():
                    continue
                raise
            return cls(path)
        raise RunError(f"{config.run_dir} exists already; resume that run or choose another folder")

    def write_config(self, config: TrainConfig) -> None:
        """Write the config with the package versions."""
        packages = (*HOUSES, "torch", "torchrl", "tensordict", "mujoco")
        versions = {name: metadata.version(name) for name in packages}
        versions["python"] = platform.python_version()
        data = {"bricksrl_run": 1, "config": config.to_dict(), "versions": versions}
        text = (json.dumps(data, indent=2) + "\n").encode()
        # The user has just named this code, which needs no second permission, neither here nor on
        # later days.
        if code_in(data["config"]):
            remember(text)
        write_durably(self.config_path, text)

    def read_config(self) -> TrainConfig:
        """Read the config. Raises RunError if there is no run, its config is invalid, or it names
        code from another computer."""
        existing_run(self.path)
        with reading(
            "the config",
            self.config_path,
            RunError,
            "restore the file or start a new run",
        ):
            text = self.config_path.read_bytes()
            data = json.loads(text)
            config = dict(data["config"])
            version = data["bricksrl_run"]
        if version != 1:
            raise RunError(f"{self.config_path} is of another version of BricksRL; start a new run")
        # This comes before the config is made, which loads the settings of a user's algorithm.
        require_trusted(self.config_path, text, code_in(config))
        return TrainConfig.from_dict(config, run_dir=self.path)

    def origin(self) -> Origin:
        """Origin of the run. Raises the errors of `read_config`."""
        config = self.read_config()
        return Origin(
            config.env,
            config.robot,
            config.agent,
            config.seed,
            bool(config.updates),
        )

    def trained_by(self) -> str:
        """Name of who trained, in a class; "" if nobody gave one. Raises the errors of
        `read_config`."""
        return self.read_config().name

    def read_evaluation(self) -> dict[str, Any] | None:
        """The latest evaluation, as `EvaluationResult` wrote it; ``None`` if there is none, or it
        is damaged."""
        path = self.evaluation_path
        try:
            with reading(
                "the evaluation",
                path,
                RunError,
                "evaluate the run again",
            ):
                data = dict(json.loads(path.read_bytes()))
                for name in ("return_mean", "return_std", "episodes", "trained_episodes"):
                    float(data[name])
                return data
        # An evaluation is only reported, and a run is complete without one.
        except RunError:
            return None

    def own_evaluation(self, episodes: int) -> dict[str, Any] | None:
        """The evaluation if it is of the agent after this number of episodes, under the conditions
        of its training."""
        data = self.read_evaluation()
        if data is None:
            return None
        # The agent may have learned on since the evaluation.
        is_current = data["trained_episodes"] == episodes
        return data if is_current and data.get("as_trained") else None

    def append(self, episode: Episode) -> None:
        """Append an episode to the metrics; they are written anew where it has a measure that none
        before it had. Raises WriteError, for instance while Excel has them open on Windows."""
        with writing(self.metrics_path), self.metrics_path.open("r+b") as file:
            header = file.readline().decode()
            columns = next(csv.reader([header]))
            are_known = episode.measures.keys() <= set(columns)
            if are_known:
                file.seek(0, io.SEEK_END)
                file.write(_csv(columns, [episode]))
        # New measures appear, for example the losses, which the random episodes before did not
        # have.
        if not are_known:
            self.write_episodes([*self.read_episodes(), episode])

    def draw_curve(
        self,
        config: TrainConfig,
        episodes: Sequence[Episode],
    ) -> None:
        """Draw the learning curve."""
        # This import loads Matplotlib, which only a run that ends needs.
        from bricksrl.training.curve import draw_learning_curve

        env = without_folder(config.env)
        agent = without_folder(config.agent)
        title = f"{env} · {agent} · seed {config.seed}"
        lines = reference_lines(config.env, config.options)
        draw_learning_curve(
            self.curve_path,
            episodes,
            title,
            lines,
        )

    def read_episodes(self) -> tuple[Episode, ...]:
        """Read the metrics, without a last row that a crash has cut. Raises RunError if they are
        missing or invalid."""
        with reading(
            "the metrics",
            self.metrics_path,
            RunError,
            "restore the file or start a new run",
        ):
            text = self.metrics_path.read_text(encoding="utf-8")
            # Whatever follows the last line end is a row that was cut.
            whole_lines, _, _ = text.rpartition("\n")
            rows = csv.DictReader(whole_lines.splitlines())
            return tuple(map(_episode, rows))

    def write_episodes(self, episodes: Sequence[Episode]) -> None:
        """Replace the metrics, which after a crash may be ahead of the checkpoint."""
        # Each name is kept once, in the order in which the names came up.
        measures: dict[str, None] = {}
        for episode in episodes:
            measures.update(dict.fromkeys(episode.measures))
        columns = [*MEASURED, *measures, *MEASURED_TOO]
        write_durably(self.metrics_path, _csv(columns, episodes, header=True))


def _default_paths(config: TrainConfig) -> Iterator[Path]:
    """The folder of a run that names none, then the same with -2, -3, ..."""
    name = f"{file_name(config.env)}-{file_name(config.agent)}-seed-{config.seed}"
    yield Path("runs") / name
    for number in itertools.count(2):
        yield Path("runs") / f"{name}-{number}"


def file_name(env_id: str) -> str:
    """An environment's id, or the file of a user's task, as part of a file name."""
    return re.sub(r"[^\w.-]+", "-", without_folder(env_id)).strip("-.")


def _csv(
    columns: list[str],
    episodes: Iterable[Episode],
    *,
    header: bool = False,
) -> bytes:
    text = io.StringIO()
    # If a table has a column less, that measure is left out. Lines end alike on each system.
    writer = csv.DictWriter(
        text,
        columns,
        extrasaction="ignore",
        lineterminator="\n",
    )
    if header:
        writer.writeheader()
    writer.writerows(map(_row, episodes))
    return text.getvalue().encode()


def _row(episode: Episode) -> dict[str, Any]:
    """An episode as a row of the metrics; ``None`` is an empty cell."""
    row: dict[str, Any] = dict(episode.measures)
    for name in (*MEASURED, *MEASURED_TOO):
        # "return" is a word of Python and cannot name a field.
        if name != "return":
            row[name] = getattr(episode, name)
    row["return"] = episode.return_
    # Truth values become numbers, because spreadsheets can add those.
    row["success"] = None if episode.success is None else int(episode.success)
    row["link_lost"] = int(episode.link_lost)
    row["seconds"] = f"{episode.seconds:.3f}"
    if episode.updates_per_step is not None:
        row["updates_per_step"] = f"{episode.updates_per_step:.4g}"
    return row


def _episode(row: dict[str, str]) -> Episode:
    """Inverse of `_row`, but for what that rounds."""
    # A measure that an episode does not have is an empty cell.
    measures = {
        name: float(value)
        for name, value in row.items()
        if value and name not in (*MEASURED, *MEASURED_TOO)
    }
    return Episode(
        episode=int(row["episode"]),
        phase=Phase(row["phase"]),
        steps=int(row["steps"]),
        length=int(row["length"]),
        return_=float(row["return"]),
        success=bool(int(row["success"])) if row["success"] else None,
        measures=measures,
        seconds=float(row["seconds"]),
        updates_per_step=float(row["updates_per_step"]) if row["updates_per_step"] else None,
        link_lost=row["link_lost"] == "1",
        evaluation=float(row["evaluation"]) if row["evaluation"] else None,
        robot=row.get("robot") or "",
    )
