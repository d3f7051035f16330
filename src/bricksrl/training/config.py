"""What a training run is told. Plain data: importing this loads no torch."""

from __future__ import annotations

import dataclasses
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bricksrl.agents.presets import AGENTS, Settings, preset
from bricksrl.errors import BricksError, RunError
from bricksrl.seed import check_seed
from bricksrl.twin.physics import Physics


@dataclass(frozen=True)
class TrainConfig:
    """A training run. Two synchronous runs with equal configs on the virtual hub end bit-identical."""

    env: str
    """Environment, by id, or a task of your own as `bricksrl.make` takes it."""
    agent: str = "sac"
    """Agent, by name; ``bricksrl.agents.AGENTS`` are all."""
    episodes: int = 40
    """Episodes, those with random actions at the start included."""
    seed: int = 0
    """Seed of everything random: networks, exploration, replay, and the virtual robot."""
    hub: str = "virtual"
    """How to reach the robot."""
    realtime: bool = False
    """Let a virtual robot take as long as a real one."""
    streaming: bool = False
    """Have the hub send its observations all the time; steps then follow one another at a fixed rate."""
    app_data: bool = False
    """Speak to the program on the hub over AppData instead of its standard input."""
    asynchronous: bool | None = None
    """Learn beside the robot, in a process of its own, rather than while the robot waits; without a word, where the robot takes
    real time. Synchronous runs are repeatable, asynchronous ones are not."""
    patience_s: float = 300.0
    """How long to try to reach a robot again whose link broke; 0 gives up at once."""
    randomize: bool = False
    """Draw another physics of the virtual robot for each episode."""
    physics: Physics | None = None
    """Physics of the virtual robot, such as a fitted one; without it a freshly charged robot on a smooth floor."""
    options: dict[str, Any] = field(default_factory=dict)
    """Options of the environment's task, such as ``{"sparse": True}``; plain values."""
    log: str = "none"
    """Who else is told how the run goes, beside the CSV: tensorboard, wandb or trackio."""
    settings: Settings | None = None
    """Settings of the agent; without them those of its preset "default"."""
    data: str | None = None
    """Dataset to learn from too, or a run that recorded one: its folder. Half of each batch is drawn from it."""
    updates: int = 0
    """Updates from the data alone, without the robot, spread over the episodes, in which the agent shows what it has learned;
    0 learns on the robot."""
    start: str | None = None
    """Run whose agent goes on learning here, from where it was: its folder. From a run of another agent its policy is taken;
    `bricksrl.training.offline.settings_like` gives settings that it fits."""
    record: bool = True
    """Keep every transition as a dataset, in the folder ``data`` of the run."""
    run_dir: Path | None = None
    """Folder of the run, which must not exist yet; without one the next free ``runs/<env>-<agent>-<number>`` is taken."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise RunError(f"episodes is {self.episodes}; train for at least 1")
        check_seed(self.seed)
        if self.randomize and self.physics is not None:
            raise RunError("the physics is given and is to be random too; choose one of the two")
        if not self.patience_s >= 0:
            raise RunError(f"patience_s is {self.patience_s}; give 0 or more seconds")
        if self.asynchronous is None:
            object.__setattr__(self, "asynchronous", self.realtime or self.hub != "virtual")
        if self.updates < 0:
            raise RunError(f"updates is {self.updates}; give 0 or more")
        if self.updates and self.data is None:
            raise RunError(f"there are to be {self.updates} updates from data, but no data; give the folder of a dataset")
        if self.updates and self.updates < self.episodes:
            raise RunError(f"{self.updates} updates cannot be spread over {self.episodes} episodes; give fewer episodes")
        if self.settings is None and self.agent in AGENTS:
            # written down, whatever a later version has
            object.__setattr__(self, "settings", settings_for(self.env, "default", self.agent))

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON; the folder is left out, it is where this is written."""
        data = dataclasses.asdict(self)
        del data["run_dir"]
        if self.settings is not None:
            values = data["settings"].items()
            data["settings"] = {name: list(value) if isinstance(value, tuple) else value for name, value in values}
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any], run_dir: Path | None = None) -> TrainConfig:
        """Inverse of `to_dict`.

        Raises:
            RunError: a name or a type in it is not one of ours.
        """
        given = data.get("settings")
        if not isinstance(given, dict | None):
            raise RunError("'settings' in the config is no table of names and values; restore the file")
        physics = data.get("physics")
        try:
            check_types(cls, data)
            settings = None
            if given is not None:
                kind: type[Any] = type(preset("default", data.get("agent", cls.agent), images="encoder" in given))
                values = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
                check_types(kind, values)
                settings = kind(**values)
            data = {**data, "settings": settings, "physics": None if physics is None else Physics.from_dict(physics)}
            return cls(**data, run_dir=run_dir)
        except (BricksError, TypeError) as error:
            raise RunError(f"the config cannot be used: {error}; restore the file or start a new run") from None


def settings_for(env: str, name: str, agent: str) -> Settings:
    """The settings of a preset for an agent in an environment, by its id; those for images where it has a camera.

    Raises:
        UnknownNameError: there is no such agent or preset, or the agent cannot learn from images.
    """
    from bricksrl.envs.registry import get_task

    try:
        images = get_task(env).camera is not None
    except BricksError:
        images = False  # no environment of ours: whoever makes it says so
    return preset(name, agent, images=images)


def check_types(cls: type, data: dict[str, Any]) -> None:
    """Raise TypeError where a value is not of the type that the dataclass has for its name; unions are not looked at."""
    for name, expected in typing.get_type_hints(cls).items():
        if name not in data or typing.get_origin(expected) in (typing.Literal, types.UnionType):
            continue
        kind = typing.get_origin(expected) or expected
        value = data[name]
        if not isinstance(value, (int, float) if kind is float else kind) or (isinstance(value, bool) and kind is not bool):
            raise TypeError(f"'{name}' is {value!r}, not of type {kind.__name__}")
