"""Configuration of training runs: plain data. Importing this loads no torch."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.fields import LARGEST, check_fields
from brickhub.seed import check_seed
from brickhub.user_files import with_absolute_file, without_folder
from bricksrl.agents import algorithm, preset
from bricksrl.envs.options import EnvOptions
from bricksrl.errors import BricksError, DescriptionError, RunError, UnknownNameError, counted
from bricktwin.twin.physics import Physics

_LEAST = {"episodes": 1, "num_envs": 1, "robots": 1, "eval_episodes": 1, "eval_every": 0, "updates": 0, "patience_s": 0}
"""Lower limits."""


@dataclass(frozen=True)
class TrainConfig(EnvOptions):
    """A training run in an environment. Synchronous runs on the virtual hub are bit-identical for equal configs."""

    env: str
    """Environment id, or your own task, as for `bricksrl.make`."""
    agent: str = "sac"
    """Agent by name (``bricksrl.agents.AGENTS``), or your own algorithm: my_agent.py[:NAME]."""
    episodes: int = 40
    """Episodes, including those of random actions at the start."""
    seed: int = 0
    """Seed of everything random: networks, exploration, replay, and the virtual robot."""
    device: str = "cpu"
    """Device of networks, replay and simulations: cpu, cuda, mps, or auto for the best one here."""
    compile: bool = False
    """Compile loss and gradients into one graph: slow at the start, for long runs."""
    num_envs: int = 1
    """Parallel copies: a batch of a simulation, or one process per virtual robot."""
    robots: int = 1
    """Virtual robots that learn together, each in its own process; real ones are named in ``hub``, separated by commas."""
    eval_every: int = 0
    """Episodes between evaluations, which keep the best checkpoint; 0 for none."""
    eval_episodes: int = 5
    """Episodes of an evaluation."""
    stop_at: float | None = None
    """Stop when the mean return of the last five episodes, or of an evaluation if there are any, reaches this."""
    asynchronous: bool | None = None
    """Learn in another process while the robot moves; by default in real time. Only synchronous runs are repeatable."""
    patience_s: float = 300.0
    """Time of retries to reach a lost robot; 0 gives up at once."""
    log: str = "none"
    """Experiment tracker in addition to the CSV: tensorboard, wandb or trackio."""
    settings: Any = None
    """Settings of the agent; by default of its preset "default"."""
    data: str | None = None
    """Folder of a dataset, or of a run that recorded one, for half of each batch."""
    updates: int = 0
    """Updates from the data only, spread over the episodes, which only show what was learned; 0 learns on the robot."""
    start: str | None = None
    """Folder of a run whose agent continues here. From another agent only the policy is used, with settings by
    `bricksrl.training.offline.settings_like`."""
    record: bool = True
    """Record all transitions as a dataset in the run's folder ``data``."""
    run_dir: Path | None = None
    """New folder of the run; by default the first free one of ``runs/<env>-<agent>-seed-<seed>`` and the same with -2, -3, ..."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        for name, type_ in (("run_dir", Path), ("data", str), ("start", str)):  # a string is as good as a path
            if isinstance(getattr(self, name), Path | str):
                object.__setattr__(self, name, type_(getattr(self, name)))
        super().__post_init__()
        for name in ("env", "agent"):  # the run can then be used in any folder
            object.__setattr__(self, name, with_absolute_file(getattr(self, name)))
        for name, least in _LEAST.items():
            if not least <= getattr(self, name) <= LARGEST:
                raise RunError(f"{name} is {getattr(self, name)}; give {least} or more, and up to {LARGEST:,}")
        if self.stop_at is not None and not abs(self.stop_at) <= sys.float_info.max:
            raise RunError("stop_at is not a finite number; give the return to stop at, or omit it")
        if self.num_envs > 1 and (self.hub != "virtual" or self.realtime or self.updates):
            raise RunError("copies need a simulation or virtual robots in simulated time; omit num_envs")
        if self.asynchronous is None:
            object.__setattr__(self, "asynchronous", self.realtime or self.hub != "virtual")
        if self.asynchronous and self.num_envs > 1:
            raise RunError("copies cannot be trained asynchronously; train synchronously, or omit num_envs")
        if self.updates and self.data is None:
            raise RunError(f"{counted(self.updates, 'update')} from data need data; give the folder of a dataset")
        if self.updates and self.updates < self.episodes:
            episodes = counted(self.episodes, "episode")
            raise RunError(f"{counted(self.updates, 'update')} cannot be spread over {episodes}; give fewer episodes")
        if len(self.hubs) > 1:
            self._check_fleet()
        if self.settings is None:  # stored, so that later versions use the same
            object.__setattr__(self, "settings", settings_for(self.env, "default", self.agent))
        if not dataclasses.is_dataclass(self.settings):
            raise DescriptionError(f"settings is {self.settings!r}; give those of the agent, such as preset('paper', 'sac')")
        object.__setattr__(self, "settings", _plain(self.settings))

    @property
    def hubs(self) -> tuple[str, ...]:
        """Address of each robot; several make a fleet."""
        addresses = tuple(part.strip() for part in self.hub.split(","))
        return addresses if len(addresses) > 1 else addresses * self.robots

    def _check_fleet(self) -> None:
        real = [hub for hub in self.hubs if hub != "virtual"]
        if self.robots > 1 and real:
            raise RunError("real robots are named one by one, such as ble:A,ble:B; omit robots")
        if real and (len(set(real)) < len(self.hubs) or any(":" not in hub for hub in real)):
            raise RunError(f"the hubs {self.hub} are ambiguous; give each robot a name, such as ble:A,ble:B")
        if self.num_envs > 1 or self.eval_every or self.updates:
            raise RunError("a fleet does not support num_envs, eval_every and updates; omit them")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the run's folder."""
        data = dataclasses.asdict(self)
        del data["run_dir"]
        values = data["settings"].items()
        data["settings"] = {name: list(value) if isinstance(value, tuple) else value for name, value in values}
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any], run_dir: Path | None = None) -> TrainConfig:
        """Inverse of `to_dict`. Raises RunError if a name or type is invalid."""
        values = data.get("settings")
        if not isinstance(values, dict | None):
            raise RunError("'settings' in the config is not a table; restore the file")
        physics = data.get("physics")
        try:
            settings = None if values is None else settings_from(data.get("agent", cls.agent), values)
            data = {**data, "settings": settings, "physics": None if physics is None else Physics.from_dict(physics)}
            return cls(**data, run_dir=run_dir)
        except UnknownNameError as error:  # says what to do
            raise RunError(f"the run needs what is not here: {error}") from None
        except (BricksError, TypeError) as error:
            raise RunError(f"the config is invalid: {error}; restore the file or start a new run") from None


def _plain(settings: Any) -> Any:
    """Settings for a file: NumPy numbers, such as rates from an array, as Python's; the network by its absolute path."""
    changed = {name: value.item() for name, value in vars(settings).items() if isinstance(value, np.generic)}
    if isinstance(network := getattr(settings, "network", None), str):
        changed["network"] = with_absolute_file(network)
    return dataclasses.replace(settings, **changed) if changed else settings


def portable(data: dict[str, Any]) -> dict[str, Any]:
    """A config as plain values with only the names of the user's files: it is the same on all computers."""
    settings = {name: without_folder(value) if name == "network" else value for name, value in data["settings"].items()}
    return {**data, "env": without_folder(data["env"]), "agent": without_folder(data["agent"]), "settings": settings}


def settings_from(agent: str, given: dict[str, Any]) -> Any:
    """Settings of an agent from plain values. Raises BricksError or TypeError if the agent or its settings are invalid."""
    settings_type = algorithm(agent).settings
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
    check_fields(settings_type, values)
    return settings_type(**values)


def settings_for(env: str, name: str, agent: str) -> Any:
    """Settings of a preset for an agent in an environment. Raises UnknownNameError if there is no such agent or preset."""
    from bricksrl.envs.registry import get_task

    try:
        images = get_task(env).camera is not None
    except BricksError:
        images = False  # not a registered environment
    return preset(name, agent, images=images)
