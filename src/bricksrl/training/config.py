"""Configuration of a training run: plain data. Importing this loads no torch."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bricksrl.agents import algorithm, preset
from bricksrl.agents.settings import LARGEST
from bricksrl.envs.options import EnvOptions
from bricksrl.errors import BricksError, RunError
from bricksrl.fields import check_fields
from bricksrl.seed import check_seed
from bricksrl.twin.physics import Physics

_LEAST = {"episodes": 1, "num_envs": 1, "robots": 1, "eval_episodes": 1, "eval_every": 0, "updates": 0, "patience_s": 0}
"""Of numbers that have a lower limit."""


@dataclass(frozen=True)
class TrainConfig(EnvOptions):
    """A training run in an environment. Two synchronous runs with equal configs on the virtual hub end bit-identical."""

    env: str
    """Environment, by id, or a task of your own as `bricksrl.make` takes it."""
    agent: str = "sac"
    """Agent, by name (``bricksrl.agents.AGENTS``), or an algorithm of your own: my_agent.py[:NAME]."""
    episodes: int = 40
    """Episodes, those with random actions at the start included."""
    seed: int = 0
    """Seed of everything random: networks, exploration, replay, and the virtual robot."""
    device: str = "cpu"
    """Device of networks, replay and simulations: cpu, cuda, mps, or auto for the best one here."""
    compile: bool = False
    """Compile loss and gradients into one graph: takes a while at the start, for long runs."""
    num_envs: int = 1
    """Copies that are trained on at once: of a simulation in one batch, of a virtual robot in as many processes."""
    robots: int = 1
    """Virtual robots that learn together, each in a process and in its own time; real ones are named in ``hub``, separated by
    commas."""
    eval_every: int = 0
    """Evaluate after every so many episodes, and keep the best checkpoint; 0 for never."""
    eval_episodes: int = 5
    """Episodes of each of these evaluations."""
    stop_at: float | None = None
    """Stop once the mean return of the last five episodes, or of an evaluation where there are some, is this or more."""
    asynchronous: bool | None = None
    """Learn beside the robot, in a process of its own, rather than while the robot waits; without a word, where the robot takes
    real time. Synchronous runs are repeatable, asynchronous ones are not."""
    patience_s: float = 300.0
    """How long to try to reach a robot again whose link broke; 0 gives up at once."""
    log: str = "none"
    """Who else is told how the run goes, beside the CSV: tensorboard, wandb or trackio."""
    settings: Any = None
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
    """Folder of the run, which must not exist yet; without one ``runs/<env>-<agent>-seed-<seed>`` is taken, or the first free one
    with -2, -3, ... behind it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least in _LEAST.items():
            if not least <= getattr(self, name) <= LARGEST:
                raise RunError(f"{name} is {getattr(self, name)}; give {least} or more, and up to {LARGEST:,}")
        if self.num_envs > 1 and (self.hub != "virtual" or self.realtime or self.updates):
            raise RunError("copies are for simulations and virtual robots in simulated time; leave num_envs away")
        check_seed(self.seed)
        if self.asynchronous is None:
            object.__setattr__(self, "asynchronous", self.realtime or self.hub != "virtual")
        if self.asynchronous and self.num_envs > 1:
            raise RunError("copies are learned from in the loop; train synchronously, or leave num_envs away")
        if self.updates and self.data is None:
            raise RunError(f"there are to be {self.updates} updates from data, but no data; give the folder of a dataset")
        if self.updates and self.updates < self.episodes:
            raise RunError(f"{self.updates} updates cannot be spread over {self.episodes} episodes; give fewer episodes")
        if len(self.hubs) > 1:
            self._check_fleet()
        if self.settings is None:  # written down, whatever a later version has
            object.__setattr__(self, "settings", settings_for(self.env, "default", self.agent))

    @property
    def hubs(self) -> tuple[str, ...]:
        """How to reach each of the robots; more than one make a fleet."""
        named = tuple(part.strip() for part in self.hub.split(","))
        return named if len(named) > 1 else named * self.robots

    def _check_fleet(self) -> None:
        real = [hub for hub in self.hubs if hub != "virtual"]
        if self.robots > 1 and real:
            raise RunError("real robots are named one by one, such as ble:A,ble:B; leave robots away")
        if real and (len(set(real)) < len(self.hubs) or any(":" not in hub for hub in real)):
            raise RunError(f"the hubs {self.hub} are no robots that can be told apart; give each a name, such as ble:A,ble:B")
        if self.num_envs > 1 or self.eval_every or self.updates:
            raise RunError("several robots learn on, from what they do; leave num_envs, eval_every and updates away")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON; the folder is left out, it is where this is written."""
        data = dataclasses.asdict(self)
        del data["run_dir"]
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
            check_fields(cls, data)
            settings = None if given is None else settings_from(data.get("agent", cls.agent), given)
            data = {**data, "settings": settings, "physics": None if physics is None else Physics.from_dict(physics)}
            return cls(**data, run_dir=run_dir)
        except (BricksError, TypeError) as error:
            raise RunError(f"the config cannot be used: {error}; restore the file or start a new run") from None


def settings_from(agent: str, given: dict[str, Any]) -> Any:
    """The settings of an agent from plain values.

    Raises:
        BricksError, TypeError: there is no such agent, or these are not its settings.
    """
    kind = algorithm(agent).settings
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
    check_fields(kind, values)
    return kind(**values)


def settings_for(env: str, name: str, agent: str) -> Any:
    """The settings of a preset for an agent in an environment, by its id; those for images where it has a camera.

    Raises:
        UnknownNameError: there is no such agent or preset.
    """
    from bricksrl.envs.registry import get_task

    try:
        images = get_task(env).camera is not None
    except BricksError:
        images = False  # no environment of ours: whoever makes it says so
    return preset(name, agent, images=images)
