"""The folder of a run: config, metrics, checkpoint, learning curve, evaluation. No run ever writes over another."""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import json
import platform
import re
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from bricksrl.data.files import TEMPORARY_PREFIX, write_durably
from bricksrl.errors import RunError
from bricksrl.training.config import TrainConfig
from bricksrl.training.observer import Episode, Phase

LOSSES = ("critic_loss", "value_loss", "gap", "actor_loss", "kl", "entropy", "alpha")
COLUMNS = ("episode", "phase", "steps", "length", "return", "success", *LOSSES, "seconds", "updates_per_step", "link_lost")


@dataclass(frozen=True)
class RunFolder:
    """Paths and files of one run."""

    path: Path

    @property
    def config_path(self) -> Path:
        return self.path / "config.json"

    @property
    def metrics_path(self) -> Path:
        return self.path / "metrics.csv"

    @property
    def checkpoint_path(self) -> Path:
        return self.path / "checkpoint.bin"

    @property
    def curve_path(self) -> Path:
        return self.path / "learning_curve.png"

    @property
    def evaluation_path(self) -> Path:
        return self.path / "evaluation.json"

    @classmethod
    def create(cls, config: TrainConfig, state: dict[str, Any]) -> RunFolder:
        """A new folder, holding the config and a first checkpoint; it is there whole or not at all.

        Raises:
            RunError: the folder exists, or cannot be made.
        """
        from bricksrl.training.checkpoint import save_checkpoint

        wanted = config.run_dir
        parent = Path("runs") if wanted is None else wanted.parent
        temporary = None
        try:
            parent.mkdir(parents=True, exist_ok=True)
            temporary = cls(Path(tempfile.mkdtemp(dir=parent, prefix=".new-")))
            temporary.path.chmod(0o755)
            temporary.write_config(config)
            temporary.write_episodes([])
            save_checkpoint(temporary.checkpoint_path, state)
            return cls(_settle(temporary.path, wanted or parent / f"{file_name(config.env)}-{config.agent}", wanted is None))
        except FileExistsError:
            raise RunError(f"{wanted} exists already; resume that run or choose another folder") from None
        except OSError as error:
            raise RunError(f"cannot make the folder {wanted or parent} ({error.strerror}); choose another one") from None
        finally:
            if temporary is not None:
                shutil.rmtree(temporary.path, ignore_errors=True)

    def clean(self) -> None:
        """Remove what a process that was killed left half written."""
        for remnant in self.path.glob(f"{TEMPORARY_PREFIX}*"):
            remnant.unlink(missing_ok=True)

    def write_config(self, config: TrainConfig) -> None:
        """Write the config, with the versions that the run is made with."""
        data = {"bricksrl_run": 1, "config": config.to_dict(), "versions": _versions()}
        write_durably(self.config_path, (json.dumps(data, indent=2) + "\n").encode())

    def read_config(self) -> TrainConfig:
        """The config of the run.

        Raises:
            RunError: there is no run in this folder, or its config cannot be read.
        """
        try:
            data = json.loads(self.config_path.read_bytes())
        except OSError:
            raise RunError(f"there is no run in {self.path}; choose a folder with a config.json") from None
        except ValueError:
            raise RunError(f"{self.config_path} is no JSON; restore the file or start a new run") from None
        if not isinstance(data, dict) or data.get("bricksrl_run") != 1 or not isinstance(data.get("config"), dict):
            raise RunError(f"{self.config_path} is no config of a run; choose a folder that a run was made in")
        return TrainConfig.from_dict(data["config"], run_dir=self.path)

    def append(self, episode: Episode) -> None:
        """Add an episode's row to the metrics."""
        with self.metrics_path.open("ab") as file:
            file.write(_csv([_row(episode)]))

    def read_episodes(self) -> tuple[Episode, ...]:
        """The episodes in the metrics.

        Raises:
            RunError: the metrics are missing or are not ours.
        """
        try:
            with self.metrics_path.open(newline="") as file:
                return tuple(_episode(row) for row in csv.DictReader(file))
        except OSError as error:
            raise RunError(f"cannot read {self.metrics_path} ({error.strerror}); restore the file or start a new run") from None
        except (KeyError, ValueError, TypeError):
            raise RunError(f"{self.metrics_path} has a row that is not ours; restore the file or start a new run") from None

    def write_episodes(self, episodes: Iterable[Episode]) -> None:
        """Replace the metrics by these episodes: after a crash they may hold one that the checkpoint does not know."""
        write_durably(self.metrics_path, _csv([COLUMNS, *map(_row, episodes)]))


def file_name(env_id: str) -> str:
    """An environment's id as a part of a file's name, also where it is the path of a task of the user's own."""
    return re.sub(r"[^\w.-]+", "-", env_id).strip("-.")


def _settle(folder: Path, path: Path, numbered: bool) -> Path:
    """Rename ``folder`` to ``path``, or to the first free ``path``-1, -2, ...; returns what it became.

    Raises:
        FileExistsError: ``path`` is taken, and not ``numbered``.
    """
    for number in itertools.count(1):
        free = path.with_name(f"{path.name}-{number}") if numbered else path
        if not free.exists():
            with contextlib.suppress(OSError):  # somebody else may have taken it in this moment
                return folder.rename(free)
        if not numbered:
            raise FileExistsError(path)
    raise AssertionError


def _row(episode: Episode) -> list[Any]:
    losses = [repr(episode.losses[name]) if name in episode.losses else "" for name in LOSSES]
    success = "" if episode.success is None else int(episode.success)
    head = [episode.episode, episode.phase.value, episode.steps, episode.length, repr(episode.return_), success]
    ratio = "" if episode.updates_per_step is None else f"{episode.updates_per_step:.4g}"
    return [*head, *losses, f"{episode.seconds:.3f}", ratio, int(episode.link_lost)]


def _episode(row: dict[str, str]) -> Episode:
    return Episode(
        episode=int(row["episode"]),
        phase=Phase(row["phase"]),
        steps=int(row["steps"]),
        length=int(row["length"]),
        return_=float(row["return"]),
        success=bool(int(row["success"])) if row["success"] else None,
        losses={name: float(row[name]) for name in LOSSES if row.get(name)},
        seconds=float(row["seconds"]),
        updates_per_step=float(row["updates_per_step"]) if row.get("updates_per_step") else None,
        link_lost=row.get("link_lost") == "1",
    )


def _csv(rows: Iterable[Iterable[Any]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _versions() -> dict[str, str]:
    packages = {name: metadata.version(name) for name in ("bricksrl", "torch", "torchrl", "tensordict", "mujoco")}
    return {**packages, "python": platform.python_version()}
